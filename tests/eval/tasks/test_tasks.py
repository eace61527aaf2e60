"""Tasks apart from worlds: files and folders of them, BARN's score by hand, refused tasks as rows."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image

from eval.analysis.summary import by_driver, is_result, statistics_of, table
from eval.commands import eval_
from eval.episode import Episode, EpisodeConfig
from eval.suites import Task, choose, episodes_of, turn_dials
from eval.tasks.job import barn_score, files_of, job_of, suite_of
from eval.tasks.reading import read_tasks
from tests.shared_data import data
from vuca_nav.errors import BadWorld
from worlds.world import Keyframes

BARN = {"start": [-2.25, 3.0, 1.57], "goal": [-2.25, 6.0], "cylinders": [[-0.5, 4.0, 0.1, 1.0]]}


@pytest.fixture
def folder(tmp_path):
    """A folder with a map of a room and two worlds of BARN, one of them also as SDF."""
    pixels = np.full((40, 60), 254, np.uint8)
    pixels[:, 30] = 0
    pixels[18:28, 30] = 254  # a door of 1 m
    (tmp_path / "maps").mkdir()
    Image.fromarray(pixels).save(tmp_path / "maps" / "room.png")
    fields = {"image": "room.png", "resolution": 0.1, "origin": [0, 0, 0], "negate": 0}
    (tmp_path / "maps" / "room.yaml").write_text(yaml.safe_dump(fields))
    (tmp_path / "world_1.json").write_text(json.dumps(BARN | {"optimal_path_length_m": 4.0}))
    (tmp_path / "world_2.json").write_text(json.dumps(BARN))
    (tmp_path / "world_2.world").write_text("<sdf/>")
    (tmp_path / "notes.json").write_text("{}")
    (tmp_path / "README").write_text("worlds")
    return tmp_path


def written(folder, tasks, **fields):
    path = folder / "tasks.yaml"
    path.write_text(yaml.safe_dump({"format": "vuca-tasks-1", "tasks": tasks, **fields}))
    return path


ROOM = "map:maps/room.yaml"


def test_a_file_of_tasks(folder):
    tasks = read_tasks(
        written(
            folder,
            [
                {"name": "through the door", "world": ROOM, "start": {"x": 1, "y": 1}, "goal": {"x": 5, "y": 3}},
                {"world": ROOM, "start": {"x": 1, "y": 1, "yaw": 0.5}, "goal": {"x": 2, "y": 3}, "tolerance": 1},
                {"world": "barn:world_*.json", "time_limit": 50},
                {"world": "square", "optimal_length": 20.0},
            ],
            tolerance=0.5,
            unknown="free",
        )
    )
    assert [task.name for task in tasks] == ["through the door", "room", "world_1", "world_2", "square"]
    first, second, third, _, last = (each.task for each in tasks)
    world = f"map:{folder / 'maps' / 'room.yaml'}"
    # Without a heading it begins facing its goal, as far as the body fits so.
    assert first == Task(world, start=(1, 1, None), goal=(5, 3), tolerance=0.5, unknown="free")
    assert second == Task(world, start=(1, 1, 0.5), goal=(2, 3), tolerance=1, unknown="free")
    assert (third.world, third.time_limit, third.tolerance) == (f"barn:{folder / 'world_1.json'}", 50, 0.5)
    assert (last.world, tasks[-1].optimal_length) == ("square", 20.0)
    assert [task.optimal_length for task in tasks[:4]] == [None, None, 4.0, None]
    assert set(files_of(tasks)) == {str(folder / name) for name in ("maps/room.yaml", "world_1.json", "world_2.json")}


def test_a_body_begins_in_a_heading_in_which_it_fits(folder):
    """Between two walls 0.5 m apart with the goal across them, the Go2 begins along them."""
    pixels = np.full((80, 80), 254, np.uint8)
    pixels[32:34, :60] = pixels[39:41, :60] = 0  # rows from above: walls at y = 3.9 to 4.0 and 4.6 to 4.7 m at 0.1 m
    Image.fromarray(pixels).save(folder / "maps" / "lane.png")
    fields = {"image": "lane.png", "resolution": 0.1, "origin": [0, 0, 0], "negate": 0}
    (folder / "maps" / "lane.yaml").write_text(yaml.safe_dump(fields))
    entry = {"name": "out", "world": "map:maps/lane.yaml", "start": {"x": 4, "y": 4.35}, "goal": {"x": 4, "y": 7}}
    (task,) = read_tasks(written(folder, [entry]))
    begun = Episode(EpisodeConfig(world=task.task.world, start=task.task.start, goal=task.task.goal, robot="go2"))
    assert abs(np.sin(begun.world.start.yaw)) < 0.3
    # A round body faces its goal.
    round_one = Episode(EpisodeConfig(world=task.task.world, start=(2.0, 2.0, None), goal=(4, 7), robot="tiago"))
    assert round_one.world.start.yaw == pytest.approx(np.arctan2(5.0, 2.0), abs=1e-4)


def test_a_folder_of_worlds_is_a_task_for_each(folder):
    tasks = read_tasks(folder)
    assert [(each.name, each.task.world.partition(":")[0]) for each in tasks] == [
        ("maps/room", "map"),
        ("world_1", "barn"),
        ("world_2", "barn"),
    ]
    assert tasks[1].optimal_length == 4.0


def test_a_list_of_maps_with_the_sources_own_tasks(folder, capsys):
    walkers = [{"name": "a", "loop": None, "keyframes": [[0, 1, 3], [4, 2, 3], [8, 1, 3]]}]
    content = [
        {
            "set": "ours",
            "name": "room",
            "yaml": "maps/room.yaml",
            "third_party_tasks": [
                {"name": "t", "start": [1, 1, 0.2], "goal": [5, 3, 1.0], "dynamic": walkers, "shortest_m": 5.5},
                {"name": "explore", "start": [1, 1, 0], "goal": None, "dynamic": []},
            ],
            "auto_tasks": [{"kind": "detour", "start": [1, 1], "goal": [1, 3], "shortest_m": 2.0}],
        }
    ]
    path = folder / "list.json"
    path.write_text(json.dumps(content))
    first, second = read_tasks(path)
    assert (first.name, first.optimal_length, first.task.start) == ("ours-room-t", 5.5, (1, 1, 0.2))
    assert (second.name, second.task.start, second.task.goal) == ("ours-room-auto-0", (1, 1, None), (1, 3))
    assert "1 tasks have no goal" in capsys.readouterr().err
    (config,) = episodes_of(suite_of(path, [first]))
    (walker,) = Episode(config).world.movers
    assert isinstance(walker.motion, Keyframes)
    assert (walker.kind, walker.motion.period, walker.motion.points[1]) == ("person", 8.0, (2.0, 3.0))


@pytest.mark.parametrize(
    ("tasks", "fields", "text"),
    [
        ([], {}, "tasks: none"),
        ([{"world": ROOM}], {"format": "vuca-tasks-2"}, "format: vuca-tasks-2 should be vuca-tasks-1 (line"),
        ([{"world": ROOM}], {"speed": 2}, "unknown field speed"),
        ([{"world": ROOM, "gaol": {"x": 1, "y": 1}}], {}, "tasks[0]: unknown field gaol; its fields are name"),
        ([{"world": ROOM, "goal": {"x": 1}}], {}, "tasks[0].goal.y: it is missing"),
        ([{"world": ROOM, "goal": [1, 2]}], {}, "tasks[0].goal: [1, 2] is not a mapping"),
        ([{"world": ROOM, "start": {"x": "a", "y": 1}}], {}, "tasks[0].start.x: 'a' is not a number"),
        ([{"world": ROOM, "start": {"x": 1, "y": 1}}], {}, "tasks[0].start: yaw missing"),
        ([{"world": ROOM, "tolerance": 0}], {}, "tasks[0].tolerance: 0 is out of range"),
        ([{"world": ROOM, "unknown": "wet"}], {}, "tasks[0].unknown: wet is not one of"),
        ([{"world": ROOM, "obstacles": "rain"}], {}, "tasks[0].obstacles: rain: tracks:FILE"),
        ([{"world": "barn:none.json"}], {}, "tasks[0].world: there is no none.json"),
        ([{"world": "barn:none_*.json"}], {}, "tasks[0].world: there is no none_*.json"),
        ([{"world": "map:../room.yaml"}], {}, "leads out of the file's folder"),
        ([{"world": "map:/etc/hosts"}], {}, "leads out of the file's folder"),
        ([{"world": "atlantis"}], {}, "tasks[0].world: atlantis is neither a world's name nor a file"),
        ([{"world": ROOM}, {"world": ROOM}], {}, "the tasks room and room are the same"),
        ([3], {}, "tasks[0]: 3 is not a mapping"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(folder, tasks, fields, text):
    with pytest.raises(BadWorld) as told:
        read_tasks(written(folder, tasks, **fields))
    assert text in str(told.value).replace("'[1, 2]'", "[1, 2]").replace("'3'", "3")
    assert "\n" not in str(told.value)


def test_a_folder_without_worlds_is_refused(tmp_path):
    with pytest.raises(BadWorld, match="no worlds in this folder"):
        read_tasks(tmp_path)


def test_a_broken_world_in_a_folder_does_not_end_the_others(folder):
    (folder / "world_3.json").write_text("{")
    (folder / "world_4.json").write_text(json.dumps(BARN | {"optimal_path_length_m": -1}))
    tasks = {each.name: each for each in read_tasks(folder)}
    assert {"world_1", "world_3", "world_4"} <= set(tasks)
    job = job_of(tuple(tasks.values()))
    for name in ("world_3", "world_4"):
        row = job(EpisodeConfig(tasks[name].task.world, robot="tiago", method="dwa-dh", seed=0))
        assert row["outcome"] == "refused"


def test_the_length_that_a_world_states_is_that_of_its_own_way(folder):
    goal = {"x": -2.25, "y": 5.0}
    own, other = read_tasks(
        written(folder, [{"world": "barn:world_1.json"}, {"world": "barn:world_1.json", "goal": goal}])
    )
    assert (own.optimal_length, other.optimal_length) == (4.0, None)


def test_files_are_known_by_all_they_hold_whatever_their_names(folder):
    (folder / "a#1").mkdir()
    (folder / "a#1" / "world.json").write_text(json.dumps(BARN))
    tasks = read_tasks(written(folder, [{"world": "barn:a#1/world.json"}, {"world": ROOM}]))
    before = files_of(tasks)
    assert len(before) == 2
    Image.fromarray(np.full((40, 60), 254, np.uint8)).save(folder / "maps" / "room.png")
    changed = {name for name, value in files_of(tasks).items() if value != before[name]}
    assert changed == {str(folder / "maps" / "room.yaml")}


def test_barns_score_by_hand():
    # An optimal way of 12 m takes 6 s at 2 m/s: full marks to 12 s, an eighth from 48 s on, nothing without success.
    assert barn_score(True, 5.0, 12.0) == 0.5
    assert barn_score(True, 12.0, 12.0) == 0.5
    assert barn_score(True, 24.0, 12.0) == 0.25
    assert barn_score(True, 48.0, 12.0) == barn_score(True, 99.0, 12.0) == 0.125
    assert barn_score(False, 12.0, 12.0) == 0.0


def test_a_task_that_is_refused_is_a_row(folder):
    tasks = read_tasks(
        written(
            folder,
            [
                {"name": "in the wall", "world": ROOM, "start": {"x": 3.05, "y": 1}, "goal": {"x": 5, "y": 3}},
                {
                    "name": "near it",
                    "world": ROOM,
                    "start": {"x": 1, "y": 1},
                    "goal": {"x": 2.9, "y": 3.5},
                    "tolerance": 0.15,
                },
                {"name": "broken", "world": "barn:world_2.world"},
            ],
        )
    )
    job = job_of(tasks)
    rows = [job(config) for config in episodes_of(suite_of(folder, tasks))]
    assert [row["outcome"] for row in rows] == ["refused"] * 3
    assert [row["task"] for row in rows] == ["in the wall", "near it", "broken"]
    assert "is inside obstacles" in rows[0]["reason"]
    assert "the widest is 0.49 m wide" in rows[1]["reason"]
    assert "<sdf> with a <world>" in rows[2]["reason"]
    assert all(map(is_result, rows))
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    found = statistics_of(rows)
    assert (found["n"], found["refused"], found["success"]["rate"]) == (0, 3, None)
    assert "refused" in table(by_driver(rows, "tasks"), found)


def test_options_of_the_movers_do_not_hide_a_task(folder):
    tasks = read_tasks(written(folder, [{"world": "square", "start": {"x": 0, "y": 0}, "goal": {"x": 0.1, "y": 0}}]))
    suite = turn_dials(suite_of(folder, tasks), speed=1.5, movers=8)
    (config,) = episodes_of(choose(suite, ["dwa-dh"]))
    assert job_of(tasks)(config)["task"] == "square"


def test_tasks_run_and_go_on_and_are_scored(folder, capsys):
    path = written(
        folder,
        [
            {"name": "short", "world": ROOM, "start": {"x": 1, "y": 2}, "goal": {"x": 2.2, "y": 2}, "tolerance": 0.5},
            {"name": "wall", "world": ROOM, "start": {"x": 3.05, "y": 1}, "goal": {"x": 5, "y": 3}},
            {"name": "barn", "world": "barn:world_1.json"},
        ],
    )
    command = ["--tasks", str(path), "--out", str(folder / "out"), "--method", "dwa-dh", "--workers", "1", "--json"]
    assert eval_(["--episodes", "2", *command]) == 0
    capsys.readouterr()
    with pytest.raises(Exception, match="was begun with episodes = 2"):
        eval_(command)
    assert eval_([*command[:2], "--out", str(folder / "all"), *command[4:]]) == 0
    rows = [json.loads(line) for line in (folder / "all" / "episodes.jsonl").read_text().splitlines()]
    short, wall, barn = rows
    assert (short["outcome"], wall["outcome"], barn["outcome"]) == ("success", "refused", "success")
    # It stops counting within the task's own tolerance: the way is shorter by it.
    assert short["path_length"] == pytest.approx(1.2 - 0.5, abs=0.15)
    assert (short["judged_tolerance"], short["spl"]) == (0.5, 1.0)
    assert "score" not in short
    assert (barn["judged_tolerance"], barn["judged_time_limit"], barn["optimal_length"]) == (1.0, 100.0, 4.0)
    time = barn["arriving_time"] - barn["moved_after"]
    assert 0.0 < barn["moved_after"] < barn["arriving_time"]
    assert barn["score"] == pytest.approx(2.0 / min(max(time, 4.0), 16.0))
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (summary["total"]["n"], summary["total"]["refused"], summary["total"]["score"]) == (2, 1, barn["score"])
    assert eval_([*command[:2], "--out", str(folder / "all"), *command[4:]]) == 0  # nothing is left to run
    assert "3 of 3 episodes are there already" in capsys.readouterr().err


def test_a_suite_or_tasks_but_not_both(folder):
    from vuca_nav.errors import BadArgument

    for arguments in ([], ["smoke", "--tasks", str(folder)]):
        with pytest.raises(BadArgument, match="--tasks FILE, and not both"):
            eval_([*arguments, "--out", str(folder / "out")])


def test_time_limits_count_from_the_first_motion_where_the_world_says_so(folder):
    episode = Episode(EpisodeConfig(world=f"barn:{folder / 'world_1.json'}", method="dwa-dh", time_limit=2.0))
    result = episode.run()
    assert result.outcome == "timeout"
    assert result.moved_after is not None
    assert result.duration == pytest.approx(2.0 + result.moved_after, abs=0.05)


def test_public_tasks_are_read(capsys):
    assert len(read_tasks(data("barn"))) == 30
    assert len(read_tasks(data("dynabarn"))) == 12
    tasks = read_tasks(data("maps", "tasks.json"))
    assert sum(each.task.obstacles is not None for each in tasks) == 3
    assert all(each.optimal_length for each in tasks)
