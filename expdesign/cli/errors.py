"""From what goes wrong to a message and an exit status; a traceback means a bug of ours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import typer
from rich.text import Text

from expdesign.cli.output import messages, write_json
from expdesign.configuration import InputError, Problem
from expdesign.stages.outcome import StageFailed
from expdesign.stages.progress import short

FAILED = 1
BAD_INPUT = 2
_JSON = "--json"


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """Run the command line.

    Parameters
    ----------
    app : typer.Typer
    arguments : sequence of str
        Without the name of the program.

    Returns
    -------
    int
        Exit status 0, 1 or 2. Problems are on standard error, with ``--json`` on standard output.
    """
    as_json = _JSON in arguments
    try:
        # Typer itself writes its messages about usage, unless they are to be JSON.
        status = app(args=list(arguments), prog_name="expdesign", standalone_mode=not as_json)
    except SystemExit as stop:
        status = stop.code
    except InputError as error:
        return _bad_input(error.problems, as_json)
    except typer.TyperException as error:
        return _bad_input([Problem(error.format_message())], as_json)
    except (StageFailed, KeyboardInterrupt, typer.Abort, OSError) as error:
        return _failed(_failure(error), as_json)
    if not isinstance(status, int):
        return 0
    return status if status in (0, FAILED, BAD_INPUT) else FAILED


def _failure(error: BaseException) -> StageFailed:
    if isinstance(error, StageFailed):
        return error
    if isinstance(error, OSError):
        named = "" if error.filename is None else f"{error.filename}: "
        return StageFailed(f"{named}{error.strerror or error}")
    return StageFailed("interrupted")


def _bad_input(problems: Iterable[Problem], as_json: bool) -> int:
    if as_json:
        write_json({"status": BAD_INPUT, "problems": [_as_data(p) for p in problems]})
        return BAD_INPUT
    console = messages()
    for problem in problems:
        place = _place(problem)
        line = Text.assemble(("error: ", "bold red"), (f"{place}: " if place else "", "bold"))
        console.print(line.append(problem.message))
        if problem.nearest:
            console.print(f"  did you mean '{problem.nearest}'?")
        if problem.allowed:
            console.print(f"  allowed: {problem.allowed}")
    return BAD_INPUT


def _failed(failure: StageFailed, as_json: bool) -> int:
    if as_json:
        write_json({"status": FAILED, "message": failure.message, **failure.details})
    else:
        messages().print(Text.assemble(("failed: ", "bold red"), failure.message))
    return FAILED


def _place(problem: Problem) -> str:
    file = None if problem.file is None else Path(short(problem.file))
    return replace(problem, file=file).place


def _as_data(problem: Problem) -> dict[str, Any]:
    return asdict(problem) | {"file": None if problem.file is None else str(problem.file)}
