"""What the code says about pages."""

import re

from tests.docs.pages import ROOT

FOLDERS = ("vuca_nav", "worlds", "robots", "eval", "train", "tests")


def test_pages_that_the_code_names_exist():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")] + [ROOT / "Makefile"]
    broken = {
        f"{file.relative_to(ROOT)}: {name}"
        for file in files
        for name in re.findall(r"\bdocs/[\w/-]+\.md\b", file.read_text(encoding="utf-8"))
        if not (ROOT / name).exists()
    }
    assert not broken
