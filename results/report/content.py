"""What a report says: verdicts, facts, figures, tables and the moving robot, section by section."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

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

    kind: ClassVar[str] = "facts"
    facts: tuple[Fact, ...]


@dataclass(frozen=True)
class FigureBlock:
    """A figure by the name of its file.

    The source is the SVG as a data URI: an image runs no scripts, and its ids are its own.
    """

    kind: ClassVar[str] = "figure"
    key: str
    caption: str
    source: str


@dataclass(frozen=True)
class TextBlock:
    """A paragraph of plain text; `level` colours it."""

    kind: ClassVar[str] = "text"
    text: str
    level: Level = Level.NEUTRAL


@dataclass(frozen=True)
class ListingBlock:
    """A text that is shown letter by letter, on request."""

    kind: ClassVar[str] = "listing"
    title: str
    text: str


@dataclass(frozen=True)
class ViewBlock:
    """The robot in motion; the data are what `view.js` draws: plain numbers, texts and lists."""

    kind: ClassVar[str] = "view"
    key: str
    caption: str
    data: dict[str, Any]


Block = Facts | FigureBlock | ReportTable | TextBlock | ListingBlock | ViewBlock


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading."""

    key: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class StageReport:
    """What a page says of one stage; the facts are its best numbers, for the summary.

    The section has the verdict's anchor, and its title where there is no `heading`.
    """

    verdict: Verdict
    blocks: tuple[Block, ...]
    facts: tuple[Fact, ...] = ()
    warnings: tuple[str, ...] = ()
    heading: str = ""

    @property
    def section(self) -> Section:
        """The part of the page on this stage."""
        return Section(self.verdict.anchor, self.heading or self.verdict.title, self.blocks)


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
    def blocks(self) -> tuple[Block, ...]:
        """What all sections hold, in the order of the page."""
        return tuple(block for section in self.sections for block in section.blocks)

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        """All tables, in the order of the page."""
        return tuple(block for block in self.blocks if isinstance(block, ReportTable))

    @property
    def moves(self) -> bool:
        """True when the page has a view that needs the plotting library."""
        return any(isinstance(block, ViewBlock) for block in self.blocks)
