"""A view on the terminal: the answer first, then the advice, the numbers and the main tables."""

import io

import pytest
from rich.console import Console

from results.notation import concise
from results.render.terminal import print_table, print_view
from results.views.view import (
    Fact,
    FindingsBlock,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)


def printed(view, place=""):
    console = Console(file=io.StringIO(), width=100, markup=False, highlight=False)
    print_view(view, console, place)
    return console.file.getvalue().splitlines()


def test_the_answer_comes_first():
    columns = (
        TableColumn("mass", "kg", of=[16.307]),
        TableColumn("σ", kind="error", of=[0.042]),
        TableColumn("on the page only", of=[1.0], screen=False),
    )
    blocks = (
        ReportTable.of("masses", "Masses", columns, screen=True),
        TextBlock("for the page"),
        TextBlock("for the screen", screen=True),
        FindingsBlock(
            "the estimate",
            ReportTable("findings", "Findings", (), ()),
            ("the noise is coloured. What to do: measure longer",),
        ),
    )
    verdict = StageVerdict("Estimate", Level.BAD, "doubtful", "ML from 1 recording.")
    lines = printed(StageView(verdict, blocks, (Fact("median σ", "3 %", "of all"),)), "runs/a")
    assert lines[0] == "Estimate: doubtful. ML from 1 recording."
    assert lines[1] == "- the noise is coloured. What to do: measure longer"
    assert lines[2].strip() == "median σ: 3 % (of all)"
    assert lines[-1] == "written to runs/a"
    text = "\n".join(lines)
    assert "16.307(42)" in text
    assert "for the screen" in text
    assert "page" not in text


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (1.23451, 0.0067, "1.2345(67)"),
        (-0.5, 0.12, "−0.50(12)"),
        (1234.0, 56.0, "1234(56)"),
        (2.5, float("nan"), "2.5 fixed"),
        (2.5, 0.0, "2.5"),
        (None, 0.1, "–"),
    ],
)
def test_values_with_their_errors(value, std, text):
    assert concise(value, std) == text


@pytest.mark.parametrize(("width", "blocks"), [(40, 1), (60, 2), (100, 3), (200, 3)])
def test_a_long_table_uses_the_width(width, blocks):
    columns = (
        TableColumn("parameter", kind="text", of=[f"p{k}" for k in range(1, 24)]),
        TableColumn("value", "kg m^2", of=[k + 0.25 for k in range(1, 24)]),
    )
    console = Console(file=io.StringIO(), width=width)
    print_table(console, ReportTable.of("parameters", "Parameters", columns, screen=True))
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 3 + -(-23 // blocks)
    assert max(map(len, lines)) <= min(width, 100)
    words = " ".join(lines[3:]).split()
    assert sorted(words[::2], key=lambda word: int(word[1:])) == [f"p{k}" for k in range(1, 24)]
    assert all(float(words[k + 1]) == int(words[k][1:]) + 0.25 for k in range(0, len(words), 2))


def test_a_narrow_terminal_leaves_words_whole_and_wide_columns_out():
    columns = (
        TableColumn("largest source of error", kind="text", of=["force_constant.common", "noise"]),
        TableColumn("share of all", "%", of=[41.25, 3.5]),
        TableColumn("further", "%", of=[7.75, 2.5], wide=True),
        *[TableColumn("N", of=[123.5, 2.5])] * 4,
    )
    texts = {}
    for width in (60, 120):
        console = Console(file=io.StringIO(), width=width)
        print_table(console, ReportTable.of("narrow", "Narrow", columns, screen=True))
        texts[width] = console.file.getvalue()
    assert all("force_constant.common" in text for text in texts.values())
    assert ["7.75" in text for text in texts.values()] == [False, True]


@pytest.mark.parametrize("width", [80, 200])
def test_a_narrow_terminal_cuts_no_cell(width):
    heads = ("variance about the prediction", "variance of the noise", "allowed error", "speed")
    columns = [TableColumn(head, "N^2", of=[411.7, 383.1]) for head in heads]
    columns.append(TableColumn("verdict", kind="text", of=["passes", "fails"]))
    table = ReportTable.of("wide", "Wide", columns, screen=True)
    console = Console(file=io.StringIO(), width=width)
    print_table(console, table)
    text = console.file.getvalue()
    assert "…" not in text
    assert text.count("411.7") == len(heads)
    assert "passes" in text
    assert all(word in text for head in heads for word in head.split())
