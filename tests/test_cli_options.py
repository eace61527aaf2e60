"""Every option of every command with odd values: done, or refused by one line and exit code 2; never a traceback."""

import contextlib
import io
import re
from functools import cache

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vuca_nav.cli import main
from vuca_nav.errors import VucaError

COMMANDS = {
    ("run",): ("--world", "square", "--movers", "0", "--method", "dwa-dh"),
    ("list",): ("worlds",),
    ("eval",): ("smoke", "--out", "out"),
    ("compare",): ("one", "other"),
    ("report",): ("one", "--out", "pages"),
    ("heatmap",): ("--world", "square", "--movers", "0", "--out", "h.png"),
    ("bench",): (),
    ("train", "go-straight"): ("--out", "runs"),
    ("train", "fusion-plus"): ("--out", "runs"),
    ("train", "critic"): ("--out", "runs"),
    ("train", "locomotion"): ("--out", "runs"),
}
"""Commands, each with arguments that it accepts."""
ODD = (
    "", " ", "nan", "-nan", "inf", "-inf", "1e999", "-1e999", "-1", "0", "-0.0", "1.5", "1e-320", "9" * 25,
    "-" + "9" * 25, "0x10", "1_0", "١", "ü", "ö/ä.png", "\udcff", "a\nb", "/nowhere/x", ".", "..", "/",
    "/dev/null", "/proc/self/mem", "--", "-", "{}", "None", "True", "%s", "x" * 300, "x.yaml", "barn:x", "3:1",
    "1:99999999999999999999", ":", "🤖",
)  # fmt: skip


class _Checked(VucaError):
    """All arguments were accepted, and the work would begin."""


@pytest.fixture(autouse=True)
def _no_work(monkeypatch, tmp_path):
    def begin(*_args, **_settings):
        raise _Checked("all arguments are good")

    monkeypatch.chdir(tmp_path)
    for work in (
        "eval.episode.Episode.run", "eval.episode.Episode.begin", "eval.evaluate.evaluate",
        "eval.bench.loop.run_benchmarks", "train.ppo.loop.TrainingLoop.run",
    ):  # fmt: skip
        monkeypatch.setattr(work, begin)


def answer(*argv: str) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(argv)
    return code, out.getvalue(), err.getvalue()


@cache
def options_of(command: tuple[str, ...]) -> tuple[str, ...]:
    code, text, _ = answer(*command, "--help")
    assert code == 0
    found = sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text)) - {"--help", "--serve", "--spawn"})
    assert found
    return tuple(found)


def assert_done_or_refused(argv: tuple[str, ...]) -> None:
    code, _, err = answer(*argv)
    assert code in (0, 2), (argv, err)
    if code == 2:
        *notes, line = err.splitlines()
        assert line.startswith(f"vuca {argv[0]}: "), (argv, err)
        assert not notes or "so the shipped fusion-plus drives" in notes[0], (argv, err)


def arguments() -> st.SearchStrategy[tuple[str, ...]]:
    texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)
    numbers = st.floats().map(str) | st.integers().map(str)
    values = st.lists(st.sampled_from(ODD) | numbers | texts, min_size=1, max_size=3)

    def with_command(command: tuple[str, ...]) -> st.SearchStrategy[tuple[str, ...]]:
        option = st.sampled_from(options_of(command))
        return st.tuples(option, values).map(lambda odd: (*command, *COMMANDS[command], odd[0], *odd[1]))

    return st.sampled_from(list(COMMANDS)).flatmap(with_command)


FUZZ = {"deadline": None, "derandomize": True, "database": None}
UNHEALTHY = (HealthCheck.function_scoped_fixture, HealthCheck.too_slow)


@settings(max_examples=120, suppress_health_check=UNHEALTHY, **FUZZ)
@given(st.data())
def test_odd_values_are_answered_by_one_line(data):
    assert_done_or_refused(data.draw(arguments()))


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_option_with_every_odd_value(command):
    for option in options_of(command):
        for value in ODD:
            assert_done_or_refused((*command, *COMMANDS[command], option, value))


@pytest.mark.slow
@settings(max_examples=3000, suppress_health_check=UNHEALTHY, **FUZZ)
@given(st.data())
def test_many_odd_values_are_answered_by_one_line(data):
    assert_done_or_refused(data.draw(arguments()))
