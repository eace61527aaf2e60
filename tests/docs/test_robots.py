"""The table of responses is that of the files."""

import json

import pytest

from robots.registry import ROBOTS
from tests.docs.pages import DOCS, ROOT

FILES = sorted((ROOT / "robots" / "bodies" / "responses").glob("*.json"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_table_has_the_response_of_each_body(file):
    page = (DOCS / "robots.md").read_text(encoding="utf-8")
    response = json.loads(file.read_text())
    for axis in (name for name in response if name != "robot"):
        figures = [f"{response[axis][key]:.3f}" for key in ("gain", "lag", "delay", "noise", "explained")]
        assert f"| {' | '.join([f'`{file.stem}`', axis, *figures])} |" in page


def test_every_robot_has_a_response():
    assert {file.stem for file in FILES} == set(ROBOTS)
