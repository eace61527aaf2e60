import json
from dataclasses import asdict, replace

import pytest

from eval.analysis.summary import statistics_of, summarise, table
from eval.episode import EpisodeConfig
from eval.evaluate import evaluate
from eval.methods import METHODS, ExplorerSettings, Method, MethodConfig, MethodOptions
from eval.provenance import provenance
from eval.runner import Crash, run_episodes
from eval.suites import BOTH, FRESH, SUITES, Driver, choose, episodes_of, find_suite, parse_seeds, turn_dials
from tests.eval import jobs
from train.arena.config import ArenaConfig
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.policy.dynamic_window import DynamicWindowConfig
from vuca_nav.provenance import machine
from vuca_nav.shield.futures import FuturesConfig
from vuca_nav.shield.shield import ShieldConfig

CONFIGS = episodes_of(SUITES["smoke"], seeds=range(3))
IDENTITY = {"suite": "smoke", "seeds": [0, 3]}


def files_of(directory):
    return {name: (directory / name).read_bytes() for name in ("episodes.jsonl", "summary.json")}


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    out = tmp_path_factory.mktemp("uninterrupted")
    evaluate(IDENTITY, CONFIGS, out, workers=1, job=jobs.episode_by_hash)
    return files_of(out)


def test_every_episode_has_its_row_in_order(uninterrupted):
    rows = [json.loads(line) for line in uninterrupted["episodes.jsonl"].splitlines()]
    assert [{**config.row()} for config in CONFIGS] == [{key: row[key] for key in CONFIGS[0].row()} for row in rows]


def test_two_workers_give_the_same_files(uninterrupted, tmp_path):
    evaluate(IDENTITY, CONFIGS, tmp_path, workers=2, job=jobs.episode_by_hash)
    assert files_of(tmp_path) == uninterrupted


def test_resumed_after_a_kill_gives_the_same_files(uninterrupted, tmp_path):
    evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_by_hash)
    whole = (tmp_path / "episodes.jsonl").read_bytes()
    lines = whole.splitlines(keepends=True)
    # Killed in the middle of a row, and before the summary, with two rows that came in another order.
    (tmp_path / "episodes.jsonl").write_bytes(lines[3] + lines[1] + lines[7][:20])
    (tmp_path / "summary.json").unlink()
    evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_by_hash)
    assert files_of(tmp_path) == uninterrupted


def test_dials_change_every_task_of_a_suite():
    turned = turn_dials(SUITES["crowd"], speed=1.5, sighted=0.5)
    assert [(c.movers, c.speed, c.sighted) for c in episodes_of(turned, limit=4)] == [
        (movers, 1.5, 0.5) for movers in (8, 16, 24, 40)
    ]
    assert turn_dials(turned, speed=1.0) == turned
    assert turn_dials(SUITES["crowd"]) == SUITES["crowd"]
    assert turn_dials(turned, movers=12, speed=0.5).tasks[0].speed == 0.75
    row = episodes_of(turned, limit=1)[0].row()
    assert (row["movers"], row["speed"], row["sighted"]) == (8, 1.5, 0.5)
    with pytest.raises(BadArgument, match="--speed 2 does not go with --without V"):
        turn_dials(SUITES["factory-still"], speed=2.0)


def test_several_methods_share_a_folder(tmp_path):
    suite = choose(SUITES["smoke"], ["dwa-dh", "ours"], ["tiago", "go2"], MethodOptions(gamma=2.0))
    configs = episodes_of(suite, seeds=range(2))
    evaluation = evaluate(IDENTITY, configs, tmp_path / "whole", workers=2, job=jobs.episode_by_hash)
    assert [(group["robot"], group["method"], group["gamma"], group["n"]) for group in evaluation.groups[:4]] == [
        ("go2", "dwa-dh", None, 2), ("go2", "ours", 2.0, 2), ("tiago", "dwa-dh", None, 2), ("tiago", "ours", 2.0, 2),
    ]  # fmt: skip
    hashes = {(row["robot"], row["method"]): row["bits"] for row in evaluation.rows}
    assert len(set(hashes.values())) == 4
    # Alone, or with other seeds, a method has the same hash: its rows go with these.
    alone = episodes_of(choose(SUITES["smoke"], ["dwa-dh"]), seeds=range(5, 6))
    (bits,) = {
        row["bits"] for row in evaluate(IDENTITY, alone, tmp_path / "a", workers=1, job=jobs.episode_by_hash).rows
    }
    assert bits == hashes["tiago", "dwa-dh"]
    lines = (tmp_path / "whole" / "episodes.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "whole" / "episodes.jsonl").write_bytes(b"".join(lines[9:] + lines[2:6]) + lines[0][:30])
    evaluate(IDENTITY, configs, tmp_path / "whole", workers=2, job=jobs.episode_by_hash)
    assert (tmp_path / "whole" / "episodes.jsonl").read_bytes() == b"".join(lines)


def test_nothing_is_run_twice(tmp_path):
    evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_by_hash)
    evaluation = evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_that_kills_its_worker)
    assert not evaluation.crashes
    assert len(evaluation.rows) == len(CONFIGS)


def test_every_run_is_noted_with_its_command_and_machine(tmp_path, monkeypatch):
    def runs():
        return json.loads((tmp_path / "config.json").read_text())["runs"]

    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, command="vuca eval smoke", job=jobs.episode_by_hash)
    (first,) = runs()
    assert (first["command"], first["machine"]) == ("vuca eval smoke", machine())
    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, command="nothing to do", job=jobs.episode_by_hash)
    assert runs() == [first]
    (tmp_path / "episodes.jsonl").write_text("")
    monkeypatch.setattr("eval.evaluate.machine", lambda: {"cpu": "another"})  # which may go on
    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, command="again", job=jobs.episode_by_hash)
    assert [run["machine"]["cpu"] for run in runs()] == [first["machine"]["cpu"], "another"]


def test_a_crash_is_reported_with_its_configuration_and_the_others_go_on(tmp_path, capfd):
    evaluation = evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_that_fails_on_seed_1)
    assert {crash.config["seed"] for crash in evaluation.crashes} == {1}
    assert len(evaluation.crashes) == 4
    assert len(evaluation.rows) == len(CONFIGS) - 4
    assert "ZeroDivisionError: seed 1 divides by zero" in capfd.readouterr().err
    crashed = json.loads((tmp_path / "summary.json").read_text())["crashed"]
    assert crashed[0]["error"] == "ZeroDivisionError: seed 1 divides by zero"
    # The next run tries again what crashed, and only that.
    assert not evaluate(IDENTITY, CONFIGS, tmp_path, workers=1, job=jobs.episode_by_hash).crashes


def test_a_dead_worker_is_a_crash_not_a_hang():
    results = list(run_episodes(CONFIGS[:2], 1, jobs.episode_that_kills_its_worker))
    assert [type(result) for result in results] == [Crash, Crash]
    assert "worker process died" in results[0].error  # type: ignore[union-attr]


def test_a_worker_has_a_single_thread():
    (row,) = run_episodes(CONFIGS[:1], 1, jobs.threads_of_a_worker)
    assert isinstance(row, dict)
    assert set(row["threads"]) == {"1"}


def test_summary_by_hand():
    base = jobs.episode_by_hash(CONFIGS[0])
    rows = [
        {**base, "outcome": "success", "arriving_time": 10.0, "spl": 1.0},
        {**base, "outcome": "success", "arriving_time": 20.0, "spl": 0.5},
        {**base, "outcome": "timeout", "arriving_time": None, "spl": 0.0},
        {**base, "without": "V", "outcome": "fall", "arriving_time": None},
    ]
    moving, still = summarise(rows)
    assert summarise(rows[::-1]) == [moving, still]
    assert (moving["n"], still["n"]) == (3, 1)
    assert moving["success"]["count"] == 2
    assert moving["success"]["interval"] == pytest.approx([0.2077, 0.9385], abs=5e-5)
    assert moving["arriving_time"] == 15.0
    assert moving["spl"] == 0.5
    assert still["fall"]["rate"] == 1.0
    assert still["arriving_time"] is None
    total = statistics_of(rows)
    assert (total["n"], total["success"]["count"], total["success"]["rate"]) == (4, 2, 0.5)
    header, first, _, last = table([moving, still], total).splitlines()
    assert last.startswith("all ")
    assert "collision" in header
    assert "2 [21-94%]" in first


def test_contacts_and_failures_by_hand():
    base = jobs.episode_by_hash(CONFIGS[0]) | {"arriving_time": None, "contact": None, "failure": None}
    touched = [("stopped", False), ("stopped", False), ("front", True), ("static", True), ("yielding", False)]
    rows = [base | {"outcome": "collision", "contact": {"class": name, "own": own}} for name, own in touched]
    rows += [base | {"outcome": "timeout", "failure": {"class": name}} for name in ("stuck", "stuck", "lost")]
    total = statistics_of(rows)
    counts = {"own": 2, "static": 1, "stopped": 2, "yielding": 1, "front": 1, "side": 0, "rear": 0}
    assert total["contacts"] == counts
    assert total["failures"] == {"fall": 0, "unreachable": 0, "lost": 1, "stuck": 2, "out_of_time": 0}
    header, line = table([], total).splitlines()
    end = header.index(" own") + len(" own")
    assert line[:end].endswith("2 of 5")


def test_ways_by_hand():
    base = jobs.episode_by_hash(CONFIGS[0]) | {"arriving_time": None}
    ways = {"success": (30.0, 50.0), "collision": (5.0, 15.0), "timeout": (200.0,)}
    rows = [{**base, "outcome": outcome, "path_length": way} for outcome in ways for way in ways[outcome]]
    rows += [{**base, "without": "V", "outcome": "success", "path_length": 20.0}]
    moving, still = summarise(rows)
    assert moving["path_length"] == 60.0
    assert moving["way_per_collision"] == 150.0  # 300 m, two collisions
    assert (still["path_length"], still["way_per_collision"]) == (20.0, None)
    total = statistics_of(rows)
    assert total["way_per_collision"] == 160.0
    header, first, second, last = table([moving, still], total).splitlines()
    end = header.index("m/coll.") + len("m/coll.")
    assert [line[:end].split()[-2:] for line in (first, second, last)] == [
        ["60.0", "150"],
        ["20.0", "-"],
        ["53.3", "160"],
    ]


def test_groups_are_in_the_order_of_their_numbers():
    base = jobs.episode_by_hash(CONFIGS[0])
    rows = [{**base, "region": region, "movers": movers} for region in (None, 1) for movers in (24, None, 8, 16)]
    order = [(1, 8), (1, 16), (1, 24), (1, None), (None, 8), (None, 16), (None, 24), (None, None)]
    assert [(group["region"], group["movers"]) for group in summarise(rows)] == order


def test_suites_have_the_promised_episodes():
    factory = episodes_of(SUITES["factory"])
    assert len(factory) == 100
    assert {(config.region, config.seed) for config in factory} == {
        (region, seed) for region in (1, 2, 3, 4) for seed in range(25)
    }
    still = episodes_of(SUITES["factory-still"], limit=7)
    assert len(still) == 7
    assert {config.without for config in still} == {"V"}
    with pytest.raises(UnknownName, match="did you mean 'factory'"):
        find_suite("factori")
    with pytest.raises(UnknownName, match="unknown method"):
        choose(SUITES["smoke"], ["mind-reading"])
    with pytest.raises(UnknownName, match="unknown robot"):
        choose(SUITES["smoke"], robots=["gp2"])
    with pytest.raises(BadArgument, match="--episodes"):
        episodes_of(SUITES["smoke"], limit=0)


def test_a_suite_runs_every_method_and_robot_with_the_same_seeds():
    suite = SUITES["paper-system"]
    every = episodes_of(suite)
    cells = {(c.robot, c.method, c.world, c.region) for c in every}
    assert len(cells) == 2 * 7 * 5
    assert len(every) == 400 * len(cells)
    for k in range(0, len(every), len(cells)):  # the first seed of every cell before the second
        part = every[k : k + len(cells)]
        assert {(c.robot, c.method, c.world, c.region) for c in part} == cells
        assert {c.seed for c in part} == {FRESH + k // len(cells)}


def test_methods_and_robots_can_be_chosen():
    suite = choose(SUITES["paper-system"], ["ours", "dwa-dh"], ["go2"])
    assert suite.robots == ("go2",)
    assert suite.drivers == (Driver("ours"), Driver("dwa-dh"))
    gates = choose(SUITES["paper-gate"], ["fusion", "single"])
    assert [str(driver) for driver in gates.drivers] == [
        "fusion", "fusion --gate uniform", *(f"fusion --without-expert {k}" for k in (1, 2, 3, 4)), "single",
    ]  # fmt: skip


def test_an_option_goes_to_the_methods_that_take_it():
    suite = choose(SUITES["paper-system"], options=MethodOptions(gamma=0.25, no_shield=True))
    assert [str(driver) for driver in suite.drivers] == [
        "move_base", "move_base+dh", "drl", "paper-dh", "paper --gamma 0.25", "ours-dh --no-shield",
        "ours --no-shield --gamma 0.25",
    ]  # fmt: skip
    with pytest.raises(BadArgument, match=r"'move_base' has no gate .*; --gate goes with: .*fusion"):
        choose(SUITES["paper-system"], ["move_base", "dwa-dh", "ours"][:2], options=MethodOptions(gate="uniform"))
    with pytest.raises(BadArgument, match=r"'dwa-dh' has no V\^h"):
        choose(SUITES["smoke"], ["dwa-dh"], options=MethodOptions(gamma=1.0))


def test_suites_that_are_reported_have_seeds_of_their_own():
    names = ("paper-system", "paper-ablation", "paper-branch", "paper-gate", "building", "vuca", "dials", "crowdnav")
    for name in names:
        assert SUITES[name].seeds.start == 3000
        assert SUITES[name].robots == BOTH
    others = [suite for name, suite in SUITES.items() if name not in names]
    assert all(suite.seeds.stop <= 3000 for suite in others)
    for suite in SUITES.values():
        assert turn_dials(suite) == suite  # its tasks take their options


def test_seeds():
    assert parse_seeds("3:7") == range(3, 7)
    for junk in ("junk", "3", "3:", ":7", "7:3", "3:3", "-1:3", "0:2:1"):
        with pytest.raises(BadArgument, match="A:B"):
            parse_seeds(junk)


def test_worlds_that_policies_are_trained_in_are_not_for_evaluation():
    first = ArenaConfig().world_seed
    assert parse_seeds(f"{first - 1}:{first}") == range(first - 1, first)
    for text in (f"{first - 1}:{first + 1}", f"{first}:{first + 1}"):
        with pytest.raises(
            BadArgument, match=f"--seeds {text}: policies are trained in worlds of seeds from {first} on"
        ):
            parse_seeds(text)
    assert all(suite.seeds.stop <= first for suite in SUITES.values())


@pytest.mark.parametrize("spoil", ["other", "twice", "no outcome", "no number"])
def test_a_row_that_is_not_of_this_evaluation_is_named(spoil, tmp_path):
    evaluate(IDENTITY, CONFIGS[:3], tmp_path, workers=1, job=jobs.episode_by_hash)
    path = tmp_path / "episodes.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    rows[1] = {
        "other": {"a": 1},
        "twice": rows[0],
        "no outcome": {**rows[1], "outcome": "fame"},
        "no number": {**rows[1], "spl": "much"},
    }[spoil]
    path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    with pytest.raises(BadArgument, match=r"episodes\.jsonl:2 is not a row of this evaluation"):
        evaluate(IDENTITY, CONFIGS[:3], tmp_path, workers=1, job=jobs.episode_by_hash)


def test_other_code_does_not_go_on_with_our_rows(tmp_path, monkeypatch):
    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, job=jobs.episode_by_hash)
    monkeypatch.setattr("eval.evaluate.made_with", lambda: {"commit": "fedcba987654"})  # of a page, for example
    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, job=jobs.episode_by_hash)
    monkeypatch.setattr("eval.provenance.code_digest", lambda: "fedcba987654")
    with pytest.raises(BadArgument, match=r"begun with code = .*, not \"fedcba987654\""):
        evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, job=jobs.episode_by_hash)


def settings(config):
    (found,) = provenance([config])["settings"].values()
    return found


def test_the_settings_that_are_kept_are_those_that_ran():
    ours = settings(EpisodeConfig(method="ours"))
    assert (ours["navigator"]["alert_rate"], ours["navigator"]["explorer"]["gamma"]) == (1.0, 300.0)
    assert ours["shield"] == asdict(ShieldConfig())
    assert ours["shield"]["futures"] == asdict(FuturesConfig())
    assert ours["dynamic_window"] == asdict(DynamicWindowConfig())  # for ways narrower than it was trained on
    weighted = EpisodeConfig(method="ours", options=MethodOptions(gamma=2.0))
    assert settings(weighted)["navigator"]["explorer"]["gamma"] == 2.0
    assert settings(EpisodeConfig(method="ours", without="A")) == ours  # the task says so
    alone = settings(EpisodeConfig(method="fusion-plus", robot="go2", options=MethodOptions(gate="uniform")))
    assert not {"shield", "dynamic_window"} & set(alone)
    assert alone["gate"]["uniform"]
    window = settings(EpisodeConfig(method="dwa-dh"))
    assert (window["navigator"]["exploration_rate"], window["navigator"]["explorer"]["gamma"]) == (0.2, 0.0)
    assert window["dynamic_window"] == asdict(DynamicWindowConfig())
    assert not {"shield", "gate"} & set(window)


def test_other_settings_do_not_go_on_with_our_rows(tmp_path, monkeypatch):
    evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, job=jobs.episode_by_hash)
    (name,) = {config.method for config in CONFIGS}
    config = METHODS[name].config
    assert isinstance(config, MethodConfig)
    slower = replace(config, explorer=ExplorerSettings(rate=0.1))
    monkeypatch.setitem(METHODS, name, Method("slower", slower))
    with pytest.raises(
        BadArgument, match=r"begun with settings\.tiago, ours-dh\.navigator\.exploration_rate = 0\.2, not 0\.1"
    ):
        evaluate(IDENTITY, CONFIGS[:2], tmp_path, workers=1, job=jobs.episode_by_hash)
