"""Damaged robots: each is refused in one line, or makes a body that stands and drives."""

import copy
import math
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from robots.own.body import OwnRobot
from tests.fuzz import FAST, SLOW
from tests.robots.own.robots import MJCF, ROBOT
from vuca_nav.errors import VucaError

FILE = yaml.safe_load(ROBOT)
FEWER = settings(FAST, max_examples=25)
"""Each example compiles a model and drives it for some seconds."""
numbers = st.one_of(
    st.floats(-3.0, 3.0),
    st.floats(),
    st.integers(-2, 400),
    st.sampled_from([0, -0.0, 1e-9, 1e-320, 1e5, 1e300, 2**64, math.inf, -math.inf, math.nan]),
)
words = st.sampled_from(
    ["", "left", "left_wheel", "nan", "1 2", "0 0 0", "1e400", "mesh", "box", "hinge", "a/b", "é", "\x7f"]
)


def places(value, path=()):
    """Paths of all values of a tree."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


PLACES = [path for path in places(FILE) if path]


@st.composite
def damaged_files(draw):
    """The robot's file with some values replaced or left out."""
    robot = copy.deepcopy(FILE)
    for _ in range(draw(st.integers(0, 2))):
        path = draw(st.sampled_from(PLACES))
        try:
            at = robot
            for key in path[:-1]:
                at = at[key]
            if draw(st.integers(0, 3)) == 0:
                del at[path[-1]]
            else:
                at[path[-1]] = draw(st.one_of(numbers, words, st.none(), st.lists(numbers, max_size=3)))
        except (KeyError, IndexError, TypeError):  # it was taken away before
            continue
    return yaml.safe_dump(robot)


@st.composite
def damaged_descriptions(draw):
    """The MJCF with some elements left out, repeated or moved, and some attributes replaced."""
    root = ElementTree.fromstring(MJCF)
    for _ in range(draw(st.integers(0, 3))):
        parents = [element for element in root.iter() if len(element)]
        parent = draw(st.sampled_from(parents))
        child = parent[draw(st.integers(0, len(parent) - 1))]
        how = draw(st.sampled_from(["attribute", "attribute", "attribute", "drop", "repeat", "tag"]))
        if how == "attribute" and child.attrib:
            name = draw(st.sampled_from(sorted(child.attrib)))
            count = len(child.attrib[name].split())
            values = [draw(numbers) for _ in range(count)]
            child.attrib[name] = draw(st.one_of(words, st.just(" ".join(f"{value:.6g}" for value in values))))
        elif how == "drop":
            parent.remove(child)
        elif how == "repeat":
            parent.append(copy.deepcopy(child))
        elif how == "tag":
            child.tag = draw(st.sampled_from(["geom", "body", "joint", "site", "mesh", "include", "default", "x"]))
        if not len(root):
            break
    return ElementTree.tostring(root, encoding="unicode")


def check(file, description):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.yaml"
        path.write_text(file)
        (path.parent / "cart.xml").write_text(description, encoding="utf-8")
        try:
            body = OwnRobot(path)
        except VucaError as refused:
            message = str(refused)
            assert message.isprintable(), message
            return
    assert np.isfinite(body.spec.footprint).all()
    assert 0.0 < body.spec.radius < 3.0
    assert body.height > 0.0


@given(damaged_files(), damaged_descriptions())
@FEWER
def test_damaged_robots_are_refused_or_drive(file, description):
    check(file, description)


@pytest.mark.slow
@given(damaged_files(), damaged_descriptions())
@SLOW
def test_many_damaged_robots_are_refused_or_drive(file, description):
    check(file, description)
