"""This project's packages beside files of the same names: ``eval``, ``train``, ``robots`` and ``worlds`` are common."""

import importlib
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType

from vuca_nav.errors import VucaError

PACKAGES = ("worlds", "robots", "eval", "train")
"""Top-level packages beside ``vuca_nav``."""
_ROOT = Path(__file__).resolve().parents[1]


class Shadowed(VucaError):
    """A package of this project that a module of the same name stands before."""

    def __init__(self, package: str, file: str):
        super().__init__(
            f"{file} shadows the package {package!r} of vuca-nav: rename it, or start where it is not on sys.path"
        )


def prefer_own_packages() -> None:
    """Find this project's packages before files of the same names, which a PYTHONPATH may put first.

    Worker processes take over the path. Where nothing is shadowed the path stays as it is.

    Raises:
        Shadowed: If a module of such a name is imported already.
    """
    for name in PACKAGES:
        _check_imported(name)
    if any(_shadow(name) is not None for name in PACKAGES):
        sys.path.insert(0, str(_ROOT))
        importlib.invalidate_caches()


def import_own(module: str) -> ModuleType:
    """Import a module of this project in a program that is not ours, beside whose script may be a file of its name.

    Args:
        module: Full name, in one of ``PACKAGES``.

    Raises:
        Shadowed: If the program has imported a module of the package's name already.
    """
    package = module.partition(".")[0]
    _check_imported(package)
    if package in sys.modules or _shadow(package) is None:
        return importlib.import_module(module)
    before = sys.path.copy()
    sys.path.insert(0, str(_ROOT))
    try:
        return importlib.import_module(module)
    finally:
        sys.path[:] = before


def _check_imported(package: str) -> None:
    module = sys.modules.get(package)
    if module is not None and not _is_own(package, getattr(module, "__file__", None)):
        raise Shadowed(package, str(getattr(module, "__file__", None) or package))


def _shadow(package: str) -> str | None:
    """File that an import of the package would find instead of ours; None if it finds ours or nothing."""
    spec = PathFinder.find_spec(package)
    if spec is None or _is_own(package, spec.origin):
        return None
    return spec.origin or package


def _is_own(package: str, file: str | None) -> bool:
    return file is not None and Path(file).resolve() == _ROOT / package / "__init__.py"
