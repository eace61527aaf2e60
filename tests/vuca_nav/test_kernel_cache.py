"""The cache of kernels, used by processes of their own over a small package of two modules."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import vuca_nav

CALLED = """
from vuca_nav.kernel_cache import njit
from package.settings import FACTOR

@njit(cache=True)
def called(x):
    return FACTOR * x
"""
CALLER = """
from package.called import called
from vuca_nav.kernel_cache import njit

@njit(cache=True)
def caller(x):
    return called(x) + 1.0
"""
TOLD = "import package.caller as c; print(c.caller(2.0), sum(c.caller.stats.cache_hits.values()))"


@pytest.fixture
def package(tmp_path):
    """A package whose kernel calls one of another module, which has a constant from a third."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "settings.py").write_text("FACTOR = 3.0\n")
    (folder / "called.py").write_text(CALLED)
    (folder / "caller.py").write_text(CALLER)
    return folder


def start(package: Path, code: str = TOLD, **variables: str) -> subprocess.Popen[str]:
    path = os.pathsep.join([str(package.parent), str(Path(vuca_nav.__file__).parents[1])])
    own = {"PYTHONPATH": path, "XDG_CACHE_HOME": str(package.parent / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")} | own | variables
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def run(package: Path, code: str = TOLD, **variables: str) -> tuple[str, str]:
    """What a process prints: the kernel's result and how often it was found in the cache; and its errors."""
    with start(package, code, **variables) as process:
        out, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    return out.strip(), errors


def kernels(package: Path) -> Path:
    return package.parent / "cache" / "vuca-nav" / "kernels"


def test_a_change_in_any_module_that_a_kernel_is_made_of_is_seen(package):
    assert run(package) == ("7.0 0", "")
    assert run(package) == ("7.0 1", "")
    (package / "called.py").write_text(CALLED.replace("FACTOR * x", "FACTOR - x"))
    assert run(package)[0] == "2.0 0"
    (package / "settings.py").write_text("FACTOR = 5.0\n")
    assert run(package)[0] == "4.0 0"
    (package / "called.py").write_text(CALLED)
    (package / "settings.py").write_text("FACTOR = 3.0\n")
    assert run(package)[0] == "7.0 1"  # as it was at first


def test_a_change_after_the_modules_were_loaded_is_not_taken_for_what_runs(package):
    changed = CALLED.replace("FACTOR * x", "FACTOR - x")
    edit = f"import pathlib; pathlib.Path({str(package / 'called.py')!r}).write_text({changed!r}); "
    assert run(package, "import package.caller; " + edit + TOLD)[0] == "7.0 0"
    assert run(package)[0] == "2.0 0"


@pytest.mark.parametrize(
    "damage", [lambda data: b"", lambda data: data[:500], lambda data: data[:-9] + b"?" + data[-8:]]
)
def test_damaged_machine_code_is_made_again_and_the_file_named(package, damage):
    run(package)
    files = sorted(kernels(package).rglob("*.nbc"))
    assert len(files) == 2
    for file in files:
        file.write_bytes(damage(file.read_bytes()))
    out, errors = run(package)
    assert out == "7.0 0"
    assert errors.splitlines() == [f"{file} is damaged; it is made again" for file in sorted(files, reverse=True)]
    assert run(package) == ("7.0 1", "")


def test_without_a_place_for_it_kernels_are_compiled_each_time(package):
    nowhere = "import tempfile; tempfile.tempdir = '/dev/null'; "
    for _ in range(2):
        assert run(package, nowhere + TOLD, XDG_CACHE_HOME="/dev/null/cache") == ("7.0 0", "")


def test_numbas_own_variables_are_heeded(package):
    run(package, NUMBA_CACHE_DIR=str(package.parent / "mine"))
    assert not kernels(package).exists()
    assert len(list((package.parent / "mine" / "vuca-nav" / "kernels").rglob("*.nbc"))) == 2
    assert run(package, "import package.caller as c; print(c.caller(2.0))", NUMBA_DISABLE_JIT="1")[0] == "7.0"


def test_processes_that_compile_at_the_same_time_do_not_mix_theirs_up(package):
    call = "import package.caller as c; print(c.caller({0}), sum(c.caller.stats.cache_hits.values()))"
    codes = [call.format(argument) for argument in ("2", "2.0", "2", "2.0")]
    processes = [start(package, code) for code in codes]
    assert [process.communicate(timeout=120)[0].split()[0] for process in processes] == ["7.0"] * 4
    assert [run(package, code)[0] for code in codes[:2]] == ["7.0 1"] * 2


def test_kernels_of_old_versions_are_removed(package):
    old = [kernels(package) / f"package.caller-{k:016x}" for k in range(12)]
    other = kernels(package) / "package.other-0000000000000000"
    for k, folder in enumerate([*old, other]):
        folder.mkdir(parents=True)
        os.utime(folder, (1e9 + k, 1e9 + k))
    run(package)
    left = {folder.name for folder in kernels(package).iterdir()}
    assert {folder.name for folder in [*old[-7:], other]} < left
    assert not left & {folder.name for folder in old[:-7]}
