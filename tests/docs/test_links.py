import re

import pytest

from tests.docs.pages import FILES, NOTES, ROOT, prose

TASKS = (ROOT / "docs" / "index.md").resolve()
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


def _links(page):
    found = _LINK.findall(prose(page))
    return [link for link in found if not link.startswith(("http://", "https://", "mailto:"))]


def _anchor(heading):
    """Return the anchor that GitHub gives a heading."""
    text = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return text.replace(" ", "-")


def _anchors(page):
    return {_anchor(h) for h in re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)}


@pytest.mark.parametrize("page", [*FILES, *NOTES], ids=lambda page: page.name)
def test_links_resolve(page):
    for link in _links(page):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in _anchors(target), f"{page.name}: {link}"


def _linked(page):
    return {(page.parent / link.partition("#")[0]).resolve() for link in _links(page)}


def test_every_page_is_linked_from_the_page_of_tasks():
    """So that the contents of the site are complete; the readme links to that page."""
    assert TASKS in _linked(ROOT / "README.md")
    assert {page.resolve() for page in FILES} - {TASKS} <= _linked(TASKS)


def test_every_note_is_linked_from_a_page():
    linked = set().union(*(_linked(page) for page in FILES))
    assert {note.resolve() for note in NOTES} <= linked


def test_every_task_has_its_page():
    """One line each, under a heading, for the table of contents of the site."""
    _, *sections = TASKS.read_text(encoding="utf-8").split("\n## ")
    assert len(sections) > 2
    for section in sections:
        rows = [line for line in section.splitlines() if line.startswith("|")][2:]
        assert rows
        for row in rows:
            assert len(_LINK.findall(row)) == 1, row


@pytest.mark.parametrize("page", FILES, ids=lambda page: page.name)
def test_headings_have_one_anchor_each(page):
    """Equal headings are numbered differently by the repository and the site."""
    anchors = [_anchor(h) for h in re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)]
    for other in FILES:
        for link in _links(other):
            path, _, anchor = link.partition("#")
            if (other.parent / path if path else other).resolve() == page:
                assert anchors.count(anchor) <= 1, f"{other.name}: {link}"


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_named_files_exist(page):
    packages = ("expdesign/", "constraints/", "estimation/", "results/", "tests/")
    for path in re.findall(r"`([\w./-]+/[\w./-]*)`", prose(page)):
        if path.startswith(packages):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
