"""Robots of one's own in evaluations: what decides their rows, and what is refused."""

import json

import pytest

from eval.commands import eval_, run
from eval.episode import Episode, EpisodeConfig
from eval.provenance import provenance
from robots.registry import ROVER_FILE, digest_of, make_body
from tests.robots.own.robots import write_robot
from vuca_nav.errors import BadArgument, VucaError

OWN = (
    ("drive: {type: differential, left: [left_wheel], right: [right_wheel]}",
     "drive: {type: own, interface: my_drive:Drive}"),
    ("odometry: {model: wheels}", "odometry: {model: velocity}"),
)  # fmt: skip


def test_the_rover_by_its_file_is_the_rover():
    rows = []
    for robot in ("rover", f"mjcf:{ROVER_FILE}"):
        episode = Episode(EpisodeConfig(world="static", robot=robot, method="dwa-dh", without="V"))
        episode.timeout = 2.0
        rows.append(episode.run().row())
    assert rows[0]["path_length"] == rows[1]["path_length"] > 0.5
    assert (rows[0]["robot"], rows[1]["robot"]) == ("rover", f"mjcf:{ROVER_FILE}")


def test_an_evaluation_goes_on_only_with_the_same_files(tmp_path, monkeypatch):
    monkeypatch.setattr("eval.evaluate.run_episodes", lambda *_: iter(()))
    file = write_robot(tmp_path / "cart")
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--robot", f"mjcf:{file},tiago", "--method", "dwa-dh"]
    assert eval_(arguments) == 0
    settings = json.loads((tmp_path / "out" / "config.json").read_text())["made_by"]["settings"]
    assert settings[f"mjcf:{file}, dwa-dh"]["robot_sha256"] == digest_of(make_body(f"mjcf:{file}"))
    assert "robot_sha256" not in settings["tiago, dwa-dh"]
    assert eval_(arguments) == 0
    write_robot(tmp_path / "cart", ('mass="10"', 'mass="10.1"'))
    with pytest.raises(BadArgument, match="robot_sha256"):
        eval_(arguments)


def test_the_hash_is_of_all_files(tmp_path):
    file = write_robot(tmp_path)
    config = EpisodeConfig(robot=f"mjcf:{file}", method="dwa-dh")

    def hash_now():
        return provenance([config])["settings"][f"mjcf:{file}, dwa-dh"]["robot_sha256"]

    before = hash_now()
    write_robot(tmp_path, ("height: 0.2", "height: 0.25"))
    assert hash_now() != before
    write_robot(tmp_path)
    assert hash_now() == before


def test_code_of_ones_own_runs_only_under_trust(tmp_path):
    robot = f"mjcf:{write_robot(tmp_path, *OWN)}"
    for command, arguments in ((run, []), (eval_, ["smoke", "--out", str(tmp_path / "out")])):
        with pytest.raises(BadArgument, match=r"robot mjcf:.* runs Python code of your own; add --trust"):
            command([*arguments, "--robot", robot])


def test_an_evaluation_runs_a_trusted_drive(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_drive.py").write_text(
        "from robots.own.interface import VelocityInterface\n"
        "class Drive(VelocityInterface):\n"
        "    def reset(self):\n"
        "        pass\n"
        "    def apply(self, command):\n"
        "        v, w = command.v_x / 0.1, 2.0 * command.w_z\n"
        "        self.robot.data.ctrl[:] = (v - w, v + w)\n"
    )
    motors = "".join(f'<velocity joint="{side}_wheel" kv="3"/>' for side in ("left", "right"))
    file = write_robot(tmp_path, *OWN, ("</worldbody>", f"</worldbody><actuator>{motors}</actuator>"))
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--robot", f"mjcf:{file}", "--method", "dwa-dh", "--trust"]
    assert eval_([*arguments, "--episodes", "2", "--workers", "1"]) == 0
    rows = [json.loads(line) for line in (tmp_path / "out" / "episodes.jsonl").read_text().splitlines()]
    assert len(rows) == 2
    assert all(row["path_length"] > 1.0 for row in rows)


def test_a_robot_that_is_none_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(VucaError, match=r"nothing.yaml cannot be read"):
        run(["--robot", f"mjcf:{tmp_path}/nothing.yaml"])
    with pytest.raises(VucaError, match=r"unknown robot 'rovers'; did you mean 'rover'"):
        eval_(["smoke", "--out", str(tmp_path / "out"), "--robot", "rovers"])
