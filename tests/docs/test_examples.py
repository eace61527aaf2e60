"""The examples of the pages run as they stand there, those of a page in one folder and in order."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, ROOT, Block, blocks_of

EXAMPLES = {str(page.relative_to(ROOT)): blocks_of(page) for page in PAGES}
FAST = [name for name, blocks in EXAMPLES.items() if any(block.test == "run" for block in blocks)]
SLOW = [name for name, blocks in EXAMPLES.items() if any(block.test == "slow" for block in blocks)]


@pytest.mark.parametrize("name", FAST)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(name, ("run", "file"))


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_slow_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(name, ("run", "slow", "file"))


def run_page(name: str, kinds: tuple[str, ...]) -> None:
    """Runs a page's blocks of these kinds in the current folder."""
    for block in EXAMPLES[name]:
        if block.test not in kinds:
            continue
        if block.file is not None:
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            source = "\n" * (block.line - 1) + block.text  # so that an error names the page's line
            exec(compile(source, name, "exec"), {"__name__": "__main__"})
        else:
            run_shell(block, name)


def run_shell(block: Block, name: str) -> None:
    """Runs a block so that its first failing line ends it, with ``vuca`` and this source tree found first."""
    paths = {"PATH": Path(sys.executable).parent, "PYTHONPATH": ROOT}
    environment = os.environ | {key: f"{path}{os.pathsep}{os.environ.get(key, '')}" for key, path in paths.items()}
    command = ["bash", "-eu", "-o", "pipefail", "-c", block.text]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{name}, line {block.line}:\n{block.text}\n{done.stdout}\n{done.stderr}"
