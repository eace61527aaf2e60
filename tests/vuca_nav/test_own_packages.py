import subprocess
import sys
from pathlib import Path

import pytest

from vuca_nav.own_packages import Shadowed, import_own, prefer_own_packages


@pytest.fixture
def beside(tmp_path, monkeypatch):
    """A directory that comes first on the path, with scripts of common names."""
    for name in ("eval", "train"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('a script, not to be run')\n")
        for module in [module for module in sys.modules if module.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(sys, "path_importer_cache", {})
    return tmp_path


def test_the_command_finds_its_packages_beside_scripts_of_their_names(beside):
    prefer_own_packages()
    import eval.metrics as metrics

    assert "real_time_factor" in metrics.TIMING_FIELDS
    assert sys.path[1] == str(beside)


def test_the_path_stays_as_it_is_where_nothing_is_shadowed():
    before = list(sys.path)
    prefer_own_packages()
    assert sys.path == before


def test_a_program_imports_ours_beside_a_script_and_keeps_its_path(beside):
    before = list(sys.path)
    assert "critic" in import_own("train.commands").TRAINABLE
    assert sys.path == before


def test_a_module_that_is_imported_already_is_named(beside, monkeypatch):
    monkeypatch.setitem(sys.modules, "train", type(sys)("train"))
    sys.modules["train"].__file__ = str(beside / "train.py")
    for ask in (prefer_own_packages, lambda: import_own("train.commands")):
        with pytest.raises(Shadowed, match=r"train\.py shadows the package 'train' of vuca-nav: rename it"):
            ask()


def test_vuca_runs_beside_scripts_of_its_packages_names(tmp_path):
    (tmp_path / "eval.py").write_text("x = 1\n")
    root = Path(__file__).parents[2]
    result = subprocess.run(
        [sys.executable, "-m", "vuca_nav.cli", "--help"], cwd=tmp_path, env={"PYTHONPATH": f".:{root}"},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "Run a suite of episodes" in result.stdout
