"""Commands on machines and their files: robots, init, check."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from expdesign.cli.options import INIT_OPTIONS, with_options
from expdesign.cli.output import JsonOption, RunArgument


def robots(as_json: JsonOption = False) -> None:
    """List the robots that ship, with geometry, limits and source.

    `robot:` in a run file takes any of the names, or the path of a robot file.
    """
    from expdesign.cli import robots as listing

    listing.list_robots(as_json=as_json)


@with_options(INIT_OPTIONS)
def init(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Of the machine.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="The folder; the current one by default."),
    ] = None,
    sources: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="A file of another program that describes the machine, such as LinuxCNC's INI and "
            "HAL; several times for several. Options override what it says.",
        ),
    ] = None,
    as_json: JsonOption = False,
    **options: str | None,
) -> None:
    """Write a robot file and a run file for a machine of your own, NAME.yaml and NAME-run.yaml.

    Both have comments and pass `expdesign check`. On a terminal the command asks for values that no
    option gives. Unknown values get a documented default and a comment that asks you to check it.
    Existing files are never overwritten.
    """
    from expdesign.cli import init_files

    init_files.init(name, out, sources, options, as_json=as_json)


MachineOption = Annotated[
    bool,
    typer.Option(
        "--machine",
        help="Print the machine at home in place of the configuration, with the reach of every "
        "coordinate, and draw it.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Of --machine: the run folder, whose figures/ get the drawing; runs/NAME by default.",
    ),
]


def check(
    run: RunArgument,
    machine: MachineOption = False,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Validate a run and print its complete configuration, with every default, in SI units.

    Only the limits at home are computed. Warnings, missing and default limits, the stages that
    `expdesign run` would do, and the pairs of struts that share a joint and have no clearance limit
    go to standard error.

    With --machine it also computes the machine at home: lengths, forces and angles of the struts,
    the condition, the reach of every coordinate with the limit that stops it, and the parameters
    that motions within the limits can identify. A drawing goes to figures/machine.png and
    machine.svg of the run folder.
    """
    from expdesign.cli import checks

    checks.check(run, out, machine=machine, as_json=as_json)
