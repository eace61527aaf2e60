"""Other people's data, where a machine has them: ``VUCA_DATA``, or ``../shared/data`` beside the checkout."""

import os
from pathlib import Path

import pytest

_CHECKOUT = Path(__file__).parents[1]


def data_folder() -> Path:
    """Folder of the data, there or not."""
    return Path(os.environ.get("VUCA_DATA", _CHECKOUT.parent / "shared" / "data"))


def data(*parts: str) -> Path:
    """A file or folder of the data; the test that asks for it is skipped where it is missing."""
    path = data_folder().joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no {path}: set VUCA_DATA to the folder of the data")
    return path


def data_files(pattern: str) -> list:
    """Parameters for a test over files of the data, or a single skipped one."""
    found = sorted(data_folder().glob(pattern))
    if not found:
        reason = f"no {data_folder() / pattern}: set VUCA_DATA to the folder of the data"
        return [pytest.param(None, marks=pytest.mark.skip(reason=reason))]
    return [pytest.param(path, id=path.stem) for path in found]
