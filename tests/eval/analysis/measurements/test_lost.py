"""Faults that take a robot's place from it: what counts as found again, and a mission in a small hall."""

import numpy as np
import pytest

from eval.analysis.measurements import lost
from eval.analysis.measurements.lost import FAULTS, found_after, is_found, lost_of, table
from eval.episode import EpisodeConfig
from tests.robots.halls import hall
from vuca_nav.types import Pose2
from worlds import save_scene


def test_found_is_right_until_the_end():
    times = np.arange(10.0)
    right = np.array([1, 1, 0, 0, 1, 0, 0, 1, 1, 1], bool)
    assert found_after(times, right, 2.0) == pytest.approx(5.0)
    assert found_after(times, right, 8.0) == pytest.approx(0.0)
    right[-1] = False
    assert found_after(times, right, 2.0) is None
    assert not is_found({"found_after": 20.5})


def test_a_mission_with_each_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(lost, "LEAST_WAY", 1.5)
    path = tmp_path / "hall.yaml"
    save_scene(hall(14.0, Pose2(1.5, 3.0, 0.0)), path)
    row = lost_of(EpisodeConfig(str(path), method="dwa-dh", seed=1))
    assert set(row["faults"]) == set(FAULTS)
    assert "blind" in table([row])
