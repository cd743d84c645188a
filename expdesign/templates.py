"""Templates of text files, in the folder `templates` of a package."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined


@cache
def text_templates(package: str, *, autoescape: bool = False) -> Environment:
    """Return the templates of a package; blocks leave no lines, unknown names are errors."""
    return Environment(
        loader=PackageLoader(package, "templates"),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
