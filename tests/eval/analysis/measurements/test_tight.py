"""Doors and goals with little room: the worlds are as they say, and the table counts."""

import numpy as np
import pytest

from eval.analysis.measurements.tight import DOORS, TightArguments, door, goal_beside, main, table, worlds
from eval.tasks.reading import read_tasks
from vuca_nav.errors import BadArgument, BadWorld
from worlds.checks import check_task
from worlds.world import Box

SQUARE = np.array([(0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)])
"""A body 0.6 m wide: by the rule it passes 0.7 m."""


def test_the_doors_are_as_wide_as_they_say():
    for width in DOORS:
        for layout in range(3):
            world = door(width, layout)
            parts = [each.shape for each in world.obstacles if isinstance(each.shape, Box) and each.shape.x == 6.0][2:]
            low, high = sorted(parts, key=lambda part: part.y)
            assert (high.y - 0.5 * high.width) - (low.y + 0.5 * low.width) == pytest.approx(width)
    assert check_task(door(0.75, 0), SQUARE) > 6.5
    with pytest.raises(BadWorld, match=r"0\.70 m wide"):
        check_task(door(0.65, 0), SQUARE)


@pytest.mark.parametrize("away", [0.3, 0.5])
def test_the_goals_are_as_far_from_things_as_they_say(away):
    x, _ = goal_beside("wall", away, 0).goal
    assert 11.8 - x == pytest.approx(away)
    x, y = goal_beside("corner", away, 0).goal
    assert (11.8 - x, 7.8 - y) == (pytest.approx(away), pytest.approx(away))
    world = goal_beside("pillar", away, 0)
    pillar = world.obstacles[-1].shape
    assert np.hypot(world.goal[0] - pillar.x, world.goal[1] - pillar.y) - 0.3 == pytest.approx(away)


def test_the_tasks_can_be_read_and_the_table_counts(tmp_path):
    main(TightArguments(tmp_path))
    tasks = read_tasks(tmp_path / "tasks.yaml")
    assert [task.name for task in tasks] == [world.name for world in worlds()]
    outcomes = ["success", "success", "collision", "refused"]
    rows = [
        {"task": f"door-0.60-{k}", "robot": "go2", "method": "ours-dh", "outcome": outcome}
        for k, outcome in enumerate(outcomes)
    ]
    text = table([*rows, {"task": "wall-0.30-0", "robot": "go2", "method": "ours-dh", "outcome": "refused"}])
    assert "| door | 0.60 | 2 of 3 [21-94%], 1 touched |" in text
    assert text.endswith("| wall | 0.30 | refused |\n")


def test_other_results_are_refused(tmp_path):
    (tmp_path / "episodes.jsonl").write_text("")
    with pytest.raises(BadArgument, match=r"not an evaluation of the tasks|has no"):
        main(TightArguments(tmp_path / "table.md", of=tmp_path))
