"""Command line: the commands in the order of their use.

Each command is a function that is imported here. It imports what it computes with when it runs,
takes `--json`, returns nothing when all is well, raises `StageFailed` (exit 1) or `InputError`
(exit 2) otherwise, and writes results to standard output, everything else to standard error
(`expdesign.cli.output`).
"""

from __future__ import annotations

from collections import Counter
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

from expdesign.cli import controller_commands, machine_commands, run_commands
from expdesign.cli.errors import ended_plainly

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

    Exit status 0: done and within limits; 1: failed, or the result breaks a limit; 2: bad input.
    """


for _command in (
    machine_commands.robots,
    machine_commands.init,
    machine_commands.check,
    run_commands.design,
    run_commands.simulate,
    run_commands.montecarlo,
    run_commands.noise,
    run_commands.estimate,
    run_commands.validate,
    controller_commands.model,
    controller_commands.export,
    controller_commands.certify,
    run_commands.report,
    run_commands.compare,
    run_commands.run,
):
    app.command(cls=_Command)(ended_plainly(_command))
