"""Missions through a door that the body and a little room fit through."""

import pytest

from eval.episode import EpisodeConfig, run_episode
from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds import save_scene
from worlds.world import Box, Obstacle, World


def room_with_door(width: float) -> World:
    """A room of 12 x 8 m with a wall of 0.15 m across it, and a door in its middle."""
    side = 0.5 * (8.0 - width)
    boxes = [(6.0, 0.1, 12.0, 0.2), (6.0, 7.9, 12.0, 0.2), (0.1, 4.0, 0.2, 8.0), (11.9, 4.0, 0.2, 8.0)]
    boxes += [(6.0, 0.5 * side, 0.15, side), (6.0, 8.0 - 0.5 * side, 0.15, side)]
    walls = tuple(Obstacle("wall", Box(*box, 0.0, 2.0)) for box in boxes)
    return World("door", 0, (0.0, 0.0, 12.0, 8.0), walls, (), Pose2(3.0, 3.0, 0.0), (10.0, 4.0))


def test_tiago_passes_a_door_of_0_75_m(tmp_path):
    path = str(tmp_path / "door.yaml")
    save_scene(room_with_door(0.75), path)
    row = run_episode(EpisodeConfig(world=path, method="ours-dh", robot="tiago")).row()
    assert row["outcome"] == "success"
    assert row["duration"] < 40.0


@pytest.mark.parametrize(("robot", "width", "rule"), [("tiago", 0.6, "0.67"), ("go2", 0.4, "0.4[89]")])
def test_a_door_narrower_than_the_rule_is_refused_with_its_place_and_width(tmp_path, robot, width, rule):
    path = str(tmp_path / "door.yaml")
    save_scene(room_with_door(width), path)
    said = rf"door.yaml: goal: no way leads .* {rule} m wide, .*: the widest is {width:.2f} m wide at \(\S+, 4.0\d\)"
    with pytest.raises(BadWorld, match=said):
        run_episode(EpisodeConfig(world=path, method="ours-dh", robot=robot))


@pytest.mark.parametrize(
    ("robot", "method", "goal"),
    [
        ("tiago", "ours-dh", (11.4, 5.0)),
        ("tiago", "dwa-dh", (11.5, 7.5)),  # 0.3 m from both walls of a corner
        ("go2", "ours-dh", (11.5, 5.0)),
        ("go2", "dwa-dh", (11.45, 7.45)),
    ],
)
def test_a_goal_beside_a_wall_or_in_a_corner_is_reached(tmp_path, robot, method, goal):
    path = str(tmp_path / "room.yaml")
    save_scene(room_with_door(1.5), path)
    row = run_episode(EpisodeConfig(world=path, goal=goal, method=method, robot=robot)).row()
    assert row["outcome"] == "success"
    assert row["duration"] < 60.0
