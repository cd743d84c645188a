"""`expdesign estimate`: parameters with error bars from measured data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import JsonOption, RunArgument, results, short, warn_all, write_json

if TYPE_CHECKING:
    from estimation.diagnostics import Diagnosis
    from estimation.identification import EstimationResult
    from expdesign.configuration import RunConfiguration
    from expdesign.trajectory import FourierTrajectory

STAGE = "estimate"

DataOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--data",
        metavar="FILE",
        help="A recording; give it several times to combine recordings. data.file, or the run "
        "folder's measurement.csv, by default.",
    ),
]
DesignsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--design",
        metavar="DIR",
        help="The folder with the design.json that was executed, or that file; one for all "
        "recordings or one each. The run folder's by default, if it has one.",
    ),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Exit status 1 when a diagnostic fails.")
]


def estimate(
    run: RunArgument,
    data: DataOption = None,
    design: DesignsOption = None,
    out: OutOption = None,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate the parameters from measured data.

    Writes estimates.csv, estimate.json, tables and figures. What the diagnostics find is a verdict
    in the result, and a warning.
    """
    from expdesign.configuration import load_run

    configuration = load_run(run)
    warn_all(configuration.warnings)
    folder = run_folder(configuration, out)
    summary = estimate_stage(
        configuration, folder, data=data or (), designs=design or (), as_json=as_json
    )
    if strict and summary["verdict"] != "accepted":
        raise CommandFailed("a diagnostic failed, and --strict was asked for", summary)
    if as_json:
        write_json({"status": 0, **summary})


def estimate_stage(
    configuration: RunConfiguration,
    folder: Path,
    *,
    data: tuple[Path, ...] | list[Path] = (),
    designs: tuple[Path, ...] | list[Path] = (),
    as_json: bool,
) -> dict[str, Any]:
    """Estimate, write the run folder, say what came out and return it for machines.

    Raises
    ------
    InputError
        Run, data or design do not fit.
    CommandFailed
        The data have no motion, or do not determine the parameters.
    """
    from numpy.linalg import LinAlgError

    from estimation.data.reading import read_measurement
    from estimation.diagnostics import diagnose
    from estimation.estimators import UnidentifiableError
    from estimation.identification import estimate as compute
    from estimation.identification.output import write_estimate
    from estimation.kinematics.fourier_fit import MotionFitError
    from expdesign.cli.stages import record_stage
    from results import estimate_figures

    files = data_files(configuration, folder, data)
    trajectories = recorded_designs(folder, designs, len(files))
    refuse_unwritable(folder)
    with record_stage(STAGE, configuration, folder, made_from(files, designs, folder)) as stage:
        section = configuration.run.data
        recordings = [read_measurement(file, section, configuration.robot) for file in files]
        try:
            result = compute(configuration, recordings, trajectories)
        except (MotionFitError, UnidentifiableError) as error:
            raise CommandFailed(str(error)) from error
        except LinAlgError as error:
            raise CommandFailed(
                f"the data cannot be estimated from ({error}): is a channel constant?"
            ) from error
        diagnosis = None
        if result.intervals_cover:
            diagnosis = diagnose(result.robot, result.experiments, result.knowledge, result.best)
        found = None if diagnosis is None else diagnosis.as_dict()
        stage.files = write_estimate(result, folder, found)
        stage.files += estimate_figures(result, diagnosis, folder)
        stage.status = "done"
        stage.message = "; ".join(f"{k}: {e.status}" for k, e in result.estimates.items())
    warn_all(result.warnings[len(configuration.warnings) :])
    if not as_json:
        _show(result, diagnosis, folder)
    return _summary(result, diagnosis, folder)


def data_files(
    configuration: RunConfiguration, folder: Path, given: tuple[Path, ...] | list[Path]
) -> list[Path]:
    """Return the recordings: those given, the run's, or the run folder's.

    Raises
    ------
    InputError
        There is none.
    """
    from expdesign.configuration import InputError, Problem

    if given:
        return [path.absolute() for path in given]
    if configuration.run.data.file is not None:
        return [Path(configuration.run.data.file)]
    own = folder / "measurement.csv"
    if own.is_file():
        return [own]
    raise InputError(
        Problem(
            "there is nothing to estimate from: the run folder has no measurement.csv",
            file=folder,
            key="--data",
            allowed="a recording (--data FILE, or data.file in the run file), or a simulated one "
            "(`expdesign simulate`)",
        )
    )


def recorded_designs(
    folder: Path, given: tuple[Path, ...] | list[Path], recordings: int
) -> list[FourierTrajectory | None]:
    """Return the trajectory of each recording: those given, or the run folder's, or None."""
    from expdesign.configuration import InputError, Problem
    from expdesign.trajectory import TrajectoryFile

    if not given:
        own = folder / "design.json"
        found = [TrajectoryFile.read(own).trajectory] if own.is_file() else [None]
        return list(found) * recordings
    if len(given) not in (1, recordings):
        raise InputError(
            Problem(
                f"{recordings} recordings, but {len(given)} designs",
                key="--design",
                allowed="one design for all recordings, or one each",
            )
        )
    named: list[FourierTrajectory | None] = [
        TrajectoryFile.read(path.absolute()).trajectory for path in given
    ]
    return named * (recordings if len(named) == 1 else 1)


def made_from(files: list[Path], designs: tuple[Path, ...] | list[Path], folder: Path) -> str:
    """Return what an estimate is made from beside the configuration: its files' contents."""
    from expdesign.runfolder.manifest import file_hash

    own = folder / "design.json"
    sources = [path / "design.json" if path.is_dir() else path for path in designs]
    sources = sources or ([own] if own.is_file() else [])
    return " ".join(file_hash(path) for path in (*files, *sources) if path.is_file())


def folder_recording(folder: Path) -> str:
    """Return what the estimate of a run folder is made from."""
    recording = folder / "measurement.csv"
    return made_from([recording], (), folder)


def _summary(result: EstimationResult, diagnosis: Diagnosis | None, folder: Path) -> dict[str, Any]:
    judged = None if diagnosis is None else diagnosis.verdict
    return {
        "folder": str(folder),
        "best": result.best.estimator,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit}
            for row in result.rows
            if row.estimator == result.best.estimator
        },
        "not_identified": [
            row.parameter
            for row in result.rows
            if row.estimator == result.best.estimator and row.identified is False
        ],
        "verdict": "not judged" if judged is None else judged.status.value,
        "findings": [] if judged is None else [finding.sentence for finding in judged.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }


def _show(result: EstimationResult, diagnosis: Diagnosis | None, folder: Path) -> None:
    from rich.table import Table

    console = results()
    for record in result.records:
        data = record.experiment.record
        harmonics = "pointwise" if record.harmonics is None else f"{record.harmonics} harmonics"
        console.print(
            f"{_place(record.source)}: {data.rows} rows, {data.periods:.6g} periods of "
            f"{data.period:.6g} s (from the {data.source.value}), {harmonics}, "
            f"noise {record.experiment.noise.source}",
            soft_wrap=True,
        )
    table = Table(
        title="Estimates, in brackets the standard deviation of the last digits",
        title_justify="left",
    )
    table.add_column("parameter")
    for name in result.estimates:
        table.add_column(name.upper(), justify="right")
    table.add_column("a priori", justify="right")
    table.add_column("unit")
    by_place = {(row.estimator, row.parameter): row for row in result.rows}
    for parameter in result.knowledge.names:
        rows = [by_place[name, parameter] for name in result.estimates]
        table.add_row(
            parameter,
            *(_concise(row.value, row.std) for row in rows),
            f"{rows[0].a_priori:.5g}",
            rows[0].unit,
        )
    console.print(table)
    for combination in result.combinations[result.best.estimator]:
        console.print(combination.text, soft_wrap=True)
    if diagnosis is not None:
        console.print(diagnosis.verdict.summary, soft_wrap=True)
        for finding in diagnosis.verdict.failed:
            advice = f"; {finding.advice}" if finding.advice else ""
            console.print(f"- {finding.sentence}{advice}", soft_wrap=True)
    console.print(f"written to {short(folder)}")


def _place(source: str) -> str:
    return short(Path(source)) if source else "data"


def _concise(value: float, std: float) -> str:
    """Return 1.2345(67) for 1.2345 ± 0.0067."""
    from math import floor, isnan, log10

    if isnan(std):
        return f"{value:.5g} fixed"
    if not std > 0:
        return f"{value:.6g}"
    digits = 1 - floor(log10(std))
    if digits <= 0:
        return f"{value:.0f}({std:.0f})"
    return f"{value:.{digits}f}({std * 10**digits:.0f})"
