"""Content of a view: verdict, facts, tables, figures and findings, before any renderer.

A view states what is shown of a result, once. The terminal, the HTML page, LaTeX and the comparison
render the same view; a block for the terminal has ``screen=True``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

import numpy as np
from numpy.typing import NDArray

from results.notation import readable

if TYPE_CHECKING:
    from results.figures.drawing import FigureDefinition

Value = str | float | bool | None
Kind = Literal["text", "number", "error", "parameter", "outcome"]


class Level(Enum):
    """Judgement behind a text, shown by its colour."""

    GOOD = "good"
    CAUTION = "caution"
    BAD = "bad"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class StageVerdict:
    """End of a stage, in a word or two and in a sentence; `anchor` names the section with more."""

    title: str
    level: Level
    word: str
    sentence: str
    anchor: str = ""


@dataclass(frozen=True)
class Fact:
    """An important number or word with its name and a note on its meaning."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Facts:
    """Facts side by side."""

    kind: ClassVar[str] = "facts"
    facts: tuple[Fact, ...]
    screen: bool = False


@dataclass(frozen=True)
class TextBlock:
    """A paragraph of plain text, coloured by its level; a screen shows its `short` form."""

    kind: ClassVar[str] = "text"
    text: str
    level: Level = Level.NEUTRAL
    screen: bool = False
    short: str = ""


@dataclass(frozen=True)
class ListingBlock:
    """A text shown letter by letter; a page unfolds it on request."""

    kind: ClassVar[str] = "listing"
    title: str
    text: str
    screen: bool = False


@dataclass(frozen=True)
class TableColumn:
    """A column of a table, with title and unit as its head."""

    title: str
    unit: str = ""
    kind: Kind = "number"
    """``"parameter"`` holds names that are set as formulas, ``"outcome"`` words with a colour of
    their own, ``"error"`` standard deviations of the column before; the terminal writes both in
    one, ``1.2345(67)``."""
    digits: int = 4
    """Significant digits of numbers."""
    of: str | Callable[[Any], Value] | Sequence[Value] | NDArray[Any] = ""
    """Cell of a row: an attribute of the row's object, such as ``"read_back.position_error"``
    (empty when a part of the path is None), or a function of the object. A row that is a tuple has
    the value in the column's place. In a table without objects `of` has the values."""
    factor: float = 1
    """Numbers are shown times this factor, for a handier unit."""
    screen: bool = True
    """Whether the terminal shows the column."""
    wide: bool = False
    """Whether only a wide terminal shows it."""
    proof: bool = False
    """Whether it states what is proved, which holds only for unchanged files."""

    @property
    def heading(self) -> str:
        """Title and unit, as the head of the column shows them."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def numeric(self) -> bool:
        """Whether the column holds numbers."""
        return self.kind in ("number", "error")

    def cell(self, item: Any, place: int) -> Value:
        """Return the value of a row's object in this column, the one in this place."""
        if callable(self.of):
            value = self.of(item)
        elif not isinstance(self.of, str):
            value = self.of[item]
            value = value.item() if isinstance(value, np.generic) else value
        else:
            value = item if self.of else item[place]
            for name in self.of.split(".") if self.of else ():
                value = None if value is None else getattr(value, name)
        return self.factor * value if self.factor != 1 and isinstance(value, float) else value


def text_columns(*titles: str) -> tuple[TableColumn, ...]:
    """Return columns of text, for rows that are tuples."""
    return tuple(TableColumn(title, kind="text") for title in titles)


@dataclass(frozen=True)
class ReportTable:
    """A table; its key is the name of its file without the ending.

    Each row has a value for every column: text, number, truth value, or None where there is
    nothing. A page shows a folded table on request; `screen` and `latex` name further renderers.
    """

    kind: ClassVar[str] = "table"
    key: str
    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[Value, ...], ...]
    folded: bool = False
    screen: bool = False
    latex: bool = False
    left_out: frozenset[int] = frozenset()
    """Rows that a terminal counts and does not list."""

    @classmethod
    def of(
        cls,
        key: str,
        caption: str,
        columns: Sequence[TableColumn],
        items: Iterable[Any] | None = None,
        **shown: Any,
    ) -> ReportTable:
        """Make a table with a row for every object, or for every tuple of values.

        Without objects the columns have their values, all of the first one's length. How a table is
        `shown` is stated by its attributes.

        Raises
        ------
        ValueError
            A tuple has more or fewer values than there are columns.

        Examples
        --------
        >>> struts = TableColumn("strut", of=[1, 2]), TableColumn("length", "mm", of=[450.0, 451.5])
        >>> ReportTable.of("lengths", "Lengths at home", struts).rows
        ((1, 450.0), (2, 451.5))
        """
        if items is None:
            items = range(len(cast("Sequence[Value]", columns[0].of)))
        rows = []
        for item in items:
            if isinstance(item, tuple) and len(item) != len(columns):
                raise ValueError(f"{key}: every row needs {len(columns)} values")
            rows.append(tuple(column.cell(item, k) for k, column in enumerate(columns)))
        return cls(key, caption, tuple(columns), tuple(rows), **shown)

    def without_claims(self) -> ReportTable:
        """Return the table with empty columns of proofs and outcomes."""
        is_claim = [column.proof or column.kind == "outcome" for column in self.columns]
        rows = tuple(
            tuple(None if claim else value for value, claim in zip(row, is_claim, strict=True))
            for row in self.rows
        )
        return replace(self, rows=rows)


def cell_text(column: TableColumn, value: Value) -> str:
    """Return the text of a cell: numbers with the column's digits, a dash for a missing value."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return readable(value, column.digits)
    return value


def sort_key(value: Value) -> str:
    """Return the key by which a page sorts a cell: all digits of a number, empty when missing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure of a result: its definition and the object that it is drawn from.

    Several drawings of one definition have numbers, which end their names. `renewed` drawings are
    drawn again for every report.
    """

    kind: ClassVar[str] = "drawing"
    figure: FigureDefinition[Any]
    source: Any
    number: int | None = None
    renewed: bool = False

    @property
    def definition(self) -> FigureDefinition[Any]:
        """The definition with the number in the name of its files."""
        return self.figure if self.number is None else self.figure.ending(f"_{self.number}")

    @property
    def caption(self) -> str:
        """Caption of the figure, with its number and what is seen."""
        number = "" if self.number is None else f"{self.number}. "
        seen = "" if self.figure.seen is None else self.figure.seen(self.source)
        return f"{number}{self.figure.caption} {seen}".rstrip()


def drawings(
    figures: Iterable[FigureDefinition[Any]], sources: Any, *, numbered: bool = False
) -> tuple[Drawing, ...]:
    """Return drawings of a result, or with `numbered` of each of several, figure by figure."""
    if not numbered:
        return tuple(Drawing(figure, sources) for figure in figures)
    several = len(sources) > 1
    return tuple(
        Drawing(figure, source, number if several else None)
        for figure in figures
        for number, source in enumerate(sources, start=1)
    )


@dataclass(frozen=True)
class EmbeddedFigure:
    """A figure file in a page.

    The source is the SVG or PNG as a data URI: an image runs no scripts, and its ids are private.
    """

    kind: ClassVar[str] = "figure"
    key: str
    caption: str
    source: str
    ending: str = "svg"


@dataclass(frozen=True)
class Animation:
    """The moving robot; the data for `view.js` are plain numbers, texts and lists."""

    kind: ClassVar[str] = "view"
    key: str
    caption: str
    data: dict[str, Any]


@dataclass(frozen=True)
class FindingsBlock:
    """Assumptions with their outcomes: a table on a page, a list of advice on the terminal."""

    kind: ClassVar[str] = "findings"
    subject: str
    table: ReportTable
    lines: tuple[str, ...]


Block = (
    Facts
    | TextBlock
    | ListingBlock
    | ReportTable
    | FindingsBlock
    | Drawing
    | EmbeddedFigure
    | Animation
)


@dataclass(frozen=True)
class PageSection:
    """A part of a page with a heading."""

    key: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class StageView:
    """The view of one stage.

    The facts are its most important numbers. The section has the verdict's anchor, and its title
    where there is no `heading`. The note is written below every figure. `most_lines` is the largest
    number of lines on a terminal, its warnings included; 0: no limit.
    """

    verdict: StageVerdict
    blocks: tuple[Block, ...] = ()
    facts: tuple[Fact, ...] = ()
    warnings: tuple[str, ...] = ()
    heading: str = ""
    figure_note: str = ""
    most_lines: int = 0

    @property
    def section(self) -> PageSection:
        """The part of a page on this stage."""
        return PageSection(self.verdict.anchor, self.heading or self.verdict.title, self.blocks)

    @property
    def drawings(self) -> tuple[Drawing, ...]:
        """The figures of the stage."""
        return tuple(block for block in self.blocks if isinstance(block, Drawing))


@dataclass(frozen=True, eq=False)
class Page:
    """A whole report."""

    title: str
    subtitle: str
    description: str
    verdicts: tuple[StageVerdict, ...]
    facts: tuple[Fact, ...]
    sections: tuple[PageSection, ...]
    warnings: tuple[str, ...] = ()

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks of all sections, in the order of the page."""
        return tuple(block for section in self.sections for block in section.blocks)

    @property
    def tables(self) -> tuple[ReportTable, ...]:
        """All tables, in the order of the page."""
        tables = (b.table if isinstance(b, FindingsBlock) else b for b in self.blocks)
        return tuple(table for table in tables if isinstance(table, ReportTable))

    @property
    def moves(self) -> bool:
        """Whether the page has an animation, which needs the plotting library."""
        return any(isinstance(block, Animation) for block in self.blocks)
