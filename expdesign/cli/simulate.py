"""`expdesign simulate`: a measured experiment on the digital twin, in a run folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import JsonOption, RunArgument, results, short, warn, warn_all, write_json

if TYPE_CHECKING:
    from estimation.twin import Truth
    from expdesign.configuration import RunConfiguration
    from expdesign.export import TableFile
    from expdesign.trajectory import TrajectoryFile

STAGE = "experiment"

_MOST_REPETITIONS = 100_000

DesignOption = Annotated[
    Path | None,
    typer.Option(
        "--design",
        metavar="DIR",
        help="A folder with the design.json to execute, or that file; the run folder by default.",
    ),
]
TableOption = Annotated[
    Path | None,
    typer.Option(
        "--table",
        metavar="FILE",
        help="A table that `expdesign export` made of the design: its rows are executed instead.",
    ),
]
RepetitionsOption = Annotated[
    int,
    typer.Option(
        "--repetitions",
        metavar="K",
        min=1,
        max=_MOST_REPETITIONS,
        help="How often the experiment is repeated; more than one go to repetitions/0001 …",
    ),
]


def simulate(
    run: RunArgument,
    design: DesignOption = None,
    table: TableOption = None,
    out: OutOption = None,
    repetitions: RepetitionsOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Measure a designed trajectory, or a controller table of it, on the digital twin.

    Writes measurement.csv (repetitions/0001/measurement.csv … when there are several) and
    truth.json. Noise and disturbances are those of the run file; the same seed gives the same
    files. Ctrl-C keeps the repetitions that are complete.
    """
    from expdesign.configuration import load_run

    configuration = load_run(run)
    warn_all(configuration.warnings)
    folder = run_folder(configuration, out)
    summary = experiment_stage(
        configuration,
        folder,
        design=design,
        table=table,
        repetitions=repetitions,
        as_json=as_json,
    )
    if as_json:
        write_json({"status": 0, **summary})


def experiment_stage(
    configuration: RunConfiguration,
    folder: Path,
    *,
    design: Path | None = None,
    table: Path | None = None,
    repetitions: int = 1,
    as_json: bool,
) -> dict[str, Any]:
    """Simulate, write the run folder, say what came out and return it for machines.

    Raises
    ------
    InputError
        The design is missing or none, the table is none of it, or the run cannot be simulated.
    CommandFailed
        Interrupted.
    """
    from estimation.twin import Twin
    from estimation.twin.output import (
        MEASUREMENT_FILE,
        repetition_file,
        write_measurement,
        write_truth,
    )
    from expdesign.cli.counting import counted
    from expdesign.cli.stages import clear_outdated, record_stage

    found = design_to_execute(folder, design)
    refuse_unwritable(folder)
    doubts = design_doubts(configuration, found)
    warn_all(doubts)
    began = time.perf_counter()
    executed = None if table is None else _table(configuration, found, table.absolute())
    made_from = trajectory_text(found)
    if executed is not None:
        made_from += f" executed from {executed.path.name} {executed.digest}"
    with record_stage(STAGE, configuration, folder, made_from) as stage:
        twin = Twin.of(configuration, found.trajectory if executed is None else executed)
        if executed is not None and executed.changed:
            # Not before: the twin refuses what does not hold the design.
            changed = (
                f"{executed.path.name} was changed after it was exported: what is executed was "
                "not checked, and its record is taken to hold for its axes and its window"
            )
            warn(changed)
            doubts.append(changed)
        written = clear_outdated(STAGE, configuration, folder, made_from)
        done = 0
        try:
            written |= set(write_truth(twin.truth, configuration, folder, repeated=repetitions > 1))
            for number in counted(range(1, repetitions + 1), "repetitions"):
                name = repetition_file(number) if repetitions > 1 else MEASUREMENT_FILE
                write_measurement(twin.measurement(number), folder / name)
                written.add(folder / name)
                done = number
        except KeyboardInterrupt:
            stage.status = "interrupted"
            stage.message = f"interrupted after {done} of {repetitions} measurements"
        else:
            stage.status = "done"
        stage.files = sorted(written)
    summary = _summary(twin.truth, folder, done, time.perf_counter() - began)
    summary["warnings"] = [*configuration.warnings, *doubts]
    if stage.status != "done":
        raise CommandFailed(f"{stage.message}; they are in {short(folder)}", summary)
    if not as_json:
        _show(twin.truth, folder, repetitions)
    return summary


def _table(configuration: RunConfiguration, found: TrajectoryFile, path: Path) -> TableFile:
    from expdesign.export import find_table_file
    from expdesign.robot import robot_from

    return find_table_file(path, robot_from(configuration.robot), found.trajectory)


def trajectory_text(found: TrajectoryFile) -> str:
    """Return the coefficients of a design with all digits: what the experiment is made from."""
    return " ".join(value.hex() for value in found.trajectory.vector().tolist())


def folder_design(folder: Path) -> str:
    """Return what the experiment of a run folder is made from: the coefficients of its design."""
    return trajectory_text(design_to_execute(folder, None))


def design_to_execute(folder: Path, design: Path | None) -> TrajectoryFile:
    """Read the design that was asked for, or the run folder's own.

    Raises
    ------
    InputError
        There is none.
    """
    from expdesign.configuration import InputError, Problem
    from expdesign.trajectory import TrajectoryFile

    if design is not None:
        return TrajectoryFile.read(design.absolute())
    if not (folder / "design.json").exists():
        raise InputError(
            Problem(
                "there is no design to execute: the run folder has no design.json",
                file=folder,
                key="--design",
                allowed="a folder that `expdesign design` wrote, or `design:` in the run file "
                "for `expdesign run`",
            )
        )
    return TrajectoryFile.read(folder)


def design_doubts(configuration: RunConfiguration, found: TrajectoryFile) -> list[str]:
    """Return what is odd about executing a design in this run."""
    doubts = []
    if found.robot is not None and found.robot != configuration.robot.name:
        doubts.append(
            f"the design was made for the robot {found.robot}, and {configuration.robot.name} "
            "executes it"
        )
    if found.status in {"interrupted", "limits broken"}:
        doubts.append(f"the status of the design is '{found.status}'")
    return doubts


def _summary(truth: Truth, folder: Path, done: int, seconds: float) -> dict[str, Any]:
    return {
        "folder": str(folder),
        "repetitions": done,
        "periods": truth.experiment.periods,
        "samples": truth.samples,
        "samples_per_period": truth.samples_per_period,
        "table": None if truth.table is None else truth.table.file,
        "seconds": seconds,
    }


def _show(truth: Truth, folder: Path, repetitions: int) -> None:
    section = truth.experiment
    times = "" if repetitions == 1 else f", {repetitions} times"
    console = results()
    console.print(
        f"{truth.name}: {section.periods} periods of {truth.design.period:.4f} s measured at "
        f"{section.sampling:g} Hz{times}: {truth.samples} samples, "
        f"{truth.samples_per_period:.6g} per period."
    )
    if truth.table is not None:
        console.print(
            f"executed: {truth.table.file} ({truth.table.format}), measured from "
            f"{truth.table.window[0]:.4f} s after its start; struts within "
            f"{1e6 * truth.table.position_error:.2g} µm of the design"
        )
    disturbances = {
        "tracking error": section.tracking_error,
        "drift": section.drift,
        "cogging": section.cogging,
        "quantisation": section.quantisation,
        "outliers": section.outliers,
    }
    named = [name for name, value in disturbances.items() if value]
    console.print(f"noise with full covariances; disturbances: {', '.join(named) or 'none'}")
    console.print(f"written to {short(folder)}")
