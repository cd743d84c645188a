"""Text of reports: HTML pages that work offline, and LaTeX tables with booktabs rules."""

from __future__ import annotations

import base64
import re
import zlib
from functools import cache
from importlib.resources import files

from jinja2 import Environment
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from expdesign.templates import text_templates
from results.notation import GREEK, parts, symbol, symbol_parts
from results.views.view import Page, ReportTable, TableColumn, Value, cell_text, sort_key

_TEMPLATES = "templates"


def html_page(page: Page) -> str:
    """Return the page as HTML.

    It contains styles, scripts and the plotting library, and figures as data URIs; its content
    security policy forbids the browser to load anything. Every text is escaped.
    """
    template = _environment().get_template("page.html.j2")
    return template.render(
        page=page,
        style=_asset("style.css"),
        scripts=[_asset(name) for name in ("tables.js", *(("view.js",) if page.moves else ()))],
        library=plotting_library() if page.moves else "",
    )


@cache
def plotting_library() -> str:
    """Return plotly.js, deflated and in base64: a third of its size."""
    packed = zlib.compress(get_plotlyjs().encode("utf-8"), 9)
    return base64.b64encode(packed).decode("ascii")


def symbol_html(name: str) -> Markup:
    """Return a parameter's name as HTML: ``r_alpha`` → r with the index α."""
    letter, index = (GREEK.get(part, (part, part))[1] for part in symbol_parts(name))
    if not letter:
        return escape(name)
    if not index:
        return Markup("<i>{}</i>").format(letter)
    return Markup("<i>{}</i><sub>{}</sub>").format(letter, index)


def unit_html(unit: str) -> Markup:
    """Return a unit as HTML: ``kg m^2`` with a raised 2."""
    raised = _POWER.sub(lambda power: f"<sup>{power[1].replace('-', '−')}</sup>", str(escape(unit)))
    return Markup(raised)


def code_html(text: str) -> Markup:
    """Return text as HTML, with keys and commands between backticks as code."""
    return Markup(re.sub("`([^`]*)`", r"<code>\1</code>", str(escape(text))))


@cache
def _environment() -> Environment:
    environment = text_templates("results.render", autoescape=True)
    environment.filters["symbol"] = symbol_html
    environment.filters["unit"] = unit_html
    environment.filters["code"] = code_html
    environment.globals["cell_text"] = cell_text
    environment.globals["sort_key"] = sort_key
    return environment


def _asset(name: str) -> Markup:
    """Return a style sheet or script of the package, for the page as it is."""
    text = files("results.render").joinpath(_TEMPLATES, name).read_text(encoding="utf-8")
    return Markup(text)


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
