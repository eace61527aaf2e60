"""The documentation's pages: their headings, links and fenced blocks, read without a Markdown library.

A comment before a fenced block says what the tests do with it:

- ``<!-- test: run -->``: run it, in the fast tests;
- ``<!-- test: slow -->``: run it, in the slow tests;
- ``<!-- test: file NAME -->``: write it to NAME, where the page's other blocks run.
"""

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")))
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]

_FENCED = re.compile(
    r"^(?:<!-- test: (?P<test>run|slow|file (?P<file>\S+)) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_INLINE_CODE = re.compile(r"`[^`\n]+`")
_LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
_HEADING = re.compile(r"^#{1,6} (?P<text>.+?)\s*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block of a page."""

    language: str
    text: str
    line: int
    """In the page, of its first line of text, from 1."""
    test: str | None
    """"run", "slow", "file", or None for a block that is only shown."""
    file: str | None
    """Where a block of kind "file" is written."""


def blocks_of(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    content = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCED.finditer(content):
        line = content.count("\n", 0, match.start("text")) + 1
        kind = (match["test"] or "").partition(" ")[0] or None
        found.append(Block(match["language"], match["text"], line, kind, match["file"]))
    return found


def prose_of(page: Path) -> str:
    """The page without its fenced blocks."""
    return _FENCED.sub("", page.read_text(encoding="utf-8"))


def links_of(page: Path) -> list[str]:
    """The targets of a page's links and images."""
    return [match["target"] for match in _LINK.finditer(_INLINE_CODE.sub("", prose_of(page)))]


def headings_of(page: Path) -> list[str]:
    """The texts of a page's headings."""
    return [match["text"] for match in _HEADING.finditer(prose_of(page))]


def anchors_of(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    return {anchor_on_github(heading) for heading in headings_of(page)}


def anchor_on_github(heading: str) -> str:
    """Every space becomes a hyphen, and only punctuation is dropped."""
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip())


def anchor_on_the_site(heading: str) -> str:
    """As Python-Markdown makes them: plain ASCII, and a single hyphen for several spaces or hyphens."""
    plain = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode("ascii")
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())
