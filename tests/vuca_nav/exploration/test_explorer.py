from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.planning.test_planning import DISC, as_grid, hall
from tests.vuca_nav.rooms import LIDAR, NOTHING, REST
from vuca_nav.exploration.explorer import Explorer, ExplorerConfig, Target
from vuca_nav.exploration.frontiers import find_frontiers
from vuca_nav.exploration.heuristic import Critic, NoCritic, score_candidates
from vuca_nav.geometry import transform_points
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import Perception
from vuca_nav.planning.costmap import Costmap, CostmapConfig
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.survey import Survey
from vuca_nav.telemetry.interface import FrontierView, Telemetry
from vuca_nav.types import STANDING, Odometry, Pose2, Scan

HERE = Pose2(3.0, 2.0, 0.0)


def two_doors() -> np.ndarray:
    """A 6 x 4 m hall known but for what lies behind openings in its right and its upper wall."""
    picture = hall(60, 40)
    picture[15:25, 59] = " "  # right, 1 m wide, centred at y = 2.0
    picture[0, 10:20] = " "  # upper, centred at x = 1.5
    return picture


def percept_at(stamp: float) -> Percept:
    return Perception(LIDAR).update(Scan(stamp, NOTHING), Odometry(stamp, STANDING, REST))


def survey_of(picture: np.ndarray) -> Survey:
    return Survey(as_grid(picture), DISC, HERE, np.empty((0, 3)), CostmapConfig())


def choose(explorer: Explorer, now: float, survey: Survey) -> Target | None:
    """A decision because it is time."""
    return explorer.update("it is time", percept_at(now), survey).target


def view(picture: np.ndarray, robot=(3.0, 2.0)):
    grid = as_grid(picture)
    costmap = Costmap(grid, DISC, robot, CostmapConfig())
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
    survey = survey_of(picture)
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    target = choose(explorer, 0.0, survey)
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


@pytest.mark.parametrize("score", ["metres", "normalised"])
def test_heuristic_of_equals_is_zero(score):
    scores = score_candidates(np.array([3.0, 3.0]), np.array([1.0, 1.0]), gamma=1.0, score=score)
    np.testing.assert_array_equal(scores.total, [0.0, 0.0])


def test_the_printed_heuristic_divides_each_term_by_its_spread():
    scores = score_candidates(np.array([10.0, 14.0, 12.0]), np.array([0.5, 0.9, 0.8]), 2.0, "normalised")
    np.testing.assert_allclose(scores.goal_term, [0.0, 1.0, 0.5])
    np.testing.assert_allclose(scores.safety_term, [2.0, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(scores.total, [2.0, 1.0, 1.0])


class Decisions(Telemetry):
    def __init__(self):
        self.views: list[FrontierView] = []

    def frontiers(self, view: FrontierView) -> None:
        self.views.append(view)


def test_the_goal_heuristic_chooses_the_opening_towards_the_goal():
    survey = survey_of(two_doors())
    for goal, expected in (((20.0, 2.0), (5.85, 2.0)), ((1.5, 20.0), (1.5, 3.85))):
        told = Decisions()
        explorer = Explorer(telemetry=told)
        explorer.reset(goal)
        target = choose(explorer, 0.0, survey)
        assert target is not None
        assert target.point == pytest.approx(expected, abs=0.25)
        assert not target.is_goal
        assert told.views[0].chosen == int(np.argmin(told.views[0].score))


class FearsRight(Critic):
    """Gives what leads to the right a chance, and all else certainty."""

    def __init__(self, chance: float = 0.5):
        self.chance, self.asked = chance, np.empty((0, 2))

    def values(self, points_in_map, percept, map_from_base):
        self.asked, self.percept, self.map_from_base = points_in_map, percept, map_from_base
        return np.where(points_in_map[:, 0] > 3.5, self.chance, 1.0)


def test_a_critic_with_gamma_can_overrule_it():
    survey = survey_of(two_doors())
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
        target = choose(explorer, 0.0, survey)
        assert target is not None
        assert target.point[1] == pytest.approx(expected_y, abs=0.25)


def test_where_nothing_is_seen_to_move_the_critic_has_no_say():
    survey = survey_of(two_doors())
    still = percept_at(0.0)
    stirred = replace(still, moving=np.array([[2.0, 0.0, 0.3]]))
    for percept, movers_only, expected_y in (
        (still, True, 2.0),
        (stirred, True, 3.85),
        (still, False, 3.85),
    ):
        explorer = Explorer(ExplorerConfig(gamma=30.0, movers_only=movers_only), FearsRight())
        explorer.reset((20.0, 2.0))
        target = explorer.update("it is time", percept, survey).target
        assert target is not None
        assert target.point[1] == pytest.approx(expected_y, abs=0.25)


def test_the_critic_is_asked_where_the_ways_lead_first():
    survey = survey_of(two_doors())
    for look_ahead in (1.0, 50.0):
        critic = FearsRight()
        explorer = Explorer(ExplorerConfig(gamma=1.0, look_ahead=look_ahead), critic)
        explorer.reset((20.0, 2.0))
        choose(explorer, 0.0, survey)
        away = np.hypot(critic.asked[:, 0] - HERE.x, critic.asked[:, 1] - HERE.y)
        paths = survey.paths()
        _, approach, _ = find_frontiers(paths.costmap, paths, 0.4, 3.0, 0.3)
        assert critic.map_from_base == HERE
        assert critic.percept.stamp == 0.0
        assert len(approach) == 2
        if look_ahead == 1.0:
            assert away == pytest.approx([1.0, 1.0], abs=0.15)
        else:
            np.testing.assert_array_equal(critic.asked, approach)


class Values(Critic):
    """Gives the candidates, from the upper one on, these values."""

    def __init__(self, *values: float):
        self._values, self.asked = np.array(values), np.empty((0, 2))

    def values(self, points_in_map, percept, map_from_base):
        self.asked = points_in_map
        return self._values[np.argsort(np.argsort(-points_in_map[:, 1]))]


def test_the_papers_choice_by_hand():
    """Of two candidates each term is 0 for one and 1 for the other: gamma alone decides, whatever the values' unit."""
    survey, told = survey_of(two_doors()), Decisions()
    for gamma, expected_y in ((0.9, 2.0), (1.1, 3.85)):
        critic = Values(-3.0, -3.001)
        explorer = Explorer(
            ExplorerConfig(score="normalised", gamma=gamma, hysteresis=0.0, look_ahead=None), critic, told
        )
        explorer.reset((20.0, 2.0))
        target = choose(explorer, 0.0, survey)
        assert target is not None
        assert target.point[1] == pytest.approx(expected_y, abs=0.25)
        view = told.views[-1]
        np.testing.assert_array_equal(critic.asked, view.points_in_map)  # the candidates themselves, as O_g
        upper = int(np.argmax(view.points_in_map[:, 1]))
        assert view.score[upper] == pytest.approx(1.0)
        assert view.score[1 - upper] == pytest.approx(gamma)


def test_a_known_goal_is_the_target():
    survey = survey_of(two_doors())
    explorer = Explorer()
    explorer.reset((1.0, 1.0))
    target = choose(explorer, 0.0, survey)
    assert target is not None
    assert target.is_goal
    assert target.point == (1.0, 1.0)


def test_hysteresis_keeps_a_choice_that_is_nearly_as_good():
    survey = survey_of(two_doors())
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    first = choose(explorer, 0.0, survey)
    # Seen from here both are about equally far on the way to this goal, the upper one a little better.
    explorer.goal = (5.0, 6.5)
    second = choose(explorer, 10.0, survey)
    fresh = Explorer()
    fresh.reset((5.0, 6.5))
    unbiased = choose(fresh, 0.0, survey)
    assert first is not None
    assert second is not None
    assert unbiased is not None
    assert unbiased.point != first.point
    assert second.point == first.point


def with_a_corner() -> np.ndarray:
    """The hall, and in its upper right corner an unknown one that leads nowhere: walls stand around it."""
    picture = two_doors()
    picture[0, 10:20] = "#"  # no upper door
    picture[1:12, 48:59] = " "
    picture[12, 48:59] = "#"
    return picture


@pytest.mark.parametrize(("unknown", "expected"), [(None, (4.75, 3.35)), (4.0, (5.85, 2.0))])
def test_what_cannot_lead_to_the_goal_is_no_candidate(unknown, expected):
    survey, told = survey_of(with_a_corner()), Decisions()
    explorer = Explorer(ExplorerConfig(unknown=unknown), telemetry=told)
    explorer.reset((8.0, 5.0))
    target = choose(explorer, 0.0, survey)
    assert target is not None
    assert target.point == pytest.approx(expected, abs=0.3)


def test_what_cannot_lead_to_the_goal_is_looked_into_when_nothing_else_is_left():
    picture = with_a_corner()
    picture[15:25, 59] = "#"
    explorer = Explorer()
    explorer.reset((8.0, 5.0))
    target = choose(explorer, 0.0, survey_of(picture))
    assert target is not None
    assert target.point == pytest.approx((4.75, 3.35), abs=0.3)


def test_a_given_up_target_is_left_out_until_it_expires():
    survey = survey_of(two_doors())
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    first = choose(explorer, 0.0, survey)
    assert first is not None
    explorer.give_up(1.0)
    second = choose(explorer, 2.0, survey)
    assert second is not None
    assert second.point[1] > 3.5
    explorer.target = None
    third = choose(explorer, 1.0 + explorer.config.blacklist_time + 0.1, survey)
    assert third is not None
    assert third.point == first.point


class Asked(Survey):
    """Keeps how paths were asked for."""

    def __init__(self, picture: np.ndarray):
        super().__init__(as_grid(picture), DISC, HERE, np.empty((0, 3)), CostmapConfig())
        self.doubts: list[bool] = []

    def paths(self, *, doubting: bool = False, squeezing: bool = False) -> PathField:
        self.doubts.append(doubting)
        return super().paths(doubting=doubting, squeezing=squeezing)


def test_what_was_given_up_is_tried_again_when_nothing_else_is_left():
    survey, explorer = Asked(two_doors()), Explorer()
    explorer.reset((20.0, 2.0))
    given_up = []
    for k in range(2):
        target = choose(explorer, float(k), survey)
        assert target is not None
        given_up.append(target.point)
        explorer.give_up(float(k))
    assert len(set(given_up)) == 2
    assert not any(survey.doubts)
    again = choose(explorer, 3.0, survey)
    assert again is not None
    assert again.point == given_up[0]
    assert any(survey.doubts)  # what has not been seen lately was doubted first
    explorer.give_up(4.0)  # the other one was forgiven, too
    other = choose(explorer, 5.0, survey)
    assert other is not None
    assert other.point == given_up[1]


def test_a_cell_too_much_in_a_door_does_not_turn_it_back():
    """The only door leaves the body a little, then by one noisy return a little too little."""
    explorer = Explorer()
    explorer.reset((5.0, 2.0))
    picture = hall(60, 40)
    picture[:, 40] = "#"
    picture[17:24, 40] = "."
    target = choose(explorer, 0.0, survey_of(picture))
    assert target is not None
    assert target.is_goal
    picture[17, 40] = "#"
    narrower = survey_of(picture)
    assert not narrower.paths().reaches(*target.approach)
    later = explorer.update(None, percept_at(10.0), narrower)
    assert later.target is target
    assert later.paths.reaches(*target.approach)
    picture[18:20, 40] = "#"
    assert not survey_of(picture).paths(squeezing=True).reaches(*target.approach)


def test_without_a_cause_a_target_that_can_be_reached_stays():
    told, survey, explorer = Decisions(), survey_of(two_doors()), Explorer()
    explorer.telemetry = told
    explorer.reset((20.0, 2.0))
    first = explorer.update(None, percept_at(0.0), survey)  # there is none yet: that is a cause
    explorer.goal = (1.5, 20.0)
    later = explorer.update(None, percept_at(10.0), survey)
    assert later.target is first.target is explorer.target
    assert later.target is not None
    assert later.target == first.target
    assert later.paths.reaches(*later.target.approach)
    assert len(told.views) == 1
    # Now a wall bars the way to it.
    picture = two_doors()
    picture[1:39, 50] = "#"
    barred = explorer.update(None, percept_at(11.0), survey_of(picture)).target
    assert barred is not None
    assert barred.point[1] > 3.5
    assert len(told.views) == 2


def test_the_four_triggers():
    picture = two_doors()
    survey, grid = survey_of(picture), as_grid(picture)
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    assert explorer.trigger(0.0, grid, (3.0, 2.0)) == "there is no target"
    target = choose(explorer, 0.0, survey)
    assert target is not None
    assert explorer.trigger(0.1, grid, target.point) is None  # too soon
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) is None
    assert explorer.trigger(1.0, grid, target.approach) == "the exploration point was reached"
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) == "there is no target"  # there is nothing more to see
    explorer.target = target
    picture[15:25, 59] = "#"
    seen = as_grid(picture)
    assert explorer.trigger(1.0, seen, (3.0, 2.0)) == "the exploration point's state changed"
    explorer.goal = (1.0, 1.0)
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) == "the goal's state became known"


@pytest.mark.parametrize(("share", "cause"), [(0.9, "the map changed a lot"), (1.1, None)])
def test_a_map_that_changed_a_lot_is_a_trigger(share, cause):
    """Behind the door, out of its reach, there is a second hall now."""
    picture = two_doors()
    grid, more = as_grid(picture), as_grid(np.hstack([picture, np.full((40, 2), " "), hall(60, 40)]))
    change = abs(more.entropy - grid.entropy)
    explorer = Explorer(ExplorerConfig(entropy_change=share * change))
    explorer.reset((50.0, 2.0))
    assert choose(explorer, 0.0, survey_of(picture)) is not None
    assert explorer.trigger(1.0, grid, (3.0, 2.0)) is None
    assert explorer.trigger(1.0, more, (3.0, 2.0)) == cause
    assert change > 10.0


def test_without_frontiers_there_is_no_target():
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    exploration = explorer.update("it is time", percept_at(0.0), survey_of(hall(60, 40)))
    assert exploration.target is None
    assert exploration.target is None
    assert explorer.target is None


RIGHT, UPPER = (5.85, 2.0), (1.5, 3.85)
CORRECTION = Pose2(0.4, -0.3, 0.2)


def test_the_target_follows_the_map():
    explorer = Explorer()
    explorer.reset((20.0, 2.0))
    before = choose(explorer, 0.0, survey_of(two_doors()))
    assert before is not None
    explorer.follow(CORRECTION)
    after = explorer.target
    assert after is not None
    assert not after.is_goal
    expected = transform_points(CORRECTION, np.array([before.point, before.approach]))
    assert np.array([after.point, after.approach]) == pytest.approx(expected)
    assert explorer.goal == (20.0, 2.0)


def test_the_goal_is_a_place_of_the_map_and_stays():
    explorer = Explorer()
    explorer.reset((1.0, 1.0))
    goal = choose(explorer, 0.0, survey_of(two_doors()))
    explorer.follow(CORRECTION)
    assert explorer.target == goal
    assert explorer.goal == (1.0, 1.0)


def test_what_was_given_up_follows_the_map():
    """The right door is given up; then the map moves so that what was there is where the upper door is."""
    survey, explorer = survey_of(two_doors()), Explorer()
    explorer.reset((20.0, 2.0))
    first = choose(explorer, 0.0, survey)
    assert first is not None
    assert first.point == pytest.approx(RIGHT, abs=0.25)
    explorer.give_up(1.0)
    explorer.follow(Pose2(UPPER[0] - RIGHT[0], UPPER[1] - RIGHT[1], 0.0))
    explorer.goal = (1.5, 20.0)  # it would take the upper one
    second = choose(explorer, 2.0, survey)
    assert second is not None
    assert second.point == first.point
    # Until it expires.
    explorer.give_up(3.0)
    third = choose(explorer, 1.0 + explorer.config.blacklist_time + 0.1, survey)
    assert third is not None
    assert third.point == pytest.approx(UPPER, abs=0.25)


def test_a_place_stands_for_a_goal_beside_a_wall():
    explorer = Explorer(ExplorerConfig())
    goal = (0.22, 2.0)  # 0.12 m from the wall; the body's radius is 0.3 m
    explorer.reset(goal, 0.2)
    target = choose(explorer, 0.0, survey_of(hall(60, 40)))
    assert target is not None
    assert target.is_goal
    assert target.point == goal
    assert np.hypot(target.approach[0] - goal[0], target.approach[1] - goal[1]) <= 0.2
    explorer.reset(goal, 0.05)
    target = choose(explorer, 0.0, survey_of(hall(60, 40)))
    assert target is None or not target.is_goal
