"""YAML as data: the core schema of YAML 1.2, restricted, with bounds on everything, and the line of every field.

PyYAML only parses: what it would make of a scalar is YAML 1.1, with dates, octal 010 and ``yes`` for true. Here a
scalar without quotes is null, ``true`` or ``false``, an integer (010 is 10; 0o17 and 0x1F as YAML 1.2 has them), a
float (1e1 and .inf, too), else a text. Refused are tags, merge keys, a key given twice or one that is no text, a second
document, an anchor that refers to itself, and whatever exceeds ``LIMITS``.
"""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from vuca_nav.data_files import read_text, shown
from vuca_nav.errors import VucaError


class Limits(NamedTuple):
    """Bounds of a document."""

    nodes: int = 200_000
    """Greatest number of values; an alias counts as all that it stands for. 10,000 obstacles have 110,000."""
    depth: int = 32
    """Greatest nesting; a scene file has 7."""
    aliases: int = 1000
    """Greatest number of aliases; PyYAML writes one wherever an object is repeated."""
    digits: int = 40
    """Greatest number of digits of an integer; 2^128 has 39."""


LIMITS = Limits()

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CONSTANTS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
}
_INTEGERS = ((re.compile(r"[-+]?[0-9]+"), 10), (re.compile(r"0o[0-7]+"), 8), (re.compile(r"0x[0-9a-fA-F]+"), 16))
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


class Document(NamedTuple):
    """A document with its places."""

    value: Any
    """Mappings, lists, texts, numbers, true and false, None."""
    lines: dict[str, int]
    """Line of each field, counted from 1, by its path as messages write it: ``movers[3].motion.speed``."""

    def line_of(self, field: str) -> int | None:
        """Line of a field, or of what holds it if it has none of its own, being missing."""
        while field and field not in self.lines:
            field = field[: max(field.rfind("."), field.rfind("["), 0)]
        return self.lines.get(field)


def read_yaml(path: str | Path, wrong: type[VucaError], limits: Limits = LIMITS) -> Document:
    """Read a YAML file; an empty one is None.

    Args:
        path: Path of the file.
        wrong: Class of the errors.
        limits: Bounds of the document.

    Raises:
        VucaError: Of the class ``wrong``: if the file cannot be read, is not YAML, or holds what is refused; the
            message gives line and column, and the field's path.
    """
    text = read_text(path, wrong)
    try:
        return _Reader(yaml.parse(text, Loader=_Loader), limits).document()
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        problem = f"not YAML: {problem or getattr(error, 'reason', 'it cannot be parsed')}"
        raise wrong(f"{path}: {_place(mark)}{problem}") from error
    except _Refused as refused:
        raise wrong(f"{path}: {_place(refused.mark)}{refused}") from None


def is_plain_text(scalar: str) -> bool:
    """Whether a scalar without quotes is a text, not null, true or false, or a number."""
    patterns = (_FLOAT, *(pattern for pattern, _ in _INTEGERS))
    return scalar not in _CONSTANTS and not any(pattern.fullmatch(scalar) for pattern in patterns)


def _place(mark: Any) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""


class _Refused(Exception):
    """YAML that is not taken."""

    def __init__(self, event: yaml.Event, field: str, problem: str):
        super().__init__(f"{field}: {problem}" if field else problem)
        self.mark = event.start_mark


class _Reader:
    """Builds a document from the events of a parser."""

    def __init__(self, events: Iterator[yaml.Event], limits: Limits):
        self._events, self._limits = events, limits
        self._nodes = self._aliases = 0
        self._lines: dict[str, int] = {}
        self._anchors: dict[str, tuple[Any, int] | None] = {}
        """Value and number of nodes of each anchor; None while its value is being read."""

    def document(self) -> Document:
        """Read the whole document."""
        value = None
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if self._lines:
                    raise _Refused(event, "", "a second document; one in a file would be right")
                value = self._value(next(self._events), "", 0)
        return Document(value, self._lines)

    def _value(self, event: yaml.Event, field: str, depth: int) -> Any:
        """The value that begins with an event."""
        self._lines[field] = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            return self._aliased(event, field)
        before = self._nodes
        self._count(event, field, 1)
        tag, anchor = event.tag, event.anchor  # type: ignore[attr-defined]
        if tag is not None:
            raise _Refused(event, field, f"a tag ({shown(tag)}) is not YAML as it is taken; none would be right")
        if anchor is not None:
            self._anchors[anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            value = self._scalar(event, field)
        elif depth == self._limits.depth:
            raise _Refused(event, field, f"nested too deeply; at most {depth} levels would be right")
        elif isinstance(event, yaml.MappingStartEvent):
            value = self._mapping(field, depth + 1)
        else:
            value = self._sequence(field, depth + 1)
        if anchor is not None:
            self._anchors[anchor] = value, self._nodes - before
        return value

    def _sequence(self, field: str, depth: int) -> list[Any]:
        items: list[Any] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(event, f"{field}[{len(items)}]", depth))
        return items

    def _mapping(self, field: str, depth: int) -> dict[str, Any]:
        items: dict[str, Any] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or event.tag is not None:
                raise _Refused(event, field, "a key that is not a plain text; a field's name would be right")
            key, name = event.value, shown(event.value)
            if key == "<<" and event.implicit[0]:
                raise _Refused(event, field, "a merge key (<<); the fields written out would be right")
            if key in items:
                raise _Refused(event, "", f"not YAML: the key {name!r} a second time; once would be right")
            items[key] = self._value(next(self._events), f"{field}.{name}" if field else name, depth)
        return items

    def _scalar(self, event: yaml.ScalarEvent, field: str) -> Any:
        text, most = event.value, self._limits.digits
        if not event.implicit[0]:  # in quotes, or a block
            return text
        if text in _CONSTANTS:
            return _CONSTANTS[text]
        for pattern, base in _INTEGERS:
            if pattern.fullmatch(text):
                if len(text) > most:
                    raise _Refused(event, field, f"an integer of {len(text)} digits; at most {most} would be right")
                return int(text, base)
        return float(text) if _FLOAT.fullmatch(text) else text

    def _aliased(self, event: yaml.AliasEvent, field: str) -> Any:
        self._aliases += 1
        name, most = f"*{shown(event.anchor)}", self._limits.aliases
        if self._aliases > most:
            raise _Refused(event, field, f"more than {most} aliases; the values written out would be right")
        if event.anchor not in self._anchors:
            raise _Refused(event, field, f"{name} without an anchor before it; the value written out would be right")
        anchored = self._anchors[event.anchor]
        if anchored is None:
            raise _Refused(event, field, f"{name} refers to itself; a value would be right")
        value, nodes = anchored
        self._count(event, field, nodes)
        return value

    def _count(self, event: yaml.Event, field: str, nodes: int) -> None:
        self._nodes += nodes
        if self._nodes > self._limits.nodes:
            raise _Refused(event, field, f"more than {self._limits.nodes} values; fewer would be right")
