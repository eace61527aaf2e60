"""The plan stage, and what a plan does when the map moves."""

import numpy as np
import pytest

from tests.vuca_nav.planning.test_planning import DISC, as_grid, hall
from vuca_nav.geometry import inverse, transform_points
from vuca_nav.planning.costmap import CostmapConfig
from vuca_nav.planning.planner import Planner, no_plan
from vuca_nav.planning.survey import Survey
from vuca_nav.planning.target import Target
from vuca_nav.planning.waypoints import farthest_free_waypoint
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import Pose2

HERE = Pose2(1.5, 1.0, 0.4)
TARGET = Target((4.6, 1.0), (4.5, 1.0), is_goal=False)
NONE_MOVES = np.empty((0, 3))


class Told(Telemetry):
    def __init__(self):
        self.said: list[tuple] = []

    def path(self, points_in_map):
        self.said.append(("path", len(points_in_map)))

    def waypoint(self, point_in_map):
        self.said.append(("waypoint", tuple(point_in_map)))

    def event(self, text, level="INFO"):
        self.said.append((level, text))


def survey_of(picture, moving=NONE_MOVES) -> Survey:
    return Survey(as_grid(picture), DISC, HERE, moving, CostmapConfig())


def walled() -> np.ndarray:
    picture = hall(60, 40)
    picture[10:39, 30] = "#"  # a wall from below, open at the top
    return picture


def test_a_plan_is_the_path_to_the_target_and_the_farthest_waypoint_in_sight():
    told, paths = Told(), survey_of(walled()).paths()
    plan = Planner(told).update(TARGET, paths, no_plan(HERE))
    np.testing.assert_array_equal(plan.path_in_map, paths.path_to(4.5, 1.0))
    assert plan.waypoint_in_map == farthest_free_waypoint(paths.costmap, plan.path_in_map, (HERE.x, HERE.y))
    assert plan.waypoint_in_map[1] > 2.0  # round the wall's end
    assert told.said == [("path", len(plan.path_in_map)), ("waypoint", plan.waypoint_in_map)]


def test_a_plan_is_kept_where_nothing_can_be_reached():
    paths = survey_of(walled()).paths()
    plan = Planner().update(TARGET, paths, no_plan(HERE))
    told = Told()
    assert Planner(told).update(None, paths, plan) is plan
    assert told.said[0] == ("WARN", "nothing can be reached: keeping the last path")
    assert told.said[1:] == [("path", len(plan.path_in_map)), ("waypoint", plan.waypoint_in_map)]


def test_before_there_is_a_plan_the_robot_is_where_it_should_be():
    plan = no_plan(HERE)
    assert plan.path_in_map.shape == (0, 2)
    assert plan.waypoint_in_map == (HERE.x, HERE.y)


def test_a_plan_moves_along_with_the_map():
    plan = Planner().update(TARGET, survey_of(walled()).paths(), no_plan(HERE))
    correction = Pose2(0.5, -1.0, 0.8)
    moved = plan.moved(correction)
    assert moved.path_in_map == pytest.approx(transform_points(correction, plan.path_in_map))
    assert moved.waypoint_in_map == pytest.approx(transform_points(correction, np.array([plan.waypoint_in_map]))[0])
    assert isinstance(moved.waypoint_in_map, tuple)
    back = moved.moved(inverse(correction))
    assert back.path_in_map == pytest.approx(plan.path_in_map)
    assert back.waypoint_in_map == pytest.approx(plan.waypoint_in_map)
    assert no_plan(HERE).moved(correction).path_in_map.shape == (0, 2)


def test_only_the_goal_itself_is_a_final_waypoint_and_stays_one_when_the_map_moves():
    open_hall = survey_of(hall(60, 40)).paths()
    goal = Target((4.5, 1.0), (4.5, 1.0), is_goal=True)
    plan = Planner().update(goal, open_hall, no_plan(HERE))
    assert plan.waypoint_in_map == (4.5, 1.0)
    assert plan.is_final
    assert plan.moved(Pose2(0.1, 0.0, 0.0)).is_final
    assert not Planner().update(TARGET, open_hall, plan).is_final  # a frontier
    assert not Planner().update(goal, survey_of(walled()).paths(), plan).is_final  # round the wall first


def test_a_survey_works_out_its_paths_once():
    survey = survey_of(walled())
    assert survey.paths() is survey.paths(doubting=False)
    assert survey.paths(doubting=True) is survey.paths(doubting=True)
    assert survey.paths() is not survey.paths(doubting=True)
    assert survey.paths().start == (HERE.x, HERE.y)


def test_a_survey_knows_that_movers_bar_no_way():
    picture = hall(60, 40)
    picture[:, 30] = "#"
    picture[14:26, 30] = "."  # a passage 1.2 m wide ...
    picture[19:21, 30] = "#"  # ... with a mover in it
    assert not survey_of(picture).paths().reaches(4.5, 2.0)
    assert survey_of(picture, np.array([[3.05, 2.0, 0.1]])).paths().reaches(4.5, 2.0)


def test_no_path_leads_through_a_barred_place():
    picture = hall(60, 40)
    picture[:, 30] = "#"
    picture[5:17, 30] = picture[25:37, 30] = "."  # two doors
    doors = np.array([[3.05, 1.1, 0.7], [3.05, 3.1, 0.7]])

    def paths(barred):
        return Survey(as_grid(picture), DISC, HERE, NONE_MOVES, CostmapConfig(), barred).paths()

    through = [paths(doors[k : k + 1]).path_to(4.5, 1.0) for k in (0, 1)]
    assert [bool((path[np.abs(path[:, 0] - 3.05) < 0.1, 1] > 2.0).all()) for path in through] == [True, False]
    assert not paths(doors).reaches(4.5, 1.0)
