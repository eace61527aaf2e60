"""Maps from one mission to the next: ``--save-map`` and ``--map``."""

import json

import numpy as np
import pytest
from PIL import Image

from eval.commands import run
from eval.episode import EpisodeConfig
from eval.prior_map import read_prior_map
from vuca_nav.errors import BadArgument, BadWorld

WALLS = (
    (7.0, -0.1, 14.4, 0.2), (7.0, 9.1, 14.4, 0.2), (-0.1, 4.5, 0.2, 9.0), (14.1, 4.5, 0.2, 9.0),
    (6.0, 4.0, 7.2, 0.2), (4.5, 2.7, 0.2, 2.6), (6.5, 1.3, 0.2, 2.6), (9.5, 2.0, 0.2, 4.2),
)  # fmt: skip
"""A hall of 14 m by 9 m. The straight way from the start leads into an alley whose end shows only from its depth."""
SCENE = """format: vuca-scene-1
name: a blind alley on the way
seed: 0
bounds: {x_min: 0.0, y_min: 0.0, x_max: 14.0, y_max: 9.0}
start: {x: 1.2, y: 2.0, yaw: 0.0}
goal: {x: 12.5, y: 2.0}
movers: []
obstacles:
"""


@pytest.fixture(scope="module")
def alley(tmp_path_factory):
    path = tmp_path_factory.mktemp("alley") / "alley.yaml"
    shape = "- {{kind: wall, shape: {{type: box, x: {}, y: {}, length: {}, width: {}, yaw: 0.0, height: 2.0}}}}\n"
    path.write_text(SCENE + "".join(shape.format(*wall) for wall in WALLS))
    return path


def mission(capsys, alley, *options) -> dict:
    assert run(["--world", str(alley), "--method", "dwa-dh", "--json", *map(str, options)]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_with_the_map_of_the_last_mission_the_robot_keeps_out_of_the_blind_alley(alley, tmp_path, capsys):
    first = mission(capsys, alley, "--save-map", tmp_path / "first")
    assert first["outcome"] == "success"
    assert first["path_length"] > 20.0  # the alley and back; the way round it has 14 m
    path = tmp_path / "first" / "map.yaml"
    saved = read_prior_map(path)
    for x, y, state in ((12.5, 2.0, -1), (7.0, 3.97, 1), (9.4, 2.5, 1), (7.5, 1.0, -1), (-1.0, 2.0, 0)):
        assert saved.state(x, y) == state, (x, y)
    second = mission(capsys, alley, "--map", path, "--save-map", tmp_path / "second.yaml")
    assert second["outcome"] == "success"
    assert second["map"] == str(path)
    assert second["path_length"] < 18.0
    for name in ("first/map.pgm", "first/map.png", "second.pgm"):
        assert np.asarray(Image.open(tmp_path / name)).shape[1] == pytest.approx(14.4 / 0.05, abs=12)


def test_a_map_is_refused_before_the_mission_begins(alley, tmp_path):
    with pytest.raises(BadWorld, match=r"none\.yaml"):
        run(["--world", str(alley), "--map", str(tmp_path / "none.yaml")])
    with pytest.raises(BadArgument, match="--without U, which gives the true map, exclude"):
        EpisodeConfig(map="a.yaml", without="U")


def test_a_place_for_a_map_is_refused_before_the_mission_begins(alley, tmp_path):
    (tmp_path / "file").write_text("")
    for place, says in (("file", "ends in .yaml, or a directory"), ("file/map.yaml", "cannot be written")):
        with pytest.raises(BadArgument, match=f"--save-map .*{says}"):
            run(["--world", str(alley), "--save-map", str(tmp_path / place)])
    with pytest.raises(BadArgument, match="method oracle keeps no map"):
        run(["--world", str(alley), "--method", "oracle", "--save-map", str(tmp_path / "map.yaml")])
    assert not list(tmp_path.glob("map*"))
