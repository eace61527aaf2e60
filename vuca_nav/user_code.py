"""Python of the user's own, named ``module:name`` on the command line or in a file and loaded only where trusted."""

import hashlib
import importlib
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from vuca_nav.errors import BadArgument

_NAME = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


class Wanted(NamedTuple):
    """What a name of the user's own stands for, in the words of the messages."""

    source: str
    """Where the name was given, which begins each message, as in "--method my_planner:build"."""
    what: str
    """What it is, as in "a method of your own"."""
    example: str
    """A right name."""
    right: str
    """What the module should have by that name, as in "a function of a Request"."""


class Found(NamedTuple):
    """What a name stands for."""

    module: ModuleType
    thing: Callable[..., Any]
    """The function or class of that name in it."""

    @property
    def digest(self) -> str:
        """SHA-256 of the module's source."""
        file = self.module.__file__
        return hashlib.sha256(b"" if file is None else Path(file).read_bytes()).hexdigest()


def load_user_code(name: str, wanted: Wanted) -> Found:
    """Import the user's module, which runs it, and look the name up in it.

    A module that Python does not find otherwise is looked for in the working directory.

    Args:
        name: ``module:name``.
        wanted: Words for the messages.

    Raises:
        BadArgument: The name is of another form, the module is not found or raises an exception, or it has nothing
            by that name that can be called.
    """
    source = wanted.source
    if not _NAME.fullmatch(name):
        raise BadArgument(
            f"{source}: {wanted.what} is the names of a module and of a "
            f"{'class' if wanted.right.startswith('a class') else 'function'} in it, as in {wanted.example}"
        )
    module_name, _, attribute = name.partition(":")
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # last, so that no file there hides a package
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise BadArgument(f"{source}: {told(error)}") from error
        raise BadArgument(f"{source}: there is no module {error.name!r} in {Path.cwd()} or on Python's path") from None
    except Exception as error:  # whatever the user's code raises is the user's to mend
        raise BadArgument(f"{source}: {told(error)}") from error
    found = getattr(module, attribute, None)
    if not callable(found):
        kind = "class" if wanted.right.startswith("a class") else "function"
        what = "has no" if found is None else f"has, but not as a {kind},"
        raise BadArgument(f"{source}: the module {module_name!r} {what} {attribute!r}; {wanted.right} would be right")
    return Found(module, found)


def told(error: Exception) -> str:
    """An exception of the user's code in one line, with the place where it was raised."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"
