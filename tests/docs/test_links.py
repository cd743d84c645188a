import re

import pytest

from tests.docs.pages import FILES, ROOT, prose

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


@pytest.mark.parametrize("page", FILES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in _links(page):
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in _anchors(target), f"{page.name}: {link}"


def test_every_page_is_linked_from_the_readme():
    readme = ROOT / "README.md"
    linked = {(ROOT / link.partition("#")[0]).resolve() for link in _links(readme)}
    assert {page.resolve() for page in FILES} - {readme} <= linked


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    packages = ("expdesign/", "constraints/", "estimation/", "results/", "tests/")
    for path in re.findall(r"`([\w./-]+/[\w./-]*)`", prose(page)):
        if path.startswith(packages):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
