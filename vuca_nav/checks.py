"""Checks of a configuration's fields: a wrong one is told by its name, its value and what would be right."""

import math
from collections.abc import Callable
from typing import Any

from vuca_nav.errors import BadArgument


def check_fields(config: object, right: str, test: Callable[[Any], bool], *names: str) -> None:
    """Check some fields of a configuration.

    Args:
        config: A dataclass.
        right: What they must be, as in "1 or more".
        test: Whether a value is so; of a number that is none (NaN) it must be false.
        names: Of the fields.

    Raises:
        BadArgument: For the first field that is not.
    """
    for name in names:
        value = getattr(config, name)
        if not test(value):
            raise BadArgument(f"{name} must be {right}, got {value!r}")


def check_counts(config: object, *names: str) -> None:
    """Fields that are 1 or more; raises as ``check_fields``."""
    check_fields(config, "1 or more", lambda value: value >= 1, *names)


def check_positive(config: object, *names: str) -> None:
    """Fields that are above 0, and finite; raises as ``check_fields``."""
    check_fields(config, "above 0 and finite", lambda value: 0.0 < value < math.inf, *names)


def check_not_negative(config: object, *names: str) -> None:
    """Fields that are 0 or more, and finite; raises as ``check_fields``."""
    check_fields(config, "0 or more and finite", lambda value: 0.0 <= value < math.inf, *names)


def check_shares(config: object, *names: str) -> None:
    """Fields that are shares; raises as ``check_fields``."""
    check_fields(config, "a share from 0 to 1", lambda value: 0.0 <= value <= 1.0, *names)


def check_ranges(config: object, *names: str) -> None:
    """Fields that are two numbers, the first no more than the second; raises as ``check_fields``."""
    right = "two numbers, the first 0 or more and the second no less, and finite"
    check_fields(config, right, lambda pair: 0.0 <= pair[0] <= pair[1] < math.inf, *names)
