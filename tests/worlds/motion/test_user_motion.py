"""Motion by a class of the user's own: asked at each tick, and told off in one line."""

import math
import sys

import numpy as np
import pytest

from vuca_nav.errors import BadArgument
from vuca_nav.types import Pose2
from worlds.motion.movers import MoverField
from worlds.world import Cylinder, Mover, MoverPart, UserMotion, World

CIRCLING = """
import math
from worlds.motion.user_motion import Place, UserMover

class Circling(UserMover):
    def place(self, now):
        radius, rate = self.options["radius"], self.options["rate"]
        a = rate * now.time
        return Place(5 + radius * math.cos(a), 5 + radius * math.sin(a),
                     -radius * rate * math.sin(a), radius * rate * math.cos(a))

class Shy(UserMover):
    def place(self, now):
        if now.robot is None:
            return Place(now.x, now.y, 0.0, 0.0)
        if math.hypot(now.x - now.robot[0], now.y - now.robot[1]) < 2.0:
            return None
        return Place(now.x, now.y, 0.0, 0.0)

class Hasty(UserMover):
    def place(self, now):
        return Place(now.x, now.y, 100.0, 0.0)

class Broken(UserMover):
    def place(self, now):
        return Place(now.x, float("nan"), 0.0, 0.0)

class Raising(UserMover):
    def place(self, now):
        raise KeyError("lost")

class NoMover:
    pass
"""


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    (tmp_path / "own_motions.py").write_text(CIRCLING)
    monkeypatch.delitem(sys.modules, "own_motions", raising=False)
    yield
    sys.modules.pop("own_motions", None)


def field_of(name, options=(), sighted=None):
    parts = (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.0)),)
    motion = UserMotion(f"own_motions:{name}", options)
    mover = Mover("cylinder", parts, 0.3, Pose2(7.0, 5.0, 0.0), motion, sighted)
    return MoverField(World("room", 0, (0.0, 0.0, 10.0, 10.0), (), (mover,), Pose2(1.0, 1.0, 0.0), (9.0, 9.0)))


def test_it_goes_where_the_class_says():
    field = field_of("Circling", (("radius", 2.0), ("rate", 0.5)))
    for _ in range(90):
        field.step(1 / 30)
    np.testing.assert_allclose(field.poses[0, :2], (5 + 2 * math.cos(1.5), 5 + 2 * math.sin(1.5)), atol=1e-6)


def test_a_sighted_one_sees_the_robot_and_may_vanish():
    for sighted, there in ((True, False), (False, True), (None, True)):
        field = field_of("Shy", sighted=sighted)
        field.step(1 / 30, (6.0, 5.0, 0.3))
        assert bool(field.present[0]) == there
    field = field_of("Shy", sighted=True)
    field.step(1 / 30, (6.0, 5.0, 0.3))
    field.step(1 / 30, (1.0, 5.0, 0.3))
    np.testing.assert_allclose(field.poses[0, :2], (7.0, 5.0))  # back where it starts


def test_a_velocity_above_its_speed_is_cut_down():
    field = field_of("Hasty")
    assert math.hypot(*field.velocities[0]) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Missing", "has no 'Missing'"),
        ("NoMover", "no class derived from"),
        ("Broken", "four finite numbers"),
        ("Raising", "KeyError: 'lost'"),
        ("Circling", "KeyError: 'radius'"),
    ],
)
def test_what_is_wrong_with_it_is_told_in_one_line(name, text):
    with pytest.raises(BadArgument) as told:
        field_of(name)
    assert text in str(told.value)
    assert "\n" not in str(told.value)
