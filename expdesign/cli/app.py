"""Command line: the commands in the order of their use, and their exit status.

Each command is a function that is imported here. It imports its computation when it runs, takes
`--json`, returns nothing after a success, raises `StageFailed` (exit 1) or `InputError` (exit 2)
otherwise, and writes results to standard output, everything else to standard error
(`expdesign.cli.output`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
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
    """A command that takes an option once, and no empty texts.

    Of several values the last would silently win, and an empty path is the current folder.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        values, _, given = self.make_parser(ctx).parse_args(args=[*args])
        for one, times in Counter(given).items():
            value, is_option = values[one.name or ""], isinstance(one, TyperOption)
            if "" in (value if isinstance(value, list | tuple) else [value]):
                from expdesign.configuration import InputError  # --help needs no configuration

                if is_option:
                    raise InputError("the text is empty", key=one.opts[0])
                raise InputError("an argument of the command is an empty text")
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
    app.command(_NAMES.get(_command.__name__), cls=_Command)(_command)


def run(app: typer.Typer, arguments: Sequence[str]) -> int:
    """Run the command line with arguments, the program's name not among them; return 0, 1 or 2.

    Problems are on standard error, with ``--json`` on standard output.
    """
    as_json = "--json" in arguments
    try:
        # Typer itself writes its messages about usage, unless they are to be JSON.
        status = app(args=list(arguments), prog_name="expdesign", standalone_mode=not as_json)
    except SystemExit as stop:
        status = stop.code
    except Exception as error:
        status = _report(error, as_json=as_json)
        if status is None:
            raise
    if status == _INTERRUPTED:
        status = _report(KeyboardInterrupt(), as_json=as_json)
    if not isinstance(status, int):
        return 0
    return status if status in (0, 1, 2) else 1


_INTERRUPTED = 130
"""Status with which Typer ends a command after a `KeyboardInterrupt`."""


def _report(error: BaseException, *, as_json: bool) -> int | None:
    with without_interruptions():
        from expdesign.cli.output import report_error  # --help needs no configuration

        return report_error(error, as_json=as_json)
