"""Command line: the commands in the order of their use, and their exit status.

Each command is a function that is imported here. It imports its computation when it runs, takes
`--json`, returns nothing after a success, raises `StageFailed` (exit 1) or `InputError` (exit 2)
otherwise, and writes results to standard output, everything else to standard error
(`expdesign.cli.output`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import wraps
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

from expdesign.cli import machine_commands, run_commands
from expdesign.interruption import without_interruptions

app = typer.Typer(
    name="expdesign",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


class _Command(TyperCommand):
    """A command that takes an option once: of several values the last would silently win."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        _, _, given = self.make_parser(ctx).parse_args(args=[*args])
        for one, times in Counter(given).items():
            if times > 1 and isinstance(one, TyperOption) and not (one.multiple or one.is_flag):
                raise typer.BadParameter("it takes one value, and is given more", ctx, one)
        return super().parse_args(ctx, args)


def _print_version(wanted: bool) -> None:
    if not wanted:
        return
    try:
        typer.echo(version("expdesign"))
    except PackageNotFoundError:
        typer.echo("unknown (expdesign is not installed)")
    raise typer.Exit


@app.callback()
def _expdesign(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Find the dynamic parameters of a hexapod: design the motion, simulate, estimate, validate.

    All from one YAML file. RUN.yaml is a run file, or the name of one that ships (`palida`).

    Exit status 0: done and within limits; 1: failed, interrupted, the result breaks a limit, a goal
    of `plan` is not reachable, or `certify` does not prove everything; 2: bad input.
    """


def _interruptible(command: Callable[..., None]) -> Callable[..., None]:
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


_NAMES = {"next_motion": "next"}
"""Names of commands that are not those of their functions."""

for _command in (
    machine_commands.robots,
    machine_commands.init,
    machine_commands.init_data,
    machine_commands.check,
    run_commands.design,
    run_commands.plan,
    run_commands.next_motion,
    run_commands.simulate,
    run_commands.montecarlo,
    run_commands.noise,
    run_commands.estimate,
    run_commands.validate,
    machine_commands.model,
    machine_commands.export,
    machine_commands.certify,
    run_commands.report,
    run_commands.compare,
    run_commands.run,
):
    app.command(_NAMES.get(_command.__name__), cls=_Command)(_interruptible(_command))


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """Run the command line with arguments, the program's name not among them; return 0, 1 or 2.

    Problems are on standard error, with ``--json`` on standard output.
    """
    as_json = "--json" in arguments
    try:
        _refuse_empty_texts(arguments)
        # Typer itself writes its messages about usage, unless they are to be JSON.
        status = app(args=list(arguments), prog_name="expdesign", standalone_mode=not as_json)
    except SystemExit as stop:
        status = stop.code
    except (Exception, KeyboardInterrupt) as error:
        with without_interruptions():
            from expdesign.cli.output import report_error  # --help needs no configuration

            interrupted = isinstance(error, InterruptedCommand)
            status = report_error(KeyboardInterrupt() if interrupted else error, as_json=as_json)
        if status is None:
            raise
    if not isinstance(status, int):
        return 0
    return status if status in (0, 1, 2) else 1


def _refuse_empty_texts(arguments: Sequence[str]) -> None:
    """Refuse empty texts: no command accepts one, and as a path it would be the current folder."""
    for before, text in zip(["", *arguments], arguments, strict=False):
        option, sign, value = text.partition("=")
        empty_option = option.startswith("--") and sign and not value
        if text and not empty_option:
            continue
        from expdesign.configuration import InputError

        key = option if empty_option else before if before.startswith("--") else ""
        message = "the text is empty" if key else "an argument of the command is an empty text"
        raise InputError(message, key=key)
