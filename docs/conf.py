"""The site of these pages, built by Sphinx: `make docs`.

The pages are written for the repository; this file adds the settings of the site. Its source is the
root of the repository, so that links between the pages and to files outside `docs/` are the same in
both. The table of contents consists of the links of `index.md`, in their order. Formulas become
MathML, which browsers display without further programs.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

project = "expdesign"
author = "expdesign developers"
html_title = "expdesign"

extensions = ["myst_parser"]
root_doc = "docs/index"
include_patterns = ["*.md", "docs/**.md", "benchmarks/**.md", "examples/**.md"]
exclude_patterns = [".*", "build", "dist", "runs", "tests"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # as on the pages of the repository
suppress_warnings = [
    "myst.header",  # the headings of tables that benchmarks write
    "toc.not_readable",
]
nitpicky = True

html_math_renderer = "mathml"
html_theme = "furo"
html_extra_path = ["site/index.html"]  # leads to docs/index.html
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False

_PAGE = re.compile(r"\]\(((?:\.\./)?[\w-]+)\.md(?:#[\w-]*)?\)")
_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)


def _contents(text: str) -> str:
    """Return the table of contents of the pages that a text links to, under its headings."""
    tables, known = [], set()
    _, *sections = _HEADING.split(text)
    for heading, section in zip(sections[::2], sections[1::2], strict=True):
        pages = [page for page in dict.fromkeys(_PAGE.findall(section)) if page not in known]
        known |= set(pages)
        listed = "\n".join(pages)
        tables.append(f"```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{listed}\n```\n")
    return "\n".join(tables)


def _add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    if page == app.config.root_doc:
        source[0] += "\n" + _contents(source[0])
    elif page == "README" or {"benchmarks", "examples", "notes"} & set(Path(page).parts):
        source[0] = "---\norphan: true\n---\n" + source[0]


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _displayed(writer: Any, node: nodes.math_block) -> None:
    formula = convert(node.astext(), display="block")
    writer.body.append(f'<div style="overflow: auto hidden">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Add the table of contents to the page of tasks, and the formulas."""
    app.connect("source-read", _add_contents)
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
