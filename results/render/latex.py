"""LaTeX: tables with booktabs rules."""

from __future__ import annotations

import re

from results.notation import parts, symbol
from results.views.view import ReportTable, TableColumn, Value, cell_text

_POWER = re.compile(r"\^(-?\d+)")
_SPECIAL = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "−": "$-$",
    "·": r"$\cdot$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "∞": r"$\infty$",
    "²": r"$^{2}$",
    "µ": r"$\mu$",
    "°": r"$^{\circ}$",
    "…": r"\ldots{}",
    "–": "--",
    "⁻": r"$^{-}$",
    "α": r"$\alpha$",
    "β": r"$\beta$",
    "φ": r"$\varphi$",
    "θ": r"$\theta$",
    "ψ": r"$\psi$",
    "σ": r"$\sigma$",
    "Δ": r"$\Delta$",
    "Σ": r"$\Sigma$",
    "√": r"$\surd$",
}


def latex_table(table: ReportTable) -> str:
    """Return a `tabular` with booktabs rules; numbers to the right, everything else to the left."""
    layout = "".join("r" if column.numeric else "l" for column in table.columns)
    lines = [
        f"% {_one_line(table.caption)}",
        r"% needs \usepackage{booktabs}",
        rf"\begin{{tabular}}{{{layout}}}",
        r"\toprule",
        " & ".join(_heading(column) for column in table.columns) + r" \\",
        r"\midrule",
    ]
    for row in table.rows:
        cells = [_cell(column, value) for column, value in zip(table.columns, row, strict=True)]
        lines.append(" & ".join(cells) + r" \\")
    lines += [r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def escape_latex(text: str) -> str:
    r"""Return text with the special characters of LaTeX escaped.

    Examples
    --------
    >>> print(escape_latex("5 % of f_1"))
    5 \% of f\_1
    """
    return "".join(_SPECIAL.get(letter, letter) for letter in _one_line(text))


def _heading(column: TableColumn) -> str:
    unit = f" [{_unit(column.unit)}]" if column.unit else ""
    return f"{escape_latex(column.title)}{unit}"


def _unit(unit: str) -> str:
    pieces = _POWER.split(unit)
    return "".join(
        f"$^{{{piece}}}$" if position % 2 else escape_latex(piece)
        for position, piece in enumerate(pieces)
    )


def _cell(column: TableColumn, value: Value) -> str:
    if column.kind == "parameter" and isinstance(value, str):
        name = symbol(value)
        return name if name != value else escape_latex(value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        mantissa, power = parts(float(value), column.digits)
        if mantissa == "–":
            return "--"
        mantissa = mantissa.replace("∞", r"\infty")
        return f"${mantissa}$" if power is None else rf"${mantissa} \cdot 10^{{{power}}}$"
    text = cell_text(column, value)
    if column.title == "unit":
        return _unit(text)
    return escape_latex(text)


def _one_line(text: str) -> str:
    return " ".join(text.split())
