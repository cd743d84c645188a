"""What a report says: verdicts, facts, figures, tables and the moving robot, section by section."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from results.report.table import ReportTable


class Level(Enum):
    """How something is to be taken."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class Verdict:
    """How a stage ended: in a word or two and in a sentence; `anchor` is the section with more."""

    title: str
    level: Level
    word: str
    sentence: str
    anchor: str = ""


@dataclass(frozen=True)
class Fact:
    """A number, or a word, that matters: its name, value and what it means."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Facts:
    """Facts side by side."""

    facts: tuple[Fact, ...]
    kind: str = field(default="facts", init=False)


@dataclass(frozen=True)
class FigureBlock:
    """A figure by the name of its file.

    The source is the SVG as a data URI: an image runs no scripts, and its ids are its own.
    """

    key: str
    caption: str
    source: str
    kind: str = field(default="figure", init=False)


@dataclass(frozen=True)
class TableBlock:
    """A table."""

    table: ReportTable
    kind: str = field(default="table", init=False)


@dataclass(frozen=True)
class TextBlock:
    """Paragraphs of plain text; `level` colours them."""

    paragraphs: tuple[str, ...]
    level: Level = Level.NEUTRAL
    kind: str = field(default="text", init=False)


@dataclass(frozen=True)
class ListingBlock:
    """A text that is shown letter by letter, on request."""

    title: str
    text: str
    kind: str = field(default="listing", init=False)


@dataclass(frozen=True)
class ViewBlock:
    """The robot in motion; the data are what `view.js` draws: plain numbers, texts and lists."""

    key: str
    caption: str
    data: dict[str, Any]
    kind: str = field(default="view", init=False)


Block = Facts | FigureBlock | TableBlock | TextBlock | ListingBlock | ViewBlock


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading."""

    key: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class StageReport:
    """What a page says of one stage; the facts are its best numbers, for the summary."""

    verdict: Verdict
    facts: tuple[Fact, ...]
    sections: tuple[Section, ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Page:
    """A whole report."""

    title: str
    subtitle: str
    description: str
    verdicts: tuple[Verdict, ...]
    facts: tuple[Fact, ...]
    sections: tuple[Section, ...]
    warnings: tuple[str, ...] = ()

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        """All tables, in the order of the page."""
        return tuple(
            block.table
            for section in self.sections
            for block in section.blocks
            if isinstance(block, TableBlock)
        )

    @property
    def moves(self) -> bool:
        """True when the page has a view that needs the plotting library."""
        return any(isinstance(b, ViewBlock) for s in self.sections for b in s.blocks)
