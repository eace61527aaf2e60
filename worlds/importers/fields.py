"""Fields of other people's files, read with suspicion: finite numbers of a sensible size, each told by its path."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vuca_nav.data_files import shown
from worlds.checks import BadField

FARTHEST = 10_000.0
"""Greatest coordinate or size, as in scene files [m]."""
LONGEST = 1e6
"""Greatest time [s]."""
SMALLEST, LARGEST = 1e-6, 1000.0
"""Least and greatest size of a shape, as in scene files [m]."""


def is_size(*sizes: float) -> bool:
    """Whether a shape may have these sizes [m]."""
    return all(SMALLEST <= size <= LARGEST for size in sizes)


def world_name(path: str | Path) -> str:
    """Name of a world by its file: a line of at most 100 characters, as scene files and XML have it."""
    name = "".join(letter if letter.isprintable() else "_" for letter in Path(path).stem)
    return name[:100]


class Fields:
    """The fields of a mapping of a file.

    Args:
        source: Name of the file, which begins each message.
        content: The mapping.
        path: Its own path in the file, empty at the top.

    Raises:
        BadField: The content is no mapping.
    """

    def __init__(self, source: str, content: Any, path: str = ""):
        if not isinstance(content, Mapping):
            raise BadField(source, path, f"{shown(repr(content))} is not a mapping")
        self.source, self.path = source, path
        self._content: Mapping[str, Any] = content

    def __contains__(self, name: str) -> bool:
        """Whether there is such a field, and it is not null."""
        return self._content.get(name) is not None

    def error(self, name: str, problem: str) -> BadField:
        """An error about a field."""
        return BadField(self.source, self._at(name), problem)

    def number(self, name: str, low: float = -FARTHEST, high: float = FARTHEST) -> float:
        """A number in a range."""
        return self._checked(self._at(name), self._value(name), low, high)

    def text(self, name: str) -> str:
        """A text that is not empty."""
        value = self._value(name)
        if not isinstance(value, str) or not value:
            raise self.error(name, f"{shown(repr(value))} is not a text")
        return value

    def flag(self, name: str) -> bool:
        """True or false; 0 and 1 as well."""
        value = self._value(name)
        if value not in (True, False, 0, 1):
            raise self.error(name, f"{shown(repr(value))} is neither true nor false, 1 nor 0")
        return bool(value)

    def numbers(self, name: str, count: int, high: float = FARTHEST) -> tuple[float, ...]:
        """So many numbers."""
        return self._row(self._at(name), self._value(name), count, high)

    def listed(self, name: str, least: int, most: int) -> tuple[float, ...]:
        """A list of numbers, from ``least`` to ``most`` of them."""
        value = self._value(name)
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise self.error(name, f"{shown(repr(value))} is not a list of {least} to {most} numbers")
        return self._row(self._at(name), value, len(value), FARTHEST)

    def mapping(self, name: str) -> "Fields":
        """A mapping within."""
        return Fields(self.source, self._value(name), self._at(name))

    def only(self, names: Sequence[str]) -> None:
        """Refuse fields of other names."""
        unknown = [name for name in self._content if name not in names]
        if unknown:
            raise BadField(
                self.source, self.path, f"unknown field {shown(unknown[0])}; its fields are {', '.join(names)}"
            )

    def rows(self, name: str, count: int, most: int, high: float = FARTHEST) -> list[tuple[float, ...]]:
        """A list of at most so many lists, each of so many numbers; an empty one if the field is not there."""
        if name not in self:
            return []
        listed = self._list(name, most)
        return [self._row(f"{self._at(name)}[{k}]", row, count, high) for k, row in enumerate(listed)]

    def mappings(self, name: str, most: int) -> list["Fields"]:
        """A list of at most so many mappings; an empty one if the field is not there."""
        if name not in self:
            return []
        return [Fields(self.source, each, f"{self._at(name)}[{k}]") for k, each in enumerate(self._list(name, most))]

    def _list(self, name: str, most: int) -> Sequence[Any]:
        value = self._value(name)
        if not isinstance(value, list):
            raise self.error(name, f"{shown(repr(value))} is not a list")
        if len(value) > most:
            raise self.error(name, f"it has {len(value)} entries; at most {most} would be right")
        return value

    def _row(self, path: str, value: Any, count: int, high: float) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise BadField(self.source, path, f"{shown(repr(value))} is not a list of {count} numbers")
        return tuple(self._checked(f"{path}[{k}]", number, -high, high) for k, number in enumerate(value))

    def _checked(self, path: str, value: Any, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadField(self.source, path, f"{shown(repr(value))} is not a number")
        if not (low <= value <= high) or not math.isfinite(value):
            told = shown(value) if isinstance(value, int) else f"{value:g}"  # an integer may be beyond all floats
            raise BadField(self.source, path, f"{told} is out of range; {low:g} to {high:g} would be right")
        return float(value)

    def _value(self, name: str) -> Any:
        if name not in self:
            raise self.error(name, "it is missing")
        return self._content[name]

    def _at(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name
