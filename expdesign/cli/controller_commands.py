"""Commands on the motion and the model for a controller: export, certify, model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from expdesign.cli.options import EXPORT_OPTIONS, with_options
from expdesign.cli.output import JsonOption


@with_options(EXPORT_OPTIONS)
def export(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="DIR", help="A run folder with run.yaml and design.json.", show_default=False
        ),
    ] = None,
    name: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help="Format; `list` names them. Without: every table that the run names.",
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write; in DIR/exports by default."),
    ] = None,
    as_json: JsonOption = False,
    **options: str | None,
) -> None:
    """Write the designed motion, with lead-in and lead-out, as tables for a controller.

    Without --format these are the tables of the run's `export:`. With it, other options that are
    not given are those of the run's `export:` for this format, then the format's own. Every file
    is read back, executed as by its controller, and compared with design and limits; a file that
    fails is not kept (exit status 1).
    """
    from expdesign.cli import exports

    exports.export(folder, name, out, options, as_json=as_json)


def certify(
    place: Annotated[
        Path,
        typer.Argument(
            metavar="PLACE",
            help="A run folder with run.yaml and design.json, or a controller table.",
            show_default=False,
        ),
    ],
    design: Annotated[
        Path | None,
        typer.Option(
            "--design",
            metavar="DIR",
            help="For a table: the run folder that it was exported from; by default the one whose "
            "exports/ contains it. A copy without exports.json is identified by its SHA-256.",
        ),
    ] = None,
    piece: Annotated[
        bool,
        typer.Option(
            "--part",
            help="The table is a piece of a motion: it may begin and end anywhere.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Prove that a design, its lead-in and lead-out and its tables keep every limit at all times.

    For each limit it states the proved bound of the excess, the number of time cells of the proof,
    and the time that stayed open. A controller table is certified as it is read, on the path that
    its controller makes of the rows, from rest at home to rest at home. The verdict is "proved",
    "proved in part" or "broken"; exit status 1 unless everything is proved.
    """
    from expdesign.cli import exports

    exports.certify(place, design, piece=piece, as_json=as_json)


def model(
    source: Annotated[
        str,
        typer.Argument(
            metavar="DIR",
            help="A run folder with an estimate; or a robot file, or the name of a robot that "
            "ships, whose nominal parameters are then taken.",
            show_default=False,
        ),
    ],
    name: Annotated[
        str,
        typer.Option(
            "--format", metavar="NAME", help="c, python, fmu or simulink; has to be given."
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="The folder; DIR/model/NAME by default."),
    ] = None,
    width: Annotated[
        str,
        typer.Option(
            "--smoothing",
            metavar="SPEED",
            help="Width of the sign of dry friction, such as '2 mm/s': tanh in place of the sign. "
            "0: the exact one.",
        ),
    ] = "0",
    as_json: JsonOption = False,
) -> None:
    """Write inverse dynamics and kinematics of the identified robot for a controller.

    C99 source, a Python module, an FMU or an S-function for Simulink, each with states for a test;
    model.json states the origin of the numbers and the uncertainty of the forces along the design.
    With a C compiler here, the code is built, tested and timed before it is written.
    """
    from expdesign.cli import exports

    exports.model(source, name, out, width, as_json=as_json)
