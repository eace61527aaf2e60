"""What MuJoCo says of a robot, as an error of one line."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco

from robots.own.folder import BadRobot
from vuca_nav.data_files import shown

MOST_SHOWN = 300
"""Greatest length of what is shown of a message [characters]."""


@contextmanager
def as_bad_robot(path: Path) -> Iterator[None]:
    """Turn MuJoCo's errors, and its warnings of models that it cannot simulate, into BadRobot.

    Args:
        path: The file that they are about.

    Raises:
        BadRobot: With MuJoCo's words in one line.
    """
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            yield
        except (ValueError, mujoco.FatalError) as error:
            raise BadRobot(f"{path}: {_one_line(error)}") from error
    if warned:
        raise BadRobot(f"{path}: {_one_line(warned[0].message)}")


def _one_line(words: object) -> str:
    return shown(" ".join(str(words).split()), MOST_SHOWN)
