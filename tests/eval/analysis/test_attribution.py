"""The last avoidable moment, in halls where it can be worked out by hand, and ``vuca explain`` from end to end."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from eval.analysis.attribution import SURVIVED, config_of, last_avoidable_moment, trace
from eval.commands import explain as explain_command
from eval.episode import Episode, EpisodeConfig, run_episode
from eval.explain import explain_row, find_row
from eval.methods import MethodOptions
from tests.robots.halls import hall
from vuca_nav.cli import main
from vuca_nav.errors import BadArgument
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Pose2, VelocityCommand
from worlds import save_scene
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, World

TICKS = 30
NO_TELEMETRY = Telemetry()


def disc(radius, speed, *route, sighted=None):
    start = Pose2(route[0][0], route[0][1], 0.0)
    part = MoverPart(Cylinder(0.0, 0.0, radius, 1.7))
    return Mover("cylinder", (part,), radius, start, Patrol(speed, route), sighted)


def episode(tmp_path: Path, world: World) -> Episode:
    path = tmp_path / "scene.yaml"
    save_scene(world, path)
    return Episode(EpisodeConfig(world=str(path), method="dwa-dh"))


def standing_until_touched(episode):
    commands = []
    simulation = episode.simulation(NO_TELEMETRY)
    simulation.reset()
    while simulation.contact is None:
        commands.append(STOP)
        simulation.step(STOP)
    return commands


def crossing(sighted=None):
    """A disc of 0.2 m that comes from the left at 1 m/s to a robot that looks along +x."""
    return replace(
        hall(20.0, Pose2(10.0, 10.0, 0.0)), movers=(disc(0.2, 1.0, (10.0, 14.0), (10.0, 1.0), sighted=sighted),)
    )


def dead_end():
    """A corridor of 1.2 m with a disc of 0.5 m that comes at 1 m/s; the robot stands near its closed end."""
    walls = tuple(
        Obstacle("wall", box, outer=True)
        for box in (
            Box(6.0, 0.1, 12.0, 0.2, 0.0, 2.0),
            Box(6.0, 1.5, 12.0, 0.2, 0.0, 2.0),
            Box(0.1, 0.8, 0.2, 1.6, 0.0, 2.0),
        )
    )
    mover = disc(0.5, 1.0, (6.0, 0.8), (0.8, 0.8))
    return World("dead end", 0, (0.0, 0.0, 12.0, 1.6), walls, (mover,), Pose2(1.2, 0.8, 0.0), (10.0, 0.8))


def test_stepping_aside_takes_a_second_from_a_stand(tmp_path):
    """At 1 m/s^2 the base is 0.5 m further after 1 s: 0.465 m clears the disc, and half a second is not enough."""
    there = episode(tmp_path, crossing())
    commands = standing_until_touched(there)
    course, simulation = trace(there, commands, SURVIVED)
    assert simulation.contact_facts is not None
    asked = []
    found = last_avoidable_moment(there, course, lambda before, most: asked.append(before))
    assert (found.seconds, found.is_certain, asked) == (1.0, True, [0.5, 1.0])
    assert len(found.way) == TICKS * (1.0 + SURVIVED) + 1
    assert found.way[0, :2] == pytest.approx([10.0, 10.0], abs=0.01)


def test_where_nothing_helps_there_is_no_such_moment(tmp_path):
    there = episode(tmp_path, dead_end())
    course, _ = trace(there, standing_until_touched(there), SURVIVED)
    found = last_avoidable_moment(there, course)
    assert (found.seconds, len(found.way)) == (None, 0)


def test_commands_given_again_give_the_same_bits(tmp_path):
    there = episode(tmp_path, crossing())
    commands = [VelocityCommand(0.5, 0.0, 0.3)] * 60
    (first, _), (second, _) = trace(there, commands), trace(there, commands)
    assert (first.poses == second.poses).all()
    assert (first.part_poses == second.part_poses).all()
    assert len(first.poses) == len(first.part_poses) == 61


def test_a_row_gives_its_configuration_back():
    config = EpisodeConfig(
        "square", None, "go2", "ours", 4, movers=3, speed=0.5, sighted=0.2, start=(1.0, 2.0, 0.5), goal=(8.0, 5.0),
        without="A", options=MethodOptions(gamma=7.0),
    )  # fmt: skip
    assert config_of(json.loads(json.dumps(config.row()))) == config


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """A row of a collision that nothing could avoid, and the directory with its scene."""
    place = tmp_path_factory.mktemp("failed")
    return run_episode(episode(place, dead_end()).config).row(), place


def test_an_explained_collision(failed, capsys):
    row, place = failed
    assert row["outcome"] == "collision"
    explained = explain_row(row | {"duration": 99.0}, place / "explained")
    assert "cylinder_0" in explained.text
    assert "inevitable: no way was found that survives" in explained.text
    assert "the row, by other code or on another machine, has duration 99.0" in explained.text
    assert explained.row["t_inevitable"] is None
    assert [explained.row[key] for key in ("contact", "duration")] == [row[key] for key in ("contact", "duration")]
    assert Path(explained.row["picture"]).read_bytes().startswith(b"\x89PNG")
    assert Path(explained.row["recording"]).stat().st_size > 1000
    assert "searching a way from 0.5 s before" in capsys.readouterr().err


def test_all_collisions_of_an_evaluation(failed, tmp_path, capsys):
    row, _ = failed
    folder = rows_in(tmp_path / "ev", row | {"outcome": "success", "seed": 7}, row)
    assert explain_command([str(folder), "--all", "--json"]) == 0
    told = capsys.readouterr().out.splitlines()
    (moment,) = json.loads(told[-1])["moments"]
    assert (moment["seed"], moment["t_inevitable"], moment["is_repeated"]) == (row["seed"], None, True)
    assert moment["contact"] == row["contact"]
    assert told[-2].endswith("| 1 | 0 | 0 | 0 | 0 | 0 | 0 | 0 | 1 | 0 | 0 |")
    file = folder / "explained" / "moments.jsonl"
    assert json.loads(file.read_text().splitlines()[0])["measurement"] == "moments"
    file.write_text(file.read_text().replace('"t_inevitable": null', '"t_inevitable": 1.5'))
    assert explain_command([str(folder), "--all"]) == 0  # what is known is not searched again
    assert capsys.readouterr().out.splitlines()[-1].endswith("| 1 | 0 | 0 | 1 | 0 | 0 | 0 | 0 | 0 | 0 | 0 |")
    with pytest.raises(BadArgument, match="leave SEED out"):
        explain_command([str(folder), "7", "--all"])


def row(seed, outcome="collision", **changes):
    return EpisodeConfig(seed=seed, **changes).row() | {"outcome": outcome}


def rows_in(folder, *rows):
    folder.mkdir(exist_ok=True)
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(r)}\n" for r in rows) + '{"torn')
    return folder


def test_a_row_is_found_by_its_seed_and_what_tells_it_from_others(tmp_path):
    folder = rows_in(tmp_path / "a", row(1, region=1), row(1, region=2), row(2, "success"), row(3, "timeout"))
    assert find_row(folder, 3, {})["outcome"] == "timeout"
    assert find_row(folder, 1, {"region": 2})["region"] == 2
    for seed, filters, text in (
        (1, {}, r"has 2 such episodes; choose by region \(1, 2\)"),
        (1, {"region": 4}, "has no episode of region 4 with seed 1"),
        (2, {}, "seed 2 arrived, there is nothing to explain; failed there: 1, 3"),
        (9, {}, "has no seed 9; failed there: 1, 3"),
        (None, {}, "has 4 such episodes; choose by"),
    ):
        with pytest.raises(BadArgument, match=text):
            find_row(folder, seed, filters)
    with pytest.raises(BadArgument, match="cannot be read: No such file"):
        find_row(tmp_path / "b", 1, {})


def test_damaged_rows_are_refused_or_passed_over(tmp_path):
    whole = json.dumps(row(1))
    for field, value in (("seed", [1]), ("start", [1.0]), ("gamma", "x"), ("no_shield", 5), ("world", None)):
        folder = rows_in(tmp_path / field, row(1) | {field: value})
        with pytest.raises(BadArgument, match=f"line 1: {field} is .*, expected"):
            find_row(folder, None, {})
    file = tmp_path / "rows.jsonl"
    file.write_text('{"a":' * 100_000 + f"\n{whole}\n{whole[:40]}")
    assert find_row(file, None, {})["seed"] == 1
    assert config_of(row(1) | {"options": {"gamma": 1.0}}) == config_of(row(1))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(BadArgument, match="is a pipe"):
        find_row(pipe, None, {})


def test_a_row_runs_python_of_its_own_only_when_trusted(tmp_path, capsys):
    folder = rows_in(tmp_path / "a", row(1) | {"method": "nowhere:build"})
    assert main(["explain", str(folder)]) == 2
    assert "add --trust" in capsys.readouterr().err
    assert main(["explain", str(folder), "--trust"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_the_output_of_a_single_run_is_a_source(tmp_path):
    file = tmp_path / "row.txt"
    file.write_text(f"a table\n  of text\n{json.dumps(row(5))}\n")
    assert find_row(file, None, {})["seed"] == 5
    file.write_text("nothing\n")
    with pytest.raises(BadArgument, match="has no rows of episodes"):
        find_row(file, None, {})
