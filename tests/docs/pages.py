"""Pages of the documentation and their parts."""

import re
from dataclasses import dataclass
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
FILES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").glob("*.md")),
)
# Experiments behind the pages, with the names and numbers of their day.
NOTES = tuple(sorted((ROOT / "docs" / "notes").glob("*.md")))
_FENCE = re.compile(
    r"^(?:<!-- example: (?P<file>\S+) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block; `file` is the path that a comment before it states."""

    page: Path
    file: str | None
    language: str
    text: str


def fences(page):
    """Return the fenced blocks of a page in their order."""
    return [
        Block(page, found["file"], found["language"], found["text"])
        for found in _FENCE.finditer(page.read_text(encoding="utf-8"))
    ]


def blocks(language):
    return [block for page in FILES for block in fences(page) if block.language == language]


def prose(page):
    """Return a page without its fenced blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def table(page, heading):
    """Return the rows of the first table under a heading, without its head; cells stripped."""
    _, _, rest = ("\n" + page.read_text(encoding="utf-8")).partition(f"\n{heading}\n")
    rows = []
    for line in rest.splitlines():
        if line.startswith("|"):
            rows.append([cell.strip() for cell in line.strip().strip("|").split("|")])
        elif rows:
            break
    assert len(rows) > 2, f"{page.name} has no table under '{heading}'"
    return rows[2:]


def codes(cell):
    return re.findall(r"`([^`]+)`", cell)


def parse(text):
    return YAML(typ="safe", pure=True).load(text)
