"""Output of commands: results to standard output, messages and errors to standard error."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.text import Text

from expdesign.configuration import ComputationError, InputError, Problem, quote
from expdesign.runfolder.files import json_text
from expdesign.stages.stage import short

FAILED = 1
BAD_INPUT = 2

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
    typer.echo(json_text(data, ensure_ascii=True))


def warn(text: str, console: Console | None = None) -> None:
    """Write a warning to standard error."""
    (console or messages()).print(Text.assemble(("warning: ", "yellow"), text))


def note(text: str, console: Console | None = None) -> None:
    """Write a remark to standard error."""
    (console or messages()).print(Text.assemble(("note: ", "cyan"), text))


def report_error(error: BaseException, *, as_json: bool) -> int | None:
    """Report an error and return its exit status; None for a bug.

    Problems are on standard error, with ``--json`` on standard output.
    """
    if isinstance(error, typer.TyperException):
        error = InputError(error.format_message())
    elif isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        error = InputError(f"{quote(str(error.filename))}: the name is too long")
    elif isinstance(error, OSError):
        named = "" if error.filename is None else f"{error.filename}: "
        error = ComputationError(f"{named}{error.strerror or error}")
    elif isinstance(error, KeyboardInterrupt | typer.Abort):
        error = ComputationError("interrupted")
    if isinstance(error, InputError):
        return _bad_input(error.problems, as_json, getattr(error, "details", {}))
    if isinstance(error, ComputationError):
        if as_json:
            write_json({"status": FAILED, "message": error.message, **error.details})
        else:
            messages().print(Text.assemble(("failed: ", "bold red"), error.message))
        return FAILED
    return None


def _bad_input(problems: Iterable[Problem], as_json: bool, details: Mapping[str, Any]) -> int:
    if as_json:
        data = [
            asdict(problem) | {"file": problem.file and str(problem.file)} for problem in problems
        ]
        write_json({"status": BAD_INPUT, "problems": data, **details})
        return BAD_INPUT
    console = messages()
    found = list(problems)
    for problem, following in zip(found, [*found[1:], None], strict=True):
        place = replace(problem, file=problem.file and Path(short(problem.file))).place
        line = Text.assemble(("error: ", "bold red"), (f"{place}: " if place else "", "bold"))
        console.print(line.append(problem.message))
        if problem.nearest:
            console.print(f"  did you mean '{problem.nearest}'?")
        # Equal allowed values of several problems in a row are printed once, after the last.
        if problem.allowed and (following is None or following.allowed != problem.allowed):
            console.print(f"  allowed: {problem.allowed}")
    return BAD_INPUT
