"""Links lead somewhere, and pages stay short."""

import pytest

from tests.docs.pages import (
    DOCS,
    NAMES,
    PAGES,
    ROOT,
    anchor_on_github,
    anchor_on_the_site,
    anchors_of,
    blocks_of,
    headings_of,
    links_of,
    prose_of,
)

WRITTEN = [page for page in PAGES if DOCS / "results" not in page.parents]
"""By hand; those of results are written by a command."""
MOST_WORDS = 1500
"""Of a reference page; longer ones are not read."""


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_to_a_file_and_a_heading(page):
    broken = []
    for target in links_of(page):
        if target.startswith(("https://", "http://", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and anchor not in anchors_of(file)):
            broken.append(target)
    assert not broken


@pytest.mark.parametrize("page", [page for page in PAGES if DOCS in page.parents], ids=NAMES[2:])
def test_pages_of_the_site_link_only_to_pages_of_the_site(page):
    """The site holds the folder docs and nothing else."""
    files = [target.partition("#")[0] for target in links_of(page) if "://" not in target]
    outside = [file for file in files if file and DOCS not in (page.parent / file).resolve().parents]
    assert not outside


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.name)
def test_headings_have_one_anchor_on_github_and_on_the_site(page):
    headings = headings_of(page)
    anchors = [anchor_on_github(heading) for heading in headings]
    assert anchors == [anchor_on_the_site(heading) for heading in headings]
    assert len(set(anchors)) == len(anchors)


@pytest.mark.parametrize("page", [page for page in WRITTEN if page.name != "findings.md"], ids=lambda page: page.name)
def test_pages_are_short(page):
    """The log of trials is for looking things up in it."""
    assert len(prose_of(page).split()) <= MOST_WORDS


def test_the_glossary_is_short():
    assert len((DOCS / "glossary.md").read_text(encoding="utf-8").splitlines()) <= 50


def test_the_site_has_every_page():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    missing = [page.name for page in DOCS.glob("*.md") if page.name not in navigation]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_what_is_to_be_run_is_of_a_language_that_can_be(page):
    assert {block.language for block in blocks_of(page) if block.test in ("run", "slow")} <= {"sh", "python"}
