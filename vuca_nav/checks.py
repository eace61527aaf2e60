"""Checks of a configuration's fields: an error names the field, its value and what would be right."""

import math
from collections.abc import Callable
from typing import Any

from vuca_nav.errors import BadArgument


def check_fields(config: object, right: str, test: Callable[[Any], bool], *names: str) -> None:
    """Check some fields of a configuration.

    Args:
        config: A dataclass.
        right: Description of right values, as in "1 or more".
        test: Tells whether a value is right; it must be false for NaN.
        names: Names of the fields.

    Raises:
        BadArgument: A field is wrong; the first one is named.
    """
    for name in names:
        value = getattr(config, name)
        try:
            is_right = test(value)
        except (TypeError, ValueError, OverflowError):  # a text where a number belongs
            is_right = False
        if not is_right:
            raise BadArgument(f"{name} must be {right}, got {value!r}")


def check_counts(config: object, *names: str) -> None:
    """Check that fields are 1 or more; raises as ``check_fields``."""
    check_fields(config, "1 or more", lambda value: value >= 1, *names)


def check_positive(config: object, *names: str) -> None:
    """Check that fields are above 0 and finite; raises as ``check_fields``."""
    check_fields(config, "above 0 and finite", lambda value: 0.0 < value < math.inf, *names)


def check_not_negative(config: object, *names: str) -> None:
    """Check that fields are 0 or more and finite; raises as ``check_fields``."""
    check_fields(config, "0 or more and finite", lambda value: 0.0 <= value < math.inf, *names)


def check_shares(config: object, *names: str) -> None:
    """Check that fields are shares, 0 to 1; raises as ``check_fields``."""
    check_fields(config, "a share from 0 to 1", lambda value: 0.0 <= value <= 1.0, *names)


def check_ranges(config: object, *names: str) -> None:
    """Check that fields are two numbers, the first no more than the second; raises as ``check_fields``."""
    right = "two numbers, the first 0 or more and the second no less, and finite"
    check_fields(config, right, lambda pair: 0.0 <= pair[0] <= pair[1] < math.inf, *names)
