"""Errors that a user can mend: each says what is wrong, where, and what would be right."""

from collections.abc import Iterable
from difflib import get_close_matches


class VucaError(Exception):
    """Bad input. The command line prints it as one line and exits with code 2."""


def how_to_install(extra: str) -> str:
    """Command that installs an extra of a clone: no package index has the project."""
    return f"run pip install -e '.[{extra}]' in your clone of vuca-nav"


class UnknownName(VucaError):
    """A name that is not among those available.

    Args:
        kind: Kind of the name, as in ``"robot"``.
        name: The name that was given.
        available: The names that exist.
    """

    def __init__(self, kind: str, name: str, available: Iterable[str]):
        names = sorted(available)
        by_lower_case = {available.lower(): available for available in reversed(names)}
        close = get_close_matches(name.lower(), by_lower_case, n=1)
        hint = f"; did you mean {by_lower_case[close[0]]!r}?" if close else ""
        super().__init__(f"unknown {kind} {name!r}{hint} (available: {', '.join(names)})")
        self.kind, self.name, self.available = kind, name, tuple(names)


class BadWorld(VucaError):
    """A world that cannot be used: a broken scene file, a start or goal inside an obstacle, no way through."""


class BadArgument(VucaError):
    """An argument out of its range, or one that does not go with another."""


class BadWeights(VucaError):
    """A weights file that is missing or broken, or does not fit its use."""


class BadBundle(VucaError):
    """A deployable bundle that is incomplete, changed, or of a format that is not read."""


class BadLog(VucaError):
    """A log that cannot be read, lacks what is needed, or is not of the bundle that it is replayed with."""
