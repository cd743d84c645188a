"""Output of commands: results to standard output, everything else to standard error."""

from __future__ import annotations

import json
import os
from typing import Any

import typer
from rich.console import Console
from rich.text import Text

from expdesign.runfolder.files import json_values

_PIPED_WIDTH = 200
"""Characters of a line where the output is no terminal, so that nothing is cut."""


def results() -> Console:
    """Return the console for results, on standard output."""
    console = Console(highlight=False, markup=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _PIPED_WIDTH
    return console


def messages() -> Console:
    """Return the console for progress, warnings and errors, on standard error."""
    console = Console(stderr=True, highlight=False, markup=False)
    console.soft_wrap = not console.is_terminal
    return console


def say(text: str) -> None:
    """Write words to standard output: broken between them on a terminal, elsewhere not at all."""
    console = results()
    console.print(text, soft_wrap=not console.is_terminal)


def write_json(data: Any) -> None:
    """Write data to standard output as JSON; NaN and ±inf, which JSON does not have, as null."""
    typer.echo(json.dumps(json_values(data), indent=2))


def warn(text: str, console: Console | None = None) -> None:
    """Write a warning to standard error."""
    (console or messages()).print(Text.assemble(("warning: ", "yellow"), text))


def note(text: str, console: Console | None = None) -> None:
    """Write a remark to standard error."""
    (console or messages()).print(Text.assemble(("note: ", "cyan"), text))
