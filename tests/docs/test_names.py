"""What the pages name exists: files, modules, commands and options; and what the code says about pages."""

import contextlib
import importlib
import io
import re
import shlex
import tomllib
from functools import cache

import pytest

from tests.docs.pages import DOCS, NAMES, PAGES, ROOT, blocks_of

COMMANDS: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "entry-points"
]["vuca.commands"]
"""Every command of ``vuca`` with the function that it is, as ``module:function``."""
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
FOLDERS = ("vuca_nav", "worlds", "robots", "eval", "train", "tests")


@cache
def options_of(*command: str) -> frozenset[str]:
    """The options that the help of a command shows, ``train`` with what is trained."""
    module, _, function = COMMANDS[command[0]].partition(":")
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        getattr(importlib.import_module(module), function)([*command[1:], "--help"])
    return frozenset(OPTION.findall(text.getvalue()))


def command_lines() -> list[tuple[str, list[str]]]:
    """Every call of ``vuca`` in a shell block, with its page."""
    calls = []
    for name, page in zip(NAMES, PAGES):
        for block in blocks_of(page):
            if block.language != "sh":
                continue
            for line in block.text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                for start in (i for i, word in enumerate(words) if word.endswith("bin/vuca") or word == "vuca"):
                    ends = [i for i in range(start, len(words)) if words[i] in ("|", ">", ";", "&&")]
                    calls.append((name, words[start + 1 : min(ends, default=len(words))]))
    return calls


def test_the_pages_call_commands_and_options_that_there_are():
    wrong = []
    for name, words in command_lines():
        if words[0] not in COMMANDS:
            wrong.append((name, words[0]))
            continue
        known = options_of(*words[: 2 if words[0] == "train" else 1])
        wrong += [(name, words[0], word) for word in words if word.startswith("--") and word not in known]
    assert not wrong


def test_the_command_lines_pages_have_every_command_and_option():
    text = "".join((DOCS / name).read_text(encoding="utf-8") for name in ("cli.md", "cli-robot.md"))
    missing = [f"vuca {name}" for name in COMMANDS if f"vuca {name}" not in text]
    named = set(OPTION.findall(text)) | {"--help"}
    for name in COMMANDS:
        if name != "train":  # every setting of a training is an option
            missing += [f"vuca {name} {option}" for option in options_of(name) - named]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_files_and_modules_that_a_page_names_exist(page):
    """Paths in inline code that begin with one of the folders, and what ``python -m`` is told to run."""
    content = page.read_text(encoding="utf-8")
    paths = re.findall(rf"`((?:{'|'.join((*FOLDERS, 'docs'))})/[\w/.-]*)`", content)
    missing = [path for path in paths if not (ROOT / path).exists()]
    for module in re.findall(rf"python -m ((?:{'|'.join(FOLDERS)})[\w.]*)", content):
        path = ROOT / module.replace(".", "/")
        if not (path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()):
            missing.append(module)
    assert not missing


def test_pages_that_the_code_names_exist():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")] + [ROOT / "Makefile"]
    broken = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in files
        for name in re.findall(r"\bdocs/[\w/-]+\.md\b", file.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    }
    assert not broken
