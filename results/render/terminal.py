"""Terminal: a view with its answer first, then the advice, the numbers and the main tables."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from results.notation import concise
from results.views.view import (
    Block,
    Facts,
    FindingsBlock,
    Level,
    ListingBlock,
    ReportTable,
    StageView,
    TableColumn,
    TextBlock,
    Value,
    cell_text,
)

_STYLES = {
    Level.GOOD: "bold green",
    Level.CAUTION: "bold yellow",
    Level.BAD: "bold red",
    Level.NEUTRAL: "bold",
}


def print_view(view: StageView, console: Console, place: str = "", *, below: int = 0) -> None:
    """Print the parts of a view that are for the screen, and then the place of the result, if any.

    Where the number of its lines is limited, so many more being printed `below`, the last tables
    have fewer rows. Words are wrapped where the console is a terminal, and never elsewhere.
    """
    if view.most_lines:
        view = _shorten(view, view.most_lines - below, console.width, place)
    _print_parts(view, console, place)


def brief_warnings(view: StageView, warnings: Sequence[str], width: int) -> list[str]:
    """Return the warnings of a result for a screen.

    Where the number of lines is limited, each has one line, few are listed, and none with a clause
    that the view contains.
    """
    if not view.most_lines:
        return list(warnings)
    shown = " ".join(_screen(view, _UNBROKEN).split())
    new = [
        text
        for text in warnings
        if not any(part in shown for part in _CLAUSE.split(text) if len(part.split()) > _FEW)
    ]
    room = width - len("warning: ")
    brief = [textwrap.shorten(text, room, placeholder=" … (report)") for text in new[:_LISTED]]
    return brief + [f"{len(new) - _LISTED} more in the report"] * (len(new) > _LISTED)


_CLAUSE = re.compile(r"[:;.] ")
_FEW = 3
"""Number of words of a clause that may be a name."""
_LISTED = 3
"""Largest number of warnings that a limited screen lists."""
_UNBROKEN = 10_000
"""Characters of a line that holds any text."""


def _shorten(view: StageView, lines: int, width: int, place: str) -> StageView:
    """Return a view that fits in a number of lines, with fewer rows of tables, the last first."""
    for k, block in reversed(list(enumerate(view.blocks))):
        if not (isinstance(block, ReportTable) and block.screen):
            continue
        table = block
        while (excess := _screen(view, width, place).count("\n") - lines) > 0:
            listed = [row for row in range(len(table.rows)) if row not in table.left_out]
            if len(listed) <= _ROWS_OF_A_BLOCK:
                break
            rest = listed[max(_ROWS_OF_A_BLOCK, len(listed) - excess) :]
            table = replace(table, left_out=table.left_out.union(rest))
            view = replace(view, blocks=(*view.blocks[:k], table, *view.blocks[k + 1 :]))
    return view


def _screen(view: StageView, width: int, place: str = "") -> str:
    console = Console(
        width=width, force_terminal=True, no_color=True, highlight=False, markup=False
    )
    with console.capture() as captured:
        _print_parts(view, console, place)
    return captured.get()


def _print_parts(view: StageView, console: Console, place: str) -> None:
    verdict = view.verdict
    head = Text.assemble(f"{verdict.title}: ", (verdict.word, _STYLES[verdict.level]), ". ")
    _print_text(console, head.append(verdict.sentence))
    findings = [block for block in view.blocks if isinstance(block, FindingsBlock)]
    for block in findings:
        if len(findings) > 1 and block.lines:
            _print_text(console, Text(f"{block.subject}:", style="italic"))
        for line in block.lines:
            _print_text(console, Text(f"- {line}"))
    if view.facts:
        _print_block(console, Facts(view.facts))
    for shown in view.blocks:
        if getattr(shown, "screen", False):
            _print_block(console, shown)
    if place:
        _print_text(console, Text(f"written to {place}"))


def print_table(console: Console, table: ReportTable) -> None:
    """Print a table with its caption, a long one in several blocks of rows if there is room."""
    rest = f" ({len(table.left_out)} more in the report)" if table.left_out else ""
    _print_text(console, Text(f"{table.caption}{rest}:", style="italic"))
    shown = [c.screen and (console.width >= _WIDE or not c.wide) for c in table.columns]
    columns = [c for c, own in zip(table.columns, shown, strict=True) if own and c.kind != "error"]
    listed = (row for k, row in enumerate(table.rows) if k not in table.left_out)
    rows = [_cells(table, row, shown) for row in listed]
    widths = [
        _longest([column.heading, *(cells[k] for cells in rows)])
        for k, column in enumerate(columns)
    ]
    room = (min(console.width, _WIDE) + _GAP) // (sum(widths) + _GAP * len(widths))
    blocks = max(1, min(room, len(rows) // _ROWS_OF_A_BLOCK))
    height = -(-len(rows) // blocks)
    rows += [[""] * len(columns)] * (blocks * height - len(rows))
    rows = [[cell for row in rows[k::height] for cell in row] for k in range(height)]
    columns *= blocks
    for part in _parts(columns, rows, console.width):
        own, cells = [columns[k] for k in part], [[row[k] for k in part] for row in rows]
        made = Table(
            box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, _GAP - 1, 0, 0)
        )
        for column, width in zip(own, _fitted_widths(own, cells, console.width), strict=True):
            justify: Literal["left", "right"] = "right" if column.numeric else "left"
            made.add_column(column.heading, justify=justify, overflow="fold", width=width)
        for each in cells:
            made.add_row(*each)
        console.print(made)


def _parts(
    columns: Sequence[TableColumn], rows: Sequence[Sequence[str]], width: int
) -> list[list[int]]:
    """Return the columns of every part of a table that a terminal shows one below the other.

    There are several only if numbers or headings would be broken. Each has the first column.
    """
    _, least, broken = _widths(columns, rows)
    room = width + _GAP
    if sum(broken) + _GAP * len(broken) <= room:
        return [list(range(len(columns)))]
    parts = [[0]]
    for k in range(1, len(columns)):
        last = parts[-1]
        if len(last) > 1 and sum(least[j] + _GAP for j in (*last, k)) > room:
            parts.append([0])
        parts[-1].append(k)
    return parts


def _widths(
    columns: Sequence[TableColumn], rows: Sequence[Sequence[str]]
) -> tuple[list[int], list[int], list[int]]:
    """Return widths of columns: on one line, with whole words, with broken words of texts."""
    full, least, broken = list[int](), list[int](), list[int]()
    for k, column in enumerate(columns):
        cells = [row[k] for row in rows]
        words, head = " ".join(cells).split(), _longest(column.heading.split())
        full.append(_longest([column.heading, *cells]))
        least.append(max(head, _longest(cells if column.numeric else words)))
        broken.append(least[k] if column.numeric else head)
    return full, least, broken


def _fitted_widths(
    columns: Sequence[TableColumn], rows: Sequence[Sequence[str]], width: int
) -> list[int]:
    """Return the widths of columns in a terminal: numbers and words stay whole.

    Words of texts, other than those of headings, are broken where the terminal is too narrow.
    """
    full, least, broken = _widths(columns, rows)
    room = width - _GAP * (len(columns) - 1)
    found = least if sum(least) <= room else broken
    for k in sorted(range(len(columns)), key=lambda k: full[k] - found[k]):
        found[k] += min(full[k] - found[k], max(room - sum(found), 0))
    return found


def _longest(texts: Sequence[str]) -> int:
    return max(map(len, texts), default=0)


_GAP = 2
"""Characters between two columns."""
_WIDE = 100
"""Characters from which on a terminal is wide; largest width of several blocks."""
_ROWS_OF_A_BLOCK = 3


def _cells(table: ReportTable, row: Sequence[Value], shown: Sequence[bool]) -> list[str]:
    """Return the shown texts of a row, standard deviations joined to the value before."""
    cells: list[str] = []
    before: Value = None
    for column, value, own in zip(table.columns, row, shown, strict=True):
        if own and column.kind == "error":
            cells[-1] = concise(before, value)
        elif own:
            text = cell_text(column, value)
            cells.append("" if text == "–" and not column.numeric else text)
            before = value
    return cells


def _print_block(console: Console, block: Block) -> None:
    match block:
        case Facts():
            for fact in block.facts:
                note = f" ({fact.note})" if fact.note else ""
                _print_text(console, Text(f"  {fact.name}: {fact.value}{note}"))
        case TextBlock():
            _print_text(console, Text(block.short or block.text))
        case ListingBlock():
            _print_text(console, Text(f"{block.title}:", style="italic"))
            console.print(Text(block.text.rstrip("\n")), soft_wrap=True)
        case ReportTable():
            print_table(console, block)


def _print_text(console: Console, text: Text) -> None:
    console.print(text, soft_wrap=not console.is_terminal)
