"""A view on the terminal: the answer first, then the advice, the numbers and the main tables."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.tolerance_test import hidden_error
from expdesign.robot.derived import KnownQuantity, parameters_of
from results.notation import concise
from results.render.terminal import brief_warnings, print_table, print_view
from results.views.blocks import (
    budget_blocks,
    constants_blocks,
    findings_block,
    undetected_advice,
)
from results.views.parameter_blocks import derived_blocks, symbols_blocks
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


def test_a_limited_screen_has_fewer_rows_and_one_line_for_each_warning():
    names = [f"p{k}" for k in range(1, 61)]
    columns = (
        TableColumn("parameter", kind="parameter", of=names),
        TableColumn("value", of=[float(k) for k in range(60)]),
    )
    tables = tuple(
        ReportTable.of(key, key, columns[:number], screen=True)
        for key, number in (("first", 1), ("last", 2))
    )
    verdict = StageVerdict("Estimate", Level.BAD, "not converged", "It ended: no step was found.")
    warnings = (
        "ml: no step was found",
        "the forces lag behind the lengths by 3 ms. " + "State the delay. " * 20,
        *(f"warning number {k}" for k in range(3)),
    )
    whole = StageView(verdict, tables, warnings=warnings)
    assert brief_warnings(whole, warnings, 100) == list(warnings)
    view = replace(whole, most_lines=20)
    brief = brief_warnings(view, warnings, 80)
    assert brief[0].startswith("the forces lag behind the lengths by 3 ms. ")
    assert brief[0].endswith(" … (report)")
    assert len(brief[0]) <= 80 - len("warning: ")
    assert brief[1:] == ["warning number 0", "warning number 1", "1 more in the report"]
    console = Console(file=io.StringIO(), width=80, force_terminal=True, no_color=True)
    print_view(view, console, "runs/a", below=len(brief))
    lines = console.file.getvalue().splitlines()
    assert 15 <= len(lines) + len(brief) <= 20
    assert lines[-1] == "written to runs/a"
    assert len(printed(whole)) > 20
    text = "\n".join(lines)
    assert "last (57 more in the report):" in text
    assert text.count("p12") == 1


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


_WHITE = Assumption("the noise is white", "the noise is coloured", "measure longer")
_FAILS = _WHITE.fails("r = 0.5", where="force 1")


@pytest.mark.parametrize(
    ("finding", "again", "lines"),
    [
        (
            replace(_FAILS, first=True),
            "estimate",
            ["What to do: measure longer. Then estimate again. Observed: r = 0.5"],
        ),
        (_WHITE.holds("correlation 0.1", 0.5, 0.001), "estimate", ["add a motion"]),
        (
            _FAILS,
            "",
            ["the noise is coloured (force 1). What to do: measure longer. Observed: r = 0.5"],
        ),
        (
            _WHITE.skip("one period", "measure two"),
            "",
            ["the noise is white: not tested. one period. What to do: measure two"],
        ),
    ],
)
def test_what_to_do_precedes_the_evidence(finding, again, lines):
    advice = "add a motion" if again else ""
    block = findings_block("findings", [finding], "the noise", again=again, advice=advice)
    assert list(block.lines) == lines
    assert [column.title for column in block.table.columns][2:] == ["advice", "observation"]


def test_rows_that_are_left_out_are_counted():
    columns = (TableColumn("part", kind="text", of=["a", "b", "c"]), TableColumn("n", of=[1, 2, 3]))
    table = replace(
        ReportTable.of("parts", "Parts", columns, screen=True), left_out=frozenset({0, 2})
    )
    lines = printed(StageView(StageVerdict("A", Level.GOOD, "done", "."), (table,), ()))
    assert lines[1] == "Parts (2 more in the report):"
    assert [line.split() for line in lines[4:]] == [["b", "2"]]


def quantity(name, value=2.0, std=0.5):
    return KnownQuantity(
        quantity=name,
        unit="kg m^2",
        value=value,
        std=std,
        std_random=std,
        std_systematic=0.0,
        rel_std_percent=25.0,
        source="noise",
    )


def test_a_brief_screen_lists_what_decides():
    names = ["mass", "centre_z", "inertia_xx", "inertia_xy", "motor_inertia", "gravity_force_1"]
    rows = [quantity(name) for name in names]
    shown = {}
    for brief in (False, True):
        (table,) = derived_blocks("derived", rows, "of the estimate", brief=brief)
        shown[brief] = [row[0] for k, row in enumerate(table.rows) if k not in table.left_out]
    assert shown == {False: names, True: ["mass", "centre_z", "inertia_xx", "motor_inertia"]}
    seen = parameters_of(names)
    assert {"p10", "p6", "sx", "m_drive"} <= seen
    (symbols,) = symbols_blocks(["p1", "p10", "sx", "m_drive"], screen=True, left_out=seen)
    assert "p1:" in symbols.short
    assert "p10" not in symbols.short
    assert "p10" in symbols.text


def test_a_change_is_not_compared_with_an_a_priori_value_of_rounding_size():
    row = SimpleNamespace(unit="kg m", std_undetected=1.2e-3)
    rows = [
        SimpleNamespace(parameter=name, a_priori=size, **vars(row))
        for name, size in (("sx", 1.3e-16), ("sy", 1e-3))
    ]
    effect = SimpleNamespace(kind="any", text="", worst="sx", sigmas=1.0, forces=1.0)
    text = undetected_advice([effect], rows)
    assert "sy by 0.0012 kg m" in text
    assert "sx" not in text


def test_deviations_and_constants_are_shown_in_the_units_of_the_findings():
    numbers = {"tolerance": 1e-4, "value": -2e-5, "std": 3e-5, "ratio": 0.3, "z": -0.2}
    deviations = [SimpleNamespace(deviation="d", unit=unit, **numbers) for unit in ("m", "N", "1")]
    share = SimpleNamespace(parameter="p1", source="noise", share_percent=100.0)
    pitch = SimpleNamespace(
        constant="p", unit="m", stated=0.024, tolerance=2e-4, value=0.0241, std=1e-5
    )
    best = SimpleNamespace(
        systematic=SimpleNamespace(groups={"delay": 1}, with_priors=True), constants=[pitch]
    )
    result = SimpleNamespace(
        best="ml", best_estimator=best, budget={"ml": [share]}, deviations={"ml": deviations}
    )
    *_, table = budget_blocks(result)
    assert [row[1] for row in table.rows] == ["mm", "N", "%"]
    shown = np.array([row[2:5] for row in table.rows])
    np.testing.assert_allclose(shown, np.outer([1e3, 1, 100], [1e-4, -2e-5, 3e-5]))
    assert table.rows[0][7] == pytest.approx(1e3 * hidden_error(1e-4, 3e-5, 3))
    (constants,) = constants_blocks(result)
    assert constants.rows[0] == ("p", "mm", *map(pytest.approx, (24.0, 0.2, 24.1, 0.01)))


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


@pytest.mark.parametrize(("width", "parts"), [(80, 2), (160, 1)])
def test_a_table_that_is_too_wide_is_printed_in_parts(width, parts):
    """As that of a sweep: no heading is broken inside a word, every part has the first column."""
    heads = ("log det F", "equal time", "median", "measuring", "certificates", "iterations")
    columns = [
        TableColumn("design", of=[1, 2]),
        TableColumn("frequency", kind="text", of=["0.1 Hz", "0.25 Hz"]),
        *(TableColumn(head, "kg m^2", of=[1234567.125, 2.5]) for head in heads),
        TableColumn("proved", of=[True, False], proof=True),
    ]
    console = Console(file=io.StringIO(), width=width)
    print_table(console, ReportTable.of("sweep", "Sweep", columns, screen=True))
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= width
    words = text.split()
    assert all(word in words for head in heads for word in head.split())
    assert words.count("design") == parts


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
