"""``vuca deploy`` as it is typed: what is wrong is one line, and SIGTERM leaves a zero command behind."""

import contextlib
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.vuca_nav.deploy import bundles
from vuca_nav.deploy.command import StatusLine, deploy
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.errors import BadArgument, VucaError

DOMAIN = 106


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--lockstep", "--twist"], "--twist"),
        (["--base", "unitree", "--lockstep"], "--base unitree"),
        (["--base", "unitree", "--transport", "zenoh"], "--base unitree speaks DDS"),
        (["--base", "unitree", "--ros-args", "-p", "use_sim_time:=true"], "--base unitree"),
        (["--record", "a.rrd", "--spawn"], "exclude each other"),
        (["--interface", "nonesuch0"], "network interface"),
        (["--domain", "999"], "domain"),
        (["--speed", "1.5"], "speed"),
        (["--ros-args", "-r", "scan"], "left:=right"),
        (["--no-such-option"], "no-such-option"),
    ],
)
def test_bad_options_are_named(tmp_path: Path, options: list[str], message: str) -> None:
    bundle = bundles.write(tmp_path / "bundle")
    with pytest.raises(VucaError, match=message):
        deploy([str(bundle), *options])


def test_a_folder_that_is_no_bundle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VucaError, match="bundle"):
        deploy([str(tmp_path)])


def test_a_log_is_not_written_over(tmp_path: Path) -> None:
    bundle = bundles.write(tmp_path / "bundle")
    log = tmp_path / "run.mcap"
    log.write_bytes(b"")
    with pytest.raises(BadArgument, match="exists"):
        deploy([str(bundle), "--log", str(log)])


def test_the_loop_does_not_wait_for_whoever_reads_the_status() -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with os.fdopen(reader, "rb") as heard, os.fdopen(writer, "w") as stream:
        line = StatusLine(stream)
        line(lambda: "standing")
        assert heard.read1(100) == b"standing\n"
        with contextlib.suppress(BlockingIOError):
            while os.write(writer, bytes(1000)):
                pass
        os.set_blocking(writer, True)
        line._last = -math.inf
        line(lambda: "nobody reads this")
        os.set_blocking(reader, False)
        assert b"nobody" not in heard.read()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_terminated_process_leaves_a_zero_command(tmp_path: Path, number: signal.Signals) -> None:
    from eval.export.command import export

    bundle = tmp_path / "tiago"
    assert export(["--robot", "tiago", "--method", "dwa-dh", "--steps", "150", "--out", str(bundle)]) == 0
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        commands = transport.subscribe("cmd_vel", "geometry_msgs/msg/TwistStamped")
        process = subprocess.Popen(
            [sys.executable, "-m", "vuca_nav.cli", "deploy", str(bundle)],
            env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
            stderr=subprocess.DEVNULL,
        )
        try:
            end = time.monotonic() + 300.0
            while not commands.take():
                assert process.poll() is None
                assert time.monotonic() < end
                time.sleep(0.05)
            process.send_signal(number)
            assert process.wait(30.0) == 128 + number
        finally:
            process.kill()
        last = [received.message.twist for received in commands.take()][-1]
        assert (last.linear.x, last.angular.z) == (0.0, 0.0)
