import numpy as np
import pytest

from tests.vuca_nav.planning.test_planning import as_grid, hall
from vuca_nav.exploration.explorer import Explorer, ExplorerConfig
from vuca_nav.exploration.frontiers import find_frontiers
from vuca_nav.exploration.heuristic import NoCritic, SafetyCritic, score_candidates
from vuca_nav.planning.costmap import Costmap, CostmapConfig
from vuca_nav.planning.paths import PathField
from vuca_nav.telemetry.interface import FrontierView, Telemetry
from vuca_nav.types import Pose2

HERE = Pose2(3.0, 2.0, 0.0)


def two_doors() -> np.ndarray:
    """A 6 x 4 m hall known but for what lies behind openings in its right and its upper wall."""
    picture = hall(60, 40)
    picture[15:25, 59] = " "  # right, 1 m wide, centred at y = 2.0
    picture[0, 10:20] = " "  # upper, centred at x = 1.5
    return picture


def view(picture: np.ndarray, robot=(3.0, 2.0)):
    grid = as_grid(picture)
    costmap = Costmap(grid, 0.3, robot, CostmapConfig())
    return grid, costmap, PathField(costmap, robot)


def test_a_frontier_is_found_at_each_opening():
    _, costmap, field = view(two_doors())
    points, approach, lengths = find_frontiers(costmap, field, 0.4, 3.0, 0.3)
    assert len(points) == 2
    assert np.hypot(*(approach - points).T).max() < 0.61
    assert all(field.reaches(x, y) for x, y in approach)
    by_x = points[np.argsort(points[:, 0])]
    np.testing.assert_allclose(by_x[0], (1.5, 3.85), atol=0.25)
    np.testing.assert_allclose(by_x[1], (5.85, 2.0), atol=0.25)
    straight = np.hypot(points[:, 0] - 3.0, points[:, 1] - 2.0)
    assert (lengths >= straight - 0.15).all()
    assert (lengths <= 1.15 * straight + 0.15).all()


def test_short_frontiers_are_noise_and_long_ones_are_cut():
    picture = hall(60, 40)
    picture[20:24, 59] = " "
    _, costmap, field = view(picture)
    assert len(find_frontiers(costmap, field, 0.4, 3.0, 0.3)[0]) == 0
    picture = hall(60, 40)
    picture[1:39, 40:] = " "
    _, costmap, field = view(picture)
    assert len(find_frontiers(costmap, field, 0.4, 10.0, 0.3)[0]) == 1
    assert len(find_frontiers(costmap, field, 0.4, 1.0, 0.3)[0]) == 4


def test_gaps_between_the_dots_of_a_wall_are_no_frontiers():
    """A wall seen at a grazing angle: returns 0.8 m apart, unknown between and behind them."""
    picture = hall(60, 40)
    picture[30:39, 1:59] = " "
    picture[30, 1:59:8] = "#"
    _, costmap, field = view(picture)
    assert len(find_frontiers(costmap, field, 0.4, 3.0, 0.3)[0]) == 0
    picture[30, 20:36] = " "  # one opening of 1.7 m
    _, costmap, field = view(picture)
    points = find_frontiers(costmap, field, 0.4, 3.0, 0.3).points_in_map
    assert len(points) == 1
    assert points[0] == pytest.approx((2.9, 1.0), abs=0.3)


def test_a_chink_is_looked_into_when_there_is_nothing_better():
    picture = hall(60, 40)
    picture[20:24, 59] = " "
    grid, costmap, field = view(picture)
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    target = explorer.choose(0.0, grid, costmap, field, HERE)
    assert target is not None
    assert target.point == pytest.approx((5.85, 1.8), abs=0.3)


def test_frontiers_out_of_reach_are_left_out():
    picture = two_doors()
    picture[1:39, 50] = "#"
    _, costmap, field = view(picture)
    points = find_frontiers(costmap, field, 0.4, 3.0, 0.3).points_in_map
    assert len(points) == 1
    assert points[0, 1] > 3.5


def test_heuristic_by_hand():
    scores = score_candidates(np.array([10.0, 14.0, 12.0]), np.array([0.5, 0.9, 0.8]), gamma=20.0)
    np.testing.assert_allclose(scores.goal_term, [0.0, 4.0, 2.0])
    np.testing.assert_allclose(scores.safety_term, [8.0, 0.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(scores.total, [8.0, 4.0, 4.0])


def test_heuristic_of_equals_is_zero():
    scores = score_candidates(np.array([3.0, 3.0]), np.array([1.0, 1.0]), gamma=1.0)
    np.testing.assert_array_equal(scores.total, [0.0, 0.0])


class Decisions(Telemetry):
    def __init__(self):
        self.views: list[FrontierView] = []

    def frontiers(self, view: FrontierView) -> None:
        self.views.append(view)


def test_the_goal_heuristic_chooses_the_opening_towards_the_goal():
    grid, costmap, field = view(two_doors())
    for goal, expected in (((20.0, 2.0), (5.85, 2.0)), ((1.5, 20.0), (1.5, 3.85))):
        told = Decisions()
        explorer = Explorer(telemetry=told)
        explorer.reset(goal)
        target = explorer.choose(0.0, grid, costmap, field, HERE)
        assert target is not None
        assert target.point == pytest.approx(expected, abs=0.25)
        assert not target.is_goal
        assert told.views[0].chosen == int(np.argmin(told.views[0].score))


class FearsRight(SafetyCritic):
    """Gives what leads to the right a chance, and all else certainty."""

    def __init__(self, chance: float = 0.5):
        self.chance, self.asked = chance, np.empty((0, 2))

    def values(self, points_in_map, map_from_base):
        self.asked = points_in_map
        return np.where(points_in_map[:, 0] > 3.5, self.chance, 1.0)


def test_a_critic_with_gamma_can_overrule_it():
    grid, costmap, field = view(two_doors())
    # The upper door is some 7.4 m worse: 17.1 m to the goal and some 18.6 + 2.4 less 14.2 + 2.9.
    for critic, gamma, expected_y in (
        (FearsRight(), 30.0, 3.85),
        (FearsRight(), 4.0, 2.0),
        (FearsRight(0.95), 30.0, 2.0),
        (FearsRight(), 0.0, 2.0),
        (NoCritic(), 30.0, 2.0),
    ):
        explorer = Explorer(ExplorerConfig(gamma=gamma), critic)
        explorer.reset((20.0, 2.0))
        target = explorer.choose(0.0, grid, costmap, field, HERE)
        assert target is not None
        assert target.point[1] == pytest.approx(expected_y, abs=0.25)


def test_the_critic_is_asked_where_the_ways_lead_first():
    grid, costmap, field = view(two_doors())
    for look_ahead in (1.0, 50.0):
        critic = FearsRight()
        explorer = Explorer(ExplorerConfig(gamma=1.0, look_ahead=look_ahead), critic)
        explorer.reset((20.0, 2.0))
        explorer.choose(0.0, grid, costmap, field, HERE)
        away = np.hypot(critic.asked[:, 0] - HERE.x, critic.asked[:, 1] - HERE.y)
        _, approach, _ = find_frontiers(costmap, field, 0.4, 3.0, costmap.radius)
        assert len(approach) == 2
        if look_ahead == 1.0:
            assert away == pytest.approx([1.0, 1.0], abs=0.15)
        else:
            np.testing.assert_array_equal(critic.asked, approach)


def test_a_known_goal_is_the_target():
    grid, costmap, field = view(two_doors())
    explorer = Explorer()
    explorer.reset((1.0, 1.0))
    target = explorer.choose(0.0, grid, costmap, field, HERE)
    assert target is not None
    assert target.is_goal
    assert target.point == (1.0, 1.0)


def test_hysteresis_keeps_a_choice_that_is_nearly_as_good():
    grid, costmap, field = view(two_doors())
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    first = explorer.choose(0.0, grid, costmap, field, HERE)
    # Seen from here both are about equally far on the way to this goal, the upper one a little better.
    explorer.goal = (5.0, 6.5)
    second = explorer.choose(10.0, grid, costmap, field, HERE)
    fresh = Explorer()
    fresh.reset((5.0, 6.5))
    unbiased = fresh.choose(0.0, grid, costmap, field, HERE)
    assert first is not None
    assert second is not None
    assert unbiased is not None
    assert unbiased.point != first.point
    assert second.point == first.point


def test_a_given_up_target_is_left_out_until_it_expires():
    grid, costmap, field = view(two_doors())
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    first = explorer.choose(0.0, grid, costmap, field, HERE)
    assert first is not None
    explorer.give_up(1.0)
    second = explorer.choose(2.0, grid, costmap, field, HERE)
    assert second is not None
    assert second.point[1] > 3.5
    explorer.target = None
    third = explorer.choose(1.0 + explorer.config.blacklist_time + 0.1, grid, costmap, field, HERE)
    assert third is not None
    assert third.point == first.point


def test_only_the_forgiving_try_again_when_all_are_given_up():
    grid, costmap, field = view(two_doors())
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    for k in range(2):
        assert explorer.choose(float(k), grid, costmap, field, HERE)
        explorer.give_up(float(k))
    assert explorer.choose(3.0, grid, costmap, field, HERE) is None
    assert explorer.choose(3.0, grid, costmap, field, HERE, forgiving=True) is not None


def test_the_four_triggers():
    picture = two_doors()
    grid, costmap, field = view(picture)
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    assert explorer.trigger(0.0, grid, (3.0, 2.0)) == "there is no target"
    target = explorer.choose(0.0, grid, costmap, field, HERE)
    assert target is not None
    assert explorer.trigger(0.1, grid, target.point) is None  # too soon
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) is None
    assert explorer.trigger(1.0, grid, target.approach) == "the exploration point was reached"
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) == "there is no target"  # there is nothing more to see
    explorer.target = target
    explorer._entropy -= 5000.0
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) == "the map changed a lot"
    explorer._entropy += 5000.0
    picture[15:25, 59] = "#"
    seen = as_grid(picture)
    assert explorer.trigger(1.0, seen, (3.0, 2.0)) == "the exploration point's state changed"
    explorer.goal = (1.0, 1.0)
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) == "the goal's state became known"


def test_without_frontiers_there_is_no_target():
    grid, costmap, field = view(hall(60, 40))
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    assert explorer.choose(0.0, grid, costmap, field, HERE) is None
