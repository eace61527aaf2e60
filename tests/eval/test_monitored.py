"""Methods under the safety layer in the simulator."""

import pytest

from eval.analysis.summary import is_result, summarise
from eval.episode import EpisodeConfig, run_episode
from eval.methods import METHODS, MethodOptions, resolve, title_of
from eval.runner import key_of
from eval.suites import SUITES, choose

MONITOR = MethodOptions(monitor=True)


def test_the_layer_goes_under_any_method_and_is_named():
    for name in METHODS:
        assert resolve(name, MONITOR) == resolve(name)
    assert title_of("ours-dh", {"monitor": True}) == "ours-dh --monitor"
    suite = choose(SUITES["square"], ["move_base", "ours-dh"], options=MONITOR)
    assert [driver.options.monitor for driver in suite.drivers] == [True, True]


@pytest.mark.parametrize("method", ["dwa-dh", "ours-dh"])
def test_a_mission_arrives_under_the_layer_and_its_row_says_what_it_did(method):
    config = EpisodeConfig(world="static", seed=3, without="V", method=method, options=MONITOR)
    row = run_episode(config).row()
    assert row["outcome"] == "success"
    assert row["monitor"] is True
    assert sum(row["monitor_ticks"].values()) == row["steps"]
    assert row["monitor_ticks"]["waiting"] == 30  # the first healthy second
    assert set(row["monitor_ticks"]) <= {"waiting", "passed", "limited", "slowed", "approach", "stopped"}


def test_without_it_nothing_is_told():
    row = run_episode(EpisodeConfig(world="static", seed=3, without="V", method="dwa-dh", goal=None)).row()
    assert row["monitor"] is False
    assert row["monitor_ticks"] is None
    before = {key: value for key, value in row.items() if not key.startswith("monitor")}  # of a version without it
    assert is_result(before)
    assert key_of(before) == key_of(row)
    assert len(summarise([before, row])) == 1
