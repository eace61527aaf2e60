import numpy as np
import pytest

from tests.vuca_nav.planning.test_planning import DISC, as_grid, hall
from vuca_nav.exploration.remaining import RemainingWay
from vuca_nav.planning.costmap import Costmap, CostmapConfig


def lengths(picture: np.ndarray, goal: tuple[float, float], unknown: float, *points: tuple[float, float]):
    costmap = Costmap(as_grid(picture), DISC, (1.0, 1.0), CostmapConfig())
    return RemainingWay(costmap, goal, unknown).lengths(np.array(points))


def test_a_way_through_the_free_is_its_length():
    assert lengths(hall(60, 40), (5.1, 1.1), 3.0, (1.1, 1.1)) == pytest.approx([4.0])


def test_a_way_leads_around_what_stands_in_it():
    picture = hall(60, 40)
    picture[10:, 30] = "#"  # from the lower wall up to y = 3.0
    (around,) = lengths(picture, (5.1, 1.1), 1.0, (1.1, 1.1))
    straight = 2.0 * np.hypot(2.0, 3.3 - 1.1)  # over the wall's end, 0.3 m from it
    assert straight - 0.3 < around < 1.1 * straight + 0.3


@pytest.mark.parametrize("unknown", [1.0, 4.0])
def test_a_metre_of_the_unknown_counts_more_near_what_stands_there(unknown):
    picture = hall(60, 40)
    picture[15:25, 59] = "."  # a door
    for goal_x, near, far in ((8.1, 2.1, 0.0), (30.1, 3.0, 21.1)):
        (length,) = lengths(picture, (goal_x, 2.1), unknown, (5.1, 2.1))
        assert length == pytest.approx(0.9 + unknown * near + far, abs=0.4 * unknown)


def test_a_gap_narrower_than_the_body_is_none():
    for wide, leads in ((4, False), (8, True)):
        picture = hall(60, 40)
        picture[16 : 16 + wide, 59] = "."
        assert np.isfinite(lengths(picture, (8.1, 2.1), 1.0, (5.1, 2.1)))[0] == leads


def test_a_goal_beside_a_wall_can_be_reached():
    assert lengths(hall(60, 40), (0.3, 2.1), 1.0, (4.3, 2.1)) == pytest.approx([4.0], abs=0.1)
