"""Checks of what the folder of an evaluation says, before anything is computed of it: it may come from elsewhere."""

import shlex
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument

MOST = 1e15
"""Greatest magnitude of a number in a row: sums and tables of more would overflow or be unreadable."""


class Kind(NamedTuple):
    """Kind of a field's value."""

    right: str
    """Description of right values."""
    test: Callable[[Any], bool]

    def or_none(self) -> "Kind":
        """The kind that also has None."""
        return Kind(f"{self.right} or null", lambda value: value is None or self.test(value))


def is_number(value: Any) -> bool:
    """Whether a JSON value is a number of a sensible size; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST


def _is_count(value: Any) -> bool:
    return is_number(value) and isinstance(value, int) and value >= 0


def _is_command(value: Any) -> bool:
    try:
        return isinstance(value, str) and shlex.split(value) is not None
    except ValueError:  # quotes that do not end
        return False


TEXT = Kind("a text", lambda value: isinstance(value, str))
COUNT = Kind(f"an integer from 0 to {MOST:g}", _is_count)
NUMBER = Kind("a number", is_number)
NUMBERS = Kind("a list of numbers", lambda value: isinstance(value, list) and all(map(is_number, value)))
PAIR = Kind("a list of two numbers", lambda value: NUMBERS.test(value) and len(value) == 2)
TRIPLE = Kind("a list of three numbers", lambda value: NUMBERS.test(value) and len(value) == 3)
PLACE = Kind(
    "a list of two numbers and a third or null",
    lambda value: TRIPLE.test(value) or (isinstance(value, list) and PAIR.test(value[:2]) and value[2:] == [None]),
)
FLAG = Kind("true or false", lambda value: isinstance(value, bool))
SEEDS = Kind("two integers", lambda value: isinstance(value, list) and len(value) == 2 and all(map(_is_count, value)))
OBJECT = Kind("an object", lambda value: isinstance(value, dict))

ROW_KINDS: Mapping[str, Kind] = {
    "world": TEXT,
    "region": COUNT.or_none(),
    "movers": COUNT.or_none(),
    "speed": NUMBER,
    "sighted": NUMBER.or_none(),
    "without": TEXT,
    "obstacles": TEXT.or_none(),
    "unknown": TEXT.or_none(),
    "tolerance": NUMBER.or_none(),
    "time_limit": NUMBER.or_none(),
    "robot": TEXT,
    "start": PLACE.or_none(),
    "goal": PAIR.or_none(),
    "seed": COUNT,
    "method": TEXT,
    "policy": TEXT.or_none(),
    "gate": TEXT.or_none(),
    "without_expert": COUNT.or_none(),
    "no_shield": FLAG.or_none(),
    "critic": TEXT.or_none(),
    "gamma": NUMBER.or_none(),
    "monitor": FLAG.or_none(),
    "outcome": TEXT,
    "way": TEXT.or_none(),
    "bits": TEXT.or_none(),
    "contact": OBJECT.or_none(),
    "failure": OBJECT.or_none(),
    "why": TEXT.or_none(),
    "monitor_ticks": OBJECT.or_none(),
}
"""Fields of a row; the numbers of its metrics are checked by ``eval.analysis.summary.is_result``."""
CONFIG_KINDS: Mapping[str, Kind] = {
    "suite": TEXT.or_none(),
    "robot": TEXT.or_none(),
    "method": TEXT.or_none(),
    "options": OBJECT.or_none(),
    "seeds": SEEDS.or_none(),
    "episodes": COUNT.or_none(),
}
"""Fields of an evaluation's configuration that pages show."""
RUN_KINDS: Mapping[str, Kind] = {
    "began": TEXT.or_none(),
    "command": Kind("a command", _is_command).or_none(),
    "machine": OBJECT.or_none(),
}
"""Fields of a run of the command."""


def check_values(content: Any, kinds: Mapping[str, Kind], source: str) -> None:
    """Check the fields of an object that are there and known.

    Args:
        content: A value of JSON.
        kinds: Kinds of the fields.
        source: Name of the object, which begins the message.

    Raises:
        BadArgument: If it is no object, or a field is of another kind.
    """
    if not isinstance(content, dict):
        raise BadArgument(f"{source} is not an object")
    for name, kind in kinds.items():
        if name in content and not kind.test(content[name]):
            raise BadArgument(f"{source}: {name} is {shown(repr(content[name]))}, expected {kind.right}")
