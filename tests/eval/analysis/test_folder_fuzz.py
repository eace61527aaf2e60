"""Damaged folders of evaluations: each is refused in one line, or reported and compared."""

import copy
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eval.analysis.compare import compare, read_methods, table
from eval.analysis.report.pages import write_reports
from eval.episode import EpisodeConfig
from tests.eval.jobs import episode_by_hash
from tests.fuzz import FAST, SLOW
from vuca_nav.errors import VucaError

CONFIG = {
    "config": {
        "suite": "square", "robot": "go2", "method": "ours", "options": {"gamma": 0.0}, "seeds": [0, 4], "episodes": 4,
    },
    "made_by": {"vuca-nav": "0.1.0", "commit": "0123456789ab"},
    "runs": [
        {"began": "2026-01-01T10:00:00+00:00", "command": "vuca eval square --out a",
         "machine": {"cpu": "a", "cores": 8, "os": "Linux", "python": "3.11.7"}},
    ],
}  # fmt: skip
ROWS = [{**episode_by_hash(EpisodeConfig(world="square", robot="go2", seed=k)), "way": None} for k in range(4)]


def places(value, path=()):
    """Paths of all values of a tree."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from([10**400, "'", "\x1b[2J"]),
)
trees = st.recursive(
    leaves, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(), inner, max_size=3))
)


@st.composite
def damaged(draw, whole):
    """A tree of JSON with a few of its values replaced or left out."""
    tree = copy.deepcopy(whole)
    for _ in range(draw(st.integers(0, 3))):
        path = draw(st.sampled_from([path for path in places(whole) if path]))
        try:
            at = tree
            for key in path[:-1]:
                at = at[key]
            if draw(st.booleans()):
                del at[path[-1]]
            else:
                at[path[-1]] = draw(trees)
        except (KeyError, IndexError, TypeError):  # it was taken away before
            continue
    return tree


def write_folder(folder, config, rows):
    folder.mkdir(exist_ok=True)
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return folder


def check(tmp_path, config, rows):
    bad, good = write_folder(tmp_path / "bad", config, rows), write_folder(tmp_path / "good", CONFIG, ROWS)
    for use in (report, differences):
        try:
            text = use(good, bad, tmp_path / "out")
        except VucaError as error:
            text = str(error)
            assert_short(text)
        assert "\x1b" not in text


def report(good, bad, out):
    return "".join(page.read_text() for page in write_reports([good, bad], out))


def episodes_of(folder):
    return next(iter(read_methods([folder]).values()))  # a damaged row may be of a second method


def differences(good, bad, out):
    return table("bad", "good", compare(episodes_of(good), episodes_of(bad)))


def assert_short(text):
    assert text.isprintable()
    assert len(text) < 1200


def test_the_undamaged_folder_is_reported(tmp_path):
    folder = write_folder(tmp_path / "a", CONFIG, ROWS)
    assert (tmp_path / "out" / "a.md") in write_reports([folder], tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": "1"}, "line 1: seed is '1', expected an integer from 0"),
        ({"seed": True}, "line 1: seed is True, expected an integer"),
        ({"movers": [1]}, r"line 1: movers is \[1\], expected an integer from 0 to 1e\+15 or null"),
        ({"world": None}, "line 1: world is None, expected a text"),
        ({"spl": True}, "has a row that is not the result of an episode"),
        ({"path_length": 10**400}, "has a row that is not the result of an episode"),
    ],
)
def test_a_row_of_other_kinds_is_named(tmp_path, change, message):
    folder = write_folder(tmp_path / "a", CONFIG, [{**ROWS[0], **change}])
    with pytest.raises(VucaError, match=message):
        write_reports([folder], tmp_path / "out")


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({**CONFIG, "runs": ["x"]}, "a run is not an object"),
        ({**CONFIG, "runs": [{"command": "a 'b"}]}, "a run: command is .* expected a command or null"),
        ({**CONFIG, "config": {"seeds": [1]}}, r"seeds is \[1\], expected two integers or null"),
        ({**CONFIG, "config": {"options": 1}}, "options is 1, expected an object or null"),
    ],
)
def test_a_configuration_of_other_kinds_is_named(tmp_path, config, message):
    with pytest.raises(VucaError, match=message):
        write_reports([write_folder(tmp_path / "a", config, ROWS)], tmp_path / "out")


@FAST
@given(config=damaged(CONFIG), rows=damaged(ROWS))
def test_damaged_folders(tmp_path, config, rows):
    check(tmp_path, config, rows)


@pytest.mark.slow
@SLOW
@given(config=damaged(CONFIG), rows=damaged(ROWS))
def test_many_damaged_folders(tmp_path, config, rows):
    check(tmp_path, config, rows)
