import time
from pathlib import Path

import pytest

from eval.bridge.processes import Deployment, IdleLoop, StackEnded
from eval.bridge.real_time import jitter
from eval.bridge.trials import TrialArguments, cells_of, differences
from vuca_nav.errors import BadArgument, UnknownName

ROW = {"method": "ours", "steps": 3, "slam_ate": 0.1, "wall_time": 1.0, "monitor": False, "contact": None}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({}, []),
        ({"method": "deployed", "wall_time": 2.0, "monitor": True, "bits": "a", "monitor_ticks": {}}, []),
        ({"slam_ate": 0.1 + 1e-15}, ["slam_ate"]),
        ({"steps": 4, "contact": {"class": "hit"}}, ["contact", "steps"]),
    ],
)
def test_rows_differ_in_what_was_driven_not_in_who_drove_or_where(changes, named):
    assert differences(ROW | changes, ROW) == named


def test_cells_are_robots_times_tasks_with_the_same_seeds():
    cells = cells_of(TrialArguments(out=Path("out"), seeds="3:5"))
    assert [cell.name for cell in cells] == ["tiago-factory-2", "tiago-building", "go2-factory-2", "go2-building"]
    assert [(config.robot, config.world, config.region, config.seed) for config in cells[2].configs] == [
        ("go2", "factory", 2, 3),
        ("go2", "factory", 2, 4),
    ]


def test_what_does_not_exist_is_named():
    with pytest.raises(BadArgument, match="unknown task 'square'"):
        cells_of(TrialArguments(out=Path("out"), tasks="square"))
    with pytest.raises(UnknownName):
        cells_of(TrialArguments(out=Path("out"), robots="gp2"))


def test_jitter_is_the_deviation_from_the_ticks_period():
    assert jitter([1 / 30, 1 / 30 + 0.002, 1 / 30 - 0.001]) == pytest.approx([0.0, 0.002, 0.001])


def test_a_stack_that_ends_is_told_with_its_last_words(tmp_path):
    with Deployment(tmp_path / "nothing", (), 1, tmp_path / "log" / "deploy.log") as process:
        end = time.monotonic() + 60.0
        while process.exit_code is None and time.monotonic() < end:
            time.sleep(0.05)
        with pytest.raises(StackEnded, match=r"exit code 2: .*deploy"):
            process.check()
    assert process.memory() == 0


def test_an_idle_loop_keeps_its_rate():
    with IdleLoop(100.0) as loop:
        end = time.monotonic() + 60.0
        periods = loop.take()
        while len(periods) < 20 and time.monotonic() < end:
            time.sleep(0.05)
            periods += loop.take()
    assert len(periods) >= 20
    assert sum(periods) / len(periods) > 0.0099
