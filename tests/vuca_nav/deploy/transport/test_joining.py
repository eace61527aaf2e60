import pytest

from vuca_nav.deploy.transport.joining import network_by
from vuca_nav.deploy.transport.names import UNCHANGED
from vuca_nav.errors import BadArgument


def test_an_interface_is_of_dds() -> None:
    with pytest.raises(BadArgument, match="ZENOH_SESSION_CONFIG_URI"):
        network_by("zenoh", None, "lo", UNCHANGED)


@pytest.mark.parametrize(("domain", "variable", "told"), [(None, "7", "domain 7 by"), (3, "7", "domain 3 by")])
def test_the_domain_over_zenoh_is_that_of_ros(monkeypatch, domain, variable, told) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", variable)
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", "/robot/session.json5")
    network = network_by("zenoh", domain, None, UNCHANGED)
    assert told in network.where
    assert "/robot/session.json5" in network.where
    assert "same Zenoh router" in (network.warning or "")


def test_over_dds_this_machine_alone_is_reached_unless_an_interface_is_named() -> None:
    network = network_by("dds", 5, None, UNCHANGED)
    assert (network.where, network.warning) == ("ROS domain 5 on this machine alone", None)


@pytest.mark.parametrize("variable", ["x", "500"])
def test_a_domain_that_is_none_is_refused(monkeypatch, variable) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", variable)
    with pytest.raises(BadArgument, match=r"from 0 to \d+"):
        network_by("zenoh", None, None, UNCHANGED)
