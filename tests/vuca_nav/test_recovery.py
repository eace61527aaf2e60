import math

import numpy as np
import pytest

from vuca_nav.planning.planner import Plan
from vuca_nav.recovery import Recovery, RecoveryConfig, Rung
from vuca_nav.types import Pose2

PERIOD = 0.2
LADDER = [Rung.BACK_OUT, Rung.CLEAR, Rung.ANOTHER_WAY, Rung.WAIT]


def straight(start: float, end: float = 10.0) -> Plan:
    """A plan along the x axis, narrow at 2 m beyond its start."""
    x = np.arange(start, end + 0.05, 0.1)
    return Plan(
        np.column_stack([x, np.zeros(len(x))]), (end, 0.0), clearances=np.where(abs(x - start - 1.0) < 0.06, 0.3, 1.0)
    )


def climb(recovery: Recovery, xs, waits_for_mover=False) -> list[tuple[float, Rung]]:
    """When which rung begins for a robot that is at these places, one a period."""
    rungs = []
    for k, x in enumerate(xs):
        rung = recovery.update(k * PERIOD, (x, 0.0), straight(x), waits_for_mover)
        if rung is not None:
            rungs.append((k * PERIOD, rung))
    return rungs


def test_a_robot_that_gets_on_tries_nothing():
    recovery = Recovery(RecoveryConfig(), PERIOD)
    assert climb(recovery, np.arange(0.0, 9.0, 0.03)) == []
    assert recovery.rung == Rung.DRIVE


def test_without_progress_the_rungs_come_in_order_and_again():
    recovery = Recovery(RecoveryConfig(patience=5.0), PERIOD)
    rungs = climb(recovery, np.zeros(130))
    assert [rung for _, rung in rungs] == [*LADDER, Rung.BACK_OUT]
    assert [time for time, _ in rungs] == pytest.approx([4.8, 9.8, 14.8, 19.8, 24.8])


def test_circling_is_no_progress_and_neither_is_a_path_that_becomes_shorter():
    recovery = Recovery(RecoveryConfig(patience=5.0), PERIOD)
    rungs = []
    for k in range(60):
        place = (0.6 * math.cos(0.5 * k), 0.6 * math.sin(0.5 * k))
        path = np.array([place, (10.0 + 5.0 * (k % 2), 0.0)])  # leads here and there in turn
        rungs.append(recovery.update(k * PERIOD, place, Plan(path, (10.0, 0.0))))
    assert Rung.BACK_OUT in rungs


def test_a_robot_that_gets_on_and_heads_elsewhere_all_the_time_makes_progress():
    """As an explorer does in a maze: each path is longer than the last, and is followed as long as it is the path."""
    recovery = Recovery(RecoveryConfig(patience=5.0), PERIOD)
    for k in range(150):
        place = 0.1 * k, 0.0
        ahead, aside = np.arange(0.0, 1.0, 0.1), np.arange(0.0, 5.0 + 0.5 * k, 0.1)
        path = np.vstack(
            [np.column_stack([place[0] + ahead, 0.0 * ahead]), np.column_stack([place[0] + 1.0 + 0.0 * aside, aside])]
        )
        assert recovery.update(k * PERIOD, place, Plan(path, place)) is None


def test_movers_near_the_robot_are_waited_for():
    recovery = Recovery(RecoveryConfig(), PERIOD)
    assert climb(recovery, np.zeros(200), waits_for_mover=True) == []
    assert climb(recovery, np.zeros(40))


def test_it_backs_out_along_its_own_trail_for_a_while():
    recovery = Recovery(RecoveryConfig(), PERIOD)
    came = np.arange(0.0, 3.0, 0.1)
    rungs = climb(recovery, [*came, *np.full(26, 3.0)])
    assert [rung for _, rung in rungs] == [Rung.BACK_OUT]
    back = recovery.waypoint((3.0, 0.0))
    assert back is not None
    assert back[0] == pytest.approx(2.15, abs=0.1)
    for _ in range(16):
        recovery.update(9.0, (3.0, 0.0), straight(3.0))
    assert recovery.waypoint((3.0, 0.0)) is None


def test_it_bars_the_narrowest_place_ahead_for_a_while_and_follows_the_map():
    recovery = Recovery(RecoveryConfig(bar_time=30.0), PERIOD)
    recovery.update(0.0, (0.0, 0.0), straight(0.0))
    assert recovery.bar(0.0, (0.0, 0.0), straight(0.0))
    np.testing.assert_allclose(recovery.barred_in_map()[:, :2], [[1.0, 0.0]], atol=1e-9)
    recovery.follow(Pose2(0.0, 2.0, 0.0))
    np.testing.assert_allclose(recovery.barred_in_map()[:, :2], [[1.0, 2.0]], atol=1e-9)
    recovery.update(31.0, (0.0, 0.0), straight(0.0))
    assert not len(recovery.barred_in_map())
    assert not recovery.bar(0.0, (0.0, 0.0), Plan(np.array([[0.0, 0.0], [9.0, 0.0]]), (9.0, 0.0)))
