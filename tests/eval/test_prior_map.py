from eval.prior_map import rasterise
from vuca_nav.types import Pose2
from worlds.world import Box, Cylinder, Obstacle, World


def test_obstacles_are_occupied_free_floor_is_free_and_beyond_is_unknown():
    obstacles = (
        Obstacle("wall", Box(5.0, 2.0, 2.0, 0.2, 0.0, 2.0)),
        Obstacle("pillar", Cylinder(2.0, 4.0, 0.3, 2.0)),
        Obstacle("low", Box(8.0, 4.0, 0.4, 0.4, 0.785398, 0.05)),
    )
    grid = rasterise(World("w", 0, (0.0, 0.0, 10.0, 6.0), obstacles, (), Pose2(1.0, 1.0, 0.0), (9.0, 1.0)))
    for x, y in ((4.02, 2.0), (5.98, 2.0), (5.0, 2.08), (2.28, 4.0), (2.0, 3.72), (8.0, 4.26), (8.0, 4.0)):
        assert grid.state(x, y) == 1, (x, y)
    for x, y in ((3.9, 2.0), (6.1, 2.0), (5.0, 2.2), (2.4, 4.0), (8.2, 4.2), (1.0, 1.0), (9.0, 1.0)):
        assert grid.state(x, y) == -1, (x, y)
    for x, y in ((-0.5, 3.0), (10.5, 3.0), (5.0, 6.5)):
        assert grid.state(x, y) == 0, (x, y)


def test_what_hangs_above_the_robot_is_left_out():
    beams = tuple(Obstacle("wall", Box(x, 3.0, 0.2, 6.0, 0.0, 0.3, base=base)) for x, base in ((3.0, 1.0), (6.0, 2.1)))
    grid = rasterise(World("w", 0, (0.0, 0.0, 10.0, 6.0), beams, (), Pose2(1.0, 1.0, 0.0), (9.0, 1.0)), 1.262)
    assert grid.state(3.0, 3.0) == 1
    assert grid.state(6.0, 3.0) == -1
