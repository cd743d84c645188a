"""What a report says: verdicts, facts, figures, tables and the moving robot, section by section."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, Literal, cast

import numpy as np
from numpy.typing import NDArray

from results.notation import readable

Value = str | float | bool | None
Kind = Literal["text", "number", "parameter", "outcome"]


@dataclass(frozen=True)
class TableColumn:
    """A column of a table.

    Of the kinds, ``"parameter"`` holds names that are set as formulas, ``"outcome"`` words that are
    coloured by what they say; `digits` are the significant ones of numbers. The cell of a record is
    its attribute `of`, a path such as ``"read_back.position_error"`` (nothing when a part of it is
    None), or what `of` returns for it; of a tuple the value in the column's place. In a table of
    columns `of` has the values themselves. Numbers are shown times `factor`, for a handier unit.
    """

    title: str
    unit: str = ""
    kind: Kind = "number"
    digits: int = 4
    of: str | Callable[[Any], Value] | Sequence[Value] | NDArray[Any] = ""
    factor: float = 1

    @property
    def heading(self) -> str:
        """Title and unit, as the head of the column shows them."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def cell(self, record: Any, place: int) -> Value:
        """Return the value of a record in this column, which is the one in this place."""
        if callable(self.of):
            value = self.of(record)
        elif not isinstance(self.of, str):
            value = self.of[record]
            value = value.item() if isinstance(value, np.generic) else value
        else:
            value = record if self.of else record[place]
            for name in self.of.split(".") if self.of else ():
                value = None if value is None else getattr(value, name)
        return self.factor * value if self.factor != 1 and isinstance(value, float) else value


def text_columns(*titles: str) -> tuple[TableColumn, ...]:
    """Return columns of text, of tuples."""
    return tuple(TableColumn(title, kind="text") for title in titles)


@dataclass(frozen=True)
class ReportTable:
    """A table by its name in the page, which is that of its file without the ending.

    Each row has a value for every column: text, number, truth value, or None where there is
    nothing. The page shows a folded one on request only.
    """

    kind: ClassVar[str] = "table"
    key: str
    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[Value, ...], ...]
    folded: bool = False

    @classmethod
    def of(
        cls,
        key: str,
        caption: str,
        columns: Sequence[TableColumn],
        records: Iterable[Any] | None = None,
        *,
        folded: bool = False,
    ) -> ReportTable:
        """Make a table with a row for every record, or for every tuple of values.

        Without records the columns have their values, all of the first one's length.

        Raises
        ------
        ValueError
            A tuple has more or fewer values than there are columns.
        """
        if records is None:
            records = range(len(cast("Sequence[Value]", columns[0].of)))
        rows = []
        for record in records:
            if isinstance(record, tuple) and len(record) != len(columns):
                raise ValueError(f"{key}: every row needs {len(columns)} values")
            rows.append(tuple(column.cell(record, k) for k, column in enumerate(columns)))
        return cls(key, caption, tuple(columns), tuple(rows), folded)


def cell_text(column: TableColumn, value: Value) -> str:
    """Return what a cell shows: numbers with the column's digits, nothing for what is missing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return readable(value, column.digits)
    return value


def sort_key(value: Value) -> str:
    """Return what a page sorts a cell by: all digits of a number, nothing for what is missing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)


class Level(Enum):
    """How something is to be taken."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class StageVerdict:
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
class Animation:
    """The robot in motion; the data are what `view.js` draws: plain numbers, texts and lists."""

    kind: ClassVar[str] = "view"
    key: str
    caption: str
    data: dict[str, Any]


Block = Facts | FigureBlock | ReportTable | TextBlock | ListingBlock | Animation


@dataclass(frozen=True)
class ReportSection:
    """A part of the page with a heading."""

    key: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class StageView:
    """What a page says of one stage; the facts are its best numbers, for the summary.

    The section has the verdict's anchor, and its title where there is no `heading`.
    """

    verdict: StageVerdict
    blocks: tuple[Block, ...]
    facts: tuple[Fact, ...] = ()
    warnings: tuple[str, ...] = ()
    heading: str = ""

    @property
    def section(self) -> ReportSection:
        """The part of the page on this stage."""
        return ReportSection(self.verdict.anchor, self.heading or self.verdict.title, self.blocks)


@dataclass(frozen=True)
class Page:
    """A whole report."""

    title: str
    subtitle: str
    description: str
    verdicts: tuple[StageVerdict, ...]
    facts: tuple[Fact, ...]
    sections: tuple[ReportSection, ...]
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
        return any(isinstance(block, Animation) for block in self.blocks)
