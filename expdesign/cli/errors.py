"""From what goes wrong to a message and an exit status; a traceback means a bug of ours."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.text import Text

from expdesign.cli.output import messages, write_json
from expdesign.interruption import ignored

if TYPE_CHECKING:
    from expdesign.configuration import Problem

FAILED = 1
BAD_INPUT = 2
_JSON = "--json"
INTERRUPTED = "interrupted"


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """Run the command line with arguments, the program's name not among them; return 0, 1 or 2.

    Problems are on standard error, with ``--json`` on standard output.
    """
    as_json = _JSON in arguments
    if (option := _empty_text(arguments)) is not None:
        from expdesign.configuration import Problem

        message = "the text is empty" if option else "an argument of the command is an empty text"
        return _bad_input([Problem(message, key=option)], as_json)
    try:
        # Typer itself writes its messages about usage, unless they are to be JSON.
        status = app(args=list(arguments), prog_name="expdesign", standalone_mode=not as_json)
    except SystemExit as stop:
        status = stop.code
    except (Exception, KeyboardInterrupt) as error:
        with ignored():
            status = _status_of(error, as_json)
        if status is None:
            raise
    if not isinstance(status, int):
        return 0
    return status if status in (0, FAILED, BAD_INPUT) else FAILED


def ended_plainly(command: Callable[..., None]) -> Callable[..., None]:
    """Report an interruption of a command as a failure, instead of Typer's own message."""

    @wraps(command)
    def ended(*arguments: Any, **options: Any) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt as interruption:
            raise InterruptedCommand from interruption

    return ended


class InterruptedCommand(Exception):  # noqa: N818 - no error but the end of a command
    """Interruption of a command."""


def _status_of(error: BaseException, as_json: bool) -> int | None:
    """Report an error and return its exit status; None for a bug.

    Modules are loaded here, since --help needs none of them.
    """
    if isinstance(error, KeyboardInterrupt | InterruptedCommand | typer.Abort):
        return _failed(INTERRUPTED, as_json)
    from expdesign.configuration import ComputationError, InputError, Problem

    if isinstance(error, InputError):
        return _bad_input(error.problems, as_json)
    if isinstance(error, typer.TyperException):
        return _bad_input([Problem(error.format_message())], as_json)
    if isinstance(error, ComputationError):
        return _failed(error.message, as_json, error.details)
    if isinstance(error, OSError):
        return _of_system(error, as_json)
    return None


def _of_system(error: OSError, as_json: bool) -> int:
    if error.errno == errno.ENAMETOOLONG:  # whoever named the file can help it
        from expdesign.configuration import Problem, quote

        return _bad_input([Problem(f"{quote(str(error.filename))}: the name is too long")], as_json)
    named = "" if error.filename is None else f"{error.filename}: "
    return _failed(f"{named}{error.strerror or error}", as_json)


def _empty_text(arguments: Sequence[str]) -> str | None:
    """Return the option of an empty text, empty for an argument; None without an empty text.

    No command accepts it, and as a path it would be the current folder.
    """
    for before, text in zip(["", *arguments], arguments, strict=False):
        option, sign, value = text.partition("=")
        if not text:
            return before if before.startswith("--") else ""
        if option.startswith("--") and sign and not value:
            return option
    return None


def _bad_input(problems: Iterable[Problem], as_json: bool) -> int:
    if as_json:
        data = [
            asdict(problem) | {"file": problem.file and str(problem.file)} for problem in problems
        ]
        write_json({"status": BAD_INPUT, "problems": data})
        return BAD_INPUT
    from expdesign.stages.workspace import short

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


def _failed(message: str, as_json: bool, details: dict[str, Any] | None = None) -> int:
    if as_json:
        write_json({"status": FAILED, "message": message, **(details or {})})
    else:
        messages().print(Text.assemble(("failed: ", "bold red"), message))
    return FAILED
