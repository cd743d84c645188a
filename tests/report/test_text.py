"""Numbers and tables as text: on pages, in LaTeX and as CSV."""

import math
from dataclasses import dataclass

import pytest

from results.comparison.comparison import write_report_csv
from results.notation import duration, readable
from results.render.markup import code_html, escape_latex, latex_table, symbol_html, unit_html
from results.views.view import ReportTable, TableColumn, cell_text, sort_key


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.005, 4, "0.005"),
        (-1.299, 4, "−1.299"),
        (0.0066421, 4, "0.006642"),
        (6.703943e-07, 4, "6.704·10⁻⁷"),
        (-3.2e10, 3, "−3.2·10¹⁰"),
        (1667.0, 3, "1667"),
        (123456.789, 3, "123457"),
        (103.28528, 6, "103.285"),
        (9.9999, 3, "10.0"),
        (0.0, 3, "0"),
        (-0.0, 3, "0"),
        (math.inf, 3, "∞"),
        (-math.inf, 3, "−∞"),
        (math.nan, 3, "–"),
    ],
)
def test_readable(value, digits, text):
    assert readable(value, digits) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.25, "0.25 s"), (160, "2 min 40 s"), (7500, "2 h 5 min")]
)
def test_duration(seconds, text):
    assert duration(seconds) == text


def table():
    columns = (
        TableColumn("parameter", kind="parameter"),
        TableColumn("unit", kind="text"),
        TableColumn("share", "%"),
        TableColumn("a & b", kind="text"),
        TableColumn("ok", kind="outcome"),
    )
    rows = [
        ("r_alpha", "kg m^2", 6.7e-9, "100 % of $x_1$ \\ {~^}", True),
        ("odd name", "N s/m", None, "≤ 5", False),
    ]
    return ReportTable.of("t", "All of it", columns, rows)


def test_latex():
    text = latex_table(table())
    lines = text.splitlines()
    assert r"\begin{tabular}{llrll}" in lines
    assert lines[4] == r"parameter & unit & share [\%] & a \& b & ok \\"
    assert lines[6] == (
        r"$r_{\alpha}$ & kg m$^{2}$ & $6.7 \cdot 10^{-9}$ & "
        r"100 \% of \$x\_1\$ \textbackslash{} \{\textasciitilde{}\textasciicircum{}\} & yes \\"
    )
    assert lines[7] == r"odd name & N s/m & -- & $\leq$ 5 & no \\"
    assert [line for line in lines if line.startswith("\\")][-1] == r"\end{tabular}"
    assert text.count("{") == text.count("}")


def test_latex_of_hostile_text_stays_on_its_line():
    assert escape_latex("a\n\\end{tabular}\r%") == r"a \textbackslash{}end\{tabular\} \%"


def test_csv_has_all_digits(tmp_path):
    path = tmp_path / "table.csv"
    write_report_csv(path, table())
    assert path.read_text(encoding="utf-8").splitlines() == [
        "parameter,unit,share [%],a & b,ok",
        "r_alpha,kg m^2,6.7e-09,100 % of $x_1$ \\ {~^},True",
        "odd name,N s/m,,≤ 5,False",
    ]


def test_rows_have_a_value_for_every_column():
    with pytest.raises(ValueError, match="2 values"):
        ReportTable.of("t", "", (TableColumn("a"), TableColumn("b")), [(1.0,)])


def test_what_cells_are_sorted_by():
    assert [sort_key(value) for value in (0.1, 3, True, None, math.nan)] == [
        "0.1",
        "3",
        "1",
        "",
        "",
    ]
    assert cell_text(TableColumn("a"), None) == "–"


@pytest.mark.parametrize(
    ("name", "html"),
    [
        ("r_alpha", "<i>r</i><sub>α</sub>"),
        ("p10", "<i>p</i><sub>10</sub>"),
        ("Ixy", "<i>I</i><sub>xy</sub>"),
        ("<b>", "&lt;b&gt;"),
    ],
)
def test_symbols(name, html):
    assert str(symbol_html(name)) == html


def test_keys_between_backticks_are_code_and_escaped():
    assert str(code_html("state `a: <b>` & go")) == "state <code>a: &lt;b&gt;</code> &amp; go"
    assert str(code_html("a single ` stays <")) == "a single ` stays &lt;"


def test_units():
    assert str(unit_html("kg m^2")) == "kg m<sup>2</sup>"
    assert str(unit_html("<i>^-1")) == "&lt;i&gt;<sup>−1</sup>"


def test_a_table_is_made_of_records():
    @dataclass(frozen=True)
    class Part:
        inner: complex | None
        count: float

    columns = (
        TableColumn("real", of="inner.real", factor=1000),
        TableColumn("count", of="count"),
        TableColumn("both", of=lambda part: part.inner is not None),
    )
    table = ReportTable.of("t", "", columns, [Part(2 + 1j, 3), Part(None, 4)])
    assert table.rows == ((2000.0, 3, True), (None, 4, False))
