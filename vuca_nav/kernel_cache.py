"""Numba's ``njit`` with a cache of its own, which follows every source that a kernel is compiled from.

Numba's cache knows the file of a kernel and not those of the kernels it calls: after a change there the old machine
code would go on running. Here the machine code of a module's kernels lies in a folder named by the module and a hash of
its source, of the sources of this project that it imports, directly or not, and of the versions of the compiler. An
entry is one sealed file for each kernel and signature, so that processes that compile at the same time
cannot mix theirs up, and a damaged entry is compiled again.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import numba
import numba.core.config
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from vuca_nav.caches import cache_folder, read_sealed, write_sealed

_KEPT = 8
"""Versions of a module whose kernels are kept: those used last, of all checkouts that share the cache."""
_BEGAN = time.time()
"""When this process began to load its modules [s]: what it runs of a source that changed later may be older."""
_DAY = 86_400.0
"""A folder's time of use is written again after this long [s]."""
_PACKAGES = frozenset({"vuca_nav", "worlds", "robots", "eval", "train"})
_IMPORT = re.compile(r"^from ([\w.]+) import (\([^)]*\)|.*)|^import ([\w.]+)", re.MULTILINE)
_COMPILER = (
    f"{sys.implementation.cache_tag} {numba.__version__} {llvmlite.__version__} {np.__version__} "
    f"{getattr(numba.core.config, 'USING_SVML', None)}"  # Intel's functions, if the package icc_rt is installed
)


def njit(function: Callable[..., Any] | None = None, *, cache: bool = True, **options: Any) -> Any:
    """Compile a kernel as ``numba.njit`` does; what is compiled is kept from run to run.

    Args:
        function: The kernel; None where this is used with options, as a decorator.
        cache: Whether to keep it.
        **options: Options of ``numba.njit``.
    """
    if function is None:
        return lambda kernel: njit(kernel, cache=cache, **options)
    dispatcher: Any = numba.njit(function, **options)
    if cache and hasattr(dispatcher, "_cache"):  # NUMBA_DISABLE_JIT leaves the plain function
        dispatcher._cache = KernelCache(function)
    return dispatcher


class KernelCache(NullCache):
    """The machine code of one kernel, for all its signatures; the interface is Numba's.

    Args:
        function: The kernel as Python has it.
    """

    def __init__(self, function: Callable[..., Any]):
        self._function = function

    @property
    def cache_path(self) -> str | None:
        """Folder of the entries; None if there is none."""
        folder = module_folder(self._function.__module__)
        return None if folder is None else str(folder)

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """The kernel compiled for a signature; None if it has to be compiled."""
        target_context.refresh()
        folder = module_folder(self._function.__module__)
        key = self._key(sig, target_context.codegen())
        content = None if folder is None else read_sealed(self._file(folder, key))
        if content is None:
            return None
        stored_key, payload = pickle.loads(content)
        return CompileResult._rebuild(target_context, *payload) if stored_key == key else None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what was compiled for a signature, if it holds nothing that is this process's own."""
        folder = module_folder(self._function.__module__)
        if folder is None or cres.lifted or cres.library.has_dynamic_globals:
            return
        key = self._key(sig, cres.codegen)
        if not folder.exists():
            _prune(folder)
        write_sealed(self._file(folder, key), dumps((key, cres._reduce())))

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """What tells entries of a kernel apart: signature, processor, byte code, variables of a closure."""
        cells = self._function.__closure__ or ()
        held = dumps(tuple(cell.cell_contents for cell in cells)) if cells else b""
        return sig, codegen.magic_tuple(), self._function.__code__.co_code, held

    def _file(self, folder: Path, key: tuple[Any, ...]) -> Path:
        name = re.sub(r"[^\w.]", "", self._function.__qualname__)
        line = self._function.__code__.co_firstlineno
        return folder / f"{name}-{line}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"


@functools.cache
def module_folder(name: str) -> Path | None:
    """Folder of the kernels of a loaded module, which need not be there yet; None if there is none, or no place for it.

    A module has none without source, or if a source has changed since it was loaded.
    """
    digest, found = hashlib.sha256(_COMPILER.encode()), _closure(name)
    if name not in found or max(source.changed for source in found.values()) > _BEGAN:
        return None
    for module in sorted(found):
        digest.update(f"{module} {found[module].digest} ".encode())
    base = cache_folder("kernels", os.environ.get("NUMBA_CACHE_DIR"))
    if base is None:
        return None
    folder = base / f"{name}-{digest.hexdigest()[:16]}"
    with contextlib.suppress(OSError):  # not there yet, or not ours: then it is pruned sooner
        if time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)
    return folder


class _Source(NamedTuple):
    digest: str
    """Hash of the source."""
    imported: tuple[str, ...]
    """Names of the modules that it imports."""
    changed: float
    """When its file last changed [s]."""


def _closure(name: str) -> dict[str, _Source]:
    """The modules of this project that a module's globals may come from, itself among them."""
    packages, waiting = _PACKAGES | {name.partition(".")[0]}, [name]
    found: dict[str, _Source] = {}
    while waiting:
        module = waiting.pop()
        if module in found or module.partition(".")[0] not in packages:
            continue
        source = _source(module)
        if source is not None:
            found[module] = source
            waiting += source.imported
    return found


@functools.cache
def _source(module: str) -> _Source | None:
    """The source of a loaded module; None if there is none."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return None
    try:
        content, changed = Path(file).read_bytes(), os.stat(file).st_ctime
    except OSError:
        return None
    return _Source(hashlib.sha256(content).hexdigest(), tuple(_imports(content.decode(errors="replace"))), changed)


def _imports(source: str) -> Iterator[str]:
    for origin, names, whole in _IMPORT.findall(source):
        yield origin or whole
        for name in re.findall(r"(\w+)(?: as \w+)?", names):
            if f"{origin}.{name}" in sys.modules:  # a module from its package
                yield f"{origin}.{name}"


def _prune(folder: Path) -> None:
    """Remove the kernels of versions of a module that were used longest ago, before another is added."""
    module = folder.name.rpartition("-")[0]
    try:
        versions = [other for other in folder.parent.iterdir() if other.name.rpartition("-")[0] == module]
        versions.sort(key=lambda other: other.stat().st_mtime, reverse=True)
    except OSError:
        return  # another process is at it
    for old in versions[_KEPT - 1 :]:
        shutil.rmtree(old, ignore_errors=True)
