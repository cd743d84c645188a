"""HTML: a page in one file that works offline."""

from __future__ import annotations

import base64
import re
import zlib
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from results.notation import GREEK, symbol_parts
from results.views.view import Page, cell_text, sort_key

_TEMPLATES = "templates"
_POWER = re.compile(r"\^(-?\d+)")


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
    pieces = _POWER.split(unit)
    return Markup().join(
        Markup("<sup>{}</sup>").format(piece.replace("-", "−")) if position % 2 else escape(piece)
        for position, piece in enumerate(pieces)
    )


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("results.render", _TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["symbol"] = symbol_html
    environment.filters["unit"] = unit_html
    environment.globals["cell_text"] = cell_text
    environment.globals["sort_key"] = sort_key
    return environment


def _asset(name: str) -> Markup:
    """Return a style sheet or script of the package, for the page as it is."""
    text = files("results.render").joinpath(_TEMPLATES, name).read_text(encoding="utf-8")
    return Markup(text)
