"""Commands on a machine and its controller: robots, init, check, export, certify, model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from expdesign.cli.options import (
    EXPORT_OPTIONS,
    INIT_OPTIONS,
    JsonOption,
    RunArgument,
    argument,
    flag_option,
    option,
    with_options,
)


def robots(as_json: JsonOption = False) -> None:
    """List the robots that ship, with geometry, limits and source.

    `robot:` in a run file takes any of the names, or the path of a robot file.
    """
    from expdesign.cli.check import list_robots

    list_robots(as_json=as_json)


@with_options(INIT_OPTIONS)
def init(
    name: Annotated[str, argument("NAME", "Of the machine.")],
    out: Annotated[
        Path | None, option("--out", "DIR", "The folder; the current one by default.")
    ] = None,
    sources: Annotated[
        list[Path] | None,
        option(
            "--from",
            "FILE",
            "A file of another program that describes the machine, such as LinuxCNC's INI and HAL; "
            "several times for several. Options override it.",
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
    from expdesign.cli.init import write_machine

    write_machine(name, out, sources, options, as_json=as_json)


def init_data(
    file: Annotated[Path, argument("FILE", "A recording, or the folder of a rosbag2 recording.")],
    forces: Annotated[
        Path | None, argument("[FORCES]", "The forces, if they are in a file of their own.")
    ] = None,
    run: Annotated[
        str | None,
        option("--run", "RUN.yaml", "The run: its robot decides on units and zeros not stated."),
    ] = None,
    out: Annotated[
        Path | None, option("--out", "FILE", "A new file for the section, instead of printing it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Guess the section `data` of a run file from a recording, and print it.

    Delimiter, decimal mark, columns of time, lengths and forces with their units, and the form of
    the time. Comments name what the file does not determine.
    """
    from expdesign.cli.init import write_data_section

    write_data_section(file, forces, run, out, as_json=as_json)


MachineOption = Annotated[
    bool,
    flag_option(
        "--machine",
        "Print the machine at home instead of the configuration, with the reach of every "
        "coordinate, and draw it.",
    ),
]
DataOption = Annotated[
    Path | None, option("--data", "FILE", "A recording whose channels are checked.")
]
DesignOption = Annotated[
    Path | None,
    option(
        "--design",
        "DIR",
        "Of --data: the folder with the design.json that was executed, or that file; the run "
        "folder's by default, if it has one.",
    ),
]
OutOption = Annotated[
    Path | None,
    option(
        "--out",
        "DIR",
        "Of --machine: the run folder, whose figures/ get the drawing; runs/NAME by default.",
    ),
]


def check(
    run: RunArgument,
    machine: MachineOption = False,
    data: DataOption = None,
    design: DesignOption = None,
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

    With --data it checks the channels of a recording, order, sign, scale, zero and delay, and
    prints the section `data` that is right instead of the configuration.
    """
    from expdesign.cli.check import check_run, show_channels

    if data is not None:
        show_channels(run, data, design, as_json=as_json)
    else:
        check_run(run, out, machine=machine, as_json=as_json)


@with_options(EXPORT_OPTIONS)
def export(
    folder: Annotated[
        Path | None, argument("DIR", "A run folder with run.yaml and design.json.")
    ] = None,
    name: Annotated[
        str,
        option(
            "--format",
            "NAME",
            "Format; `list` names them. Without: every table that the run names.",
        ),
    ] = "",
    out: Annotated[
        Path | None, option("--out", "FILE", "File to write; in DIR/exports by default.")
    ] = None,
    as_json: JsonOption = False,
    **options: str | None,
) -> None:
    """Write the designed motion, with lead-in and lead-out, as tables for a controller.

    Without --format these are the tables of the run's `export:`. With it, other options that are
    not given are those of the run's `export:` for this format, then the format's own. Every file
    is read back, executed as its controller does, and compared with design and limits; a file that
    fails is not kept (exit status 1).
    """
    from expdesign.cli.exports import export_motion

    export_motion(folder, name, out, options, as_json=as_json)


def certify(
    place: Annotated[
        Path,
        argument("PLACE", "A run folder with run.yaml and design.json, or a controller table."),
    ],
    design: Annotated[
        Path | None,
        option(
            "--design",
            "DIR",
            "For a table: the run folder that it was exported from; by default the one whose "
            "exports/ contains it. A copy without exports.json is identified by its SHA-256.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        option(
            "--robot",
            "ROBOT",
            "Another robot that executes the motion: its file or name, such as an estimate's "
            "identified-robot.yaml. Its struts follow the lengths that the controller computes "
            "with the robot of the run. Its stated limits hold, without a reserve; of the run "
            "those that it does not state.",
        ),
    ] = None,
    piece: Annotated[
        bool,
        flag_option("--part", "The table is a piece of a motion: it may begin and end anywhere."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Prove that a design, its lead-in and lead-out and its tables keep every limit at all times.

    For each limit it states the proved bound of the excess, the number of time cells of the proof,
    and the time that stayed open. A controller table is certified as it is read, on the path that
    its controller makes of the rows, from rest at home to rest at home. The verdict is "proved",
    "proved in part" or "broken"; exit status 1 unless everything is proved.
    """
    from expdesign.cli.certify import certify_motions

    certify_motions(place, design, robot, piece=piece, as_json=as_json)


def model(
    source: Annotated[
        str,
        argument(
            "DIR",
            "A run folder with an estimate; or a robot file, or the name of a robot that ships, "
            "whose nominal parameters are then taken.",
        ),
    ],
    name: Annotated[
        str, option("--format", "NAME", "c, python, fmu or simulink; has to be given.")
    ] = "",
    out: Annotated[
        Path | None, option("--out", "DIR", "The folder; DIR/model/NAME by default.")
    ] = None,
    width: Annotated[
        str,
        option(
            "--smoothing",
            "SPEED",
            "Width of the sign of dry friction, such as '2 mm/s': tanh instead of the sign. 0: the "
            "exact one.",
        ),
    ] = "0",
    as_json: JsonOption = False,
) -> None:
    """Write inverse dynamics and kinematics of the identified robot for a controller.

    C99 source, a Python module, an FMU or an S-function for Simulink, each with states for a test;
    model.json states the origin of the numbers and the uncertainty of the forces along the design.
    With a C compiler here, the code is built, tested and timed before it is written.
    """
    from expdesign.cli.model import write_model

    write_model(source, name, out, width, as_json=as_json)
