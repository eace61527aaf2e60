"""Configurations as plain data, for YAML and JSON, and back: every field once, each of its own type, none left out."""

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from vuca_nav.data_files import shown
from vuca_nav.errors import VucaError

Config = TypeVar("Config")

MOST_WHOLE = 2**53
"""Greatest magnitude of a whole number: beyond it a float does not hold them all."""


def to_plain(value: Any) -> Any:
    """A configuration as mappings, lists, texts, numbers, true and false, None.

    Args:
        value: A dataclass, a named tuple, a tuple, an array, a path or a plain value; nested as it may be.
    """
    if is_dataclass(value):
        return {entry.name: to_plain(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: to_plain(part) for name, part in value._asdict().items()}  # type: ignore[attr-defined]
    if isinstance(value, tuple | list):
        return [to_plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value


def from_plain(kind: type[Config], value: Any, source: str, wrong: type[VucaError]) -> Config:
    """The configuration of that class that ``to_plain`` made.

    Args:
        kind: A dataclass whose fields are numbers, texts, true or false, paths, literals, arrays of numbers, tuples,
            named tuples and dataclasses of these, or None.
        value: Plain data of an untrusted source.
        source: Name of the source, which begins each message.
        wrong: Class of the errors.

    Raises:
        VucaError: Of the class ``wrong``: if a field is missing, unknown, of another type, or out of its range.
    """
    return _Reader(source, wrong).read(kind, value, "")


class _Reader:
    """Reads plain data of one source."""

    def __init__(self, source: str, wrong: type[VucaError]):
        self._source, self._wrong = source, wrong

    def read(self, kind: Any, value: Any, field: str) -> Any:
        """A value of some type, which stands in a field."""
        origin = get_origin(kind)
        if origin in (Union, types.UnionType):
            return self._one_of(get_args(kind), value, field)
        if origin is Literal:
            names = get_args(kind)
            if not any(value == name and type(value) is type(name) for name in names):
                raise self._error(field, value, " or ".join(map(repr, names)))
            return value
        if origin is tuple:
            return self._tuple(get_args(kind), value, field)
        if origin is np.ndarray:
            return self._array(value, field)
        if kind is float:
            return self._float(value, field)
        if kind is int:
            if not isinstance(value, int) or isinstance(value, bool) or abs(value) > MOST_WHOLE:
                raise self._error(field, value, "a whole number")
            return value
        if kind is bool:
            if not isinstance(value, bool):
                raise self._error(field, value, "true or false")
            return value
        if kind in (str, Path):
            if not isinstance(value, str):
                raise self._error(field, value, "a text")
            return kind(value)
        return self._structure(kind, value, field)

    def _one_of(self, kinds: tuple[Any, ...], value: Any, field: str) -> Any:
        """A value of the first type that takes it; the last one's complaint if none does."""
        if value is None and type(None) in kinds:
            return None
        *others, last = sorted((kind for kind in kinds if kind is not type(None)), key=lambda k: k is Path)
        for kind in others:
            try:
                return self.read(kind, value, field)
            except VucaError:
                continue
        return self.read(last, value, field)

    def _float(self, value: Any, field: str) -> float:
        if not isinstance(value, int | float) or isinstance(value, bool) or value != value:  # NaN
            raise self._error(field, value, "a number")
        try:
            return float(value)
        except OverflowError:
            raise self._error(field, value, "a number of double precision") from None

    def _tuple(self, kinds: tuple[Any, ...], value: Any, field: str) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise self._error(field, value, "a list")
        if len(kinds) == 2 and kinds[1] is Ellipsis:
            kinds = (kinds[0],) * len(value)
        if len(value) != len(kinds):
            raise self._error(field, value, f"a list of {len(kinds)}")
        return tuple(self.read(kind, part, f"{field}[{k}]") for k, (kind, part) in enumerate(zip(kinds, value)))

    def _array(self, value: Any, field: str) -> np.ndarray:
        """Points as an array (n, m), or numbers as one (n,)."""
        if not isinstance(value, list) or not value:
            raise self._error(field, value, "a list of numbers or points")
        if not isinstance(value[0], list):
            return np.array([self._float(part, f"{field}[{k}]") for k, part in enumerate(value)])
        points = []
        for k, point in enumerate(value):
            if not isinstance(point, list) or len(point) != len(value[0]):
                raise self._error(f"{field}[{k}]", point, f"a point of {len(value[0])} numbers")
            points.append([self._float(part, f"{field}[{k}][{i}]") for i, part in enumerate(point)])
        return np.array(points)

    def _structure(self, kind: Any, value: Any, field: str) -> Any:
        """A dataclass or a named tuple, from a mapping of its fields."""
        names = list(kind._fields) if hasattr(kind, "_fields") else [entry.name for entry in fields(kind)]
        if not isinstance(value, Mapping):
            raise self._error(field, value, f"the fields {', '.join(names)}")
        for name in value:
            if name not in names:
                raise self._wrong(
                    f"{self._source}: {_joined(field, shown(name))}: there is no such field ({', '.join(names)})"
                )
        hints = get_type_hints(kind)
        missing = [name for name in names if name not in value]
        if missing:
            raise self._wrong(f"{self._source}: {_joined(field, missing[0])} is missing")
        parts = {name: self.read(hints[name], value[name], _joined(field, name)) for name in names}
        try:
            return kind(**parts)
        except VucaError as error:
            raise self._wrong(f"{self._source}: {_joined(field, '')}{error}") from error

    def _error(self, field: str, value: Any, right: str) -> VucaError:
        return self._wrong(f"{self._source}: {field or 'the whole'} is {shown(repr(value))}, expected {right}")


def _joined(field: str, name: str) -> str:
    """Path of a field within another: ``slam.matcher``; the other's with a colon where the name is empty."""
    if not name:
        return f"{field}: " if field else ""
    return f"{field}.{name}" if field else name
