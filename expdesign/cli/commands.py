"""The commands that do a run: each stage with its options, and `run` for all that it names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from expdesign.cli.output import JsonOption, RunArgument, write_json

_MOST_EXPERIMENTS = 100_000
_MOST_REPETITIONS = 400_000

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="DIR",
        help="The run folder; runs/NAME by default, NAME being that of the run.",
    ),
]
DesignOption = Annotated[
    Path | None,
    typer.Option(
        "--design",
        metavar="DIR",
        help="A folder with the design.json to execute, or that file; the run folder by default.",
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


def design(run: RunArgument, out: OutOption = None, as_json: JsonOption = False) -> None:
    """Design the optimal excitation trajectory.

    Writes the resolved configuration, design.json, trajectory.csv, tables and figures. Ctrl-C
    ends the search and keeps the best so far, marked.
    """
    do_one("design", run, out, as_json)


def simulate(
    run: RunArgument,
    design: DesignOption = None,
    table: Annotated[
        Path | None,
        typer.Option(
            "--table",
            metavar="FILE",
            help="A table that `expdesign export` made of the design: its rows are executed "
            "instead.",
        ),
    ] = None,
    out: OutOption = None,
    repetitions: Annotated[
        int,
        typer.Option(
            "--repetitions",
            metavar="K",
            min=1,
            max=_MOST_EXPERIMENTS,
            help="How often the experiment is repeated; more than one go to repetitions/0001 …",
        ),
    ] = 1,
    as_json: JsonOption = False,
) -> None:
    """Measure a designed trajectory, or a controller table of it, on the digital twin.

    Writes measurement.csv (repetitions/0001/measurement.csv … when there are several) and
    truth.json. Noise and disturbances are those of the run file; the same seed gives the same
    files. Ctrl-C keeps the repetitions that are complete.
    """
    given = {"designs": _given(design), "table": table, "repetitions": repetitions}
    do_one("experiment", run, out, as_json, given)


def montecarlo(
    run: RunArgument,
    design: DesignOption = None,
    out: OutOption = None,
    repetitions: Annotated[
        int | None,
        typer.Option(
            "--repetitions",
            metavar="K",
            min=1,
            max=_MOST_REPETITIONS,
            help="How many repetitions, instead of montecarlo.repetitions.",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Judge the estimators on many simulated experiments.

    Simulates and estimates K times and writes montecarlo.json, tables and figures: bias, spread,
    RMSE and coverage of every parameter against the truth and the Cramér–Rao bound. Ctrl-C keeps
    the repetitions that are done; the same command goes on from there.
    """
    given = {"designs": _given(design)}
    do_one("montecarlo", run, out, as_json, given, repetitions=repetitions)


def noise(
    run: RunArgument,
    data: Annotated[
        Path | None,
        typer.Option(
            "--data",
            metavar="FILE",
            help="A recording at rest, or of two periods or more of any motion that repeats; "
            "data.file, or the run folder's measurement.csv, by default.",
        ),
    ] = None,
    design: DesignsOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Analyse the noise of measured forces and lengths, without any model.

    Prints standard deviations and correlations, what was found of every assumption, and the lines
    for the robot file. Writes these lines (noise.yaml), noise.json, tables/force_spectrum.csv and
    length_spectrum.csv (`noise: {force_spectrum: FILE}`), tables/noise_covariance.csv, and figures
    of distribution, quantiles, covariance and spectrum.
    """
    do_one("noise", run, out, as_json, {"data": _given(data), "designs": tuple(design or ())})


def estimate(
    run: RunArgument,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            "--data",
            metavar="FILE",
            help="A recording; give it several times to combine recordings. data.file, or the run "
            "folder's measurement.csv, by default.",
        ),
    ] = None,
    design: DesignsOption = None,
    out: OutOption = None,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate the parameters from measured data.

    Prints every estimator's values with their standard deviations, and the verdict: what the
    diagnostics found, and what to do about it. Writes estimates.csv (values, standard deviations,
    95 % intervals), estimate.json (covariances, tests, verdict), identified-robot.yaml (the robot
    that was found, for further runs), tables/ (precision, residuals; with tolerances budget.csv:
    which one costs which parameter how much) and figures/.
    """
    given = {"data": tuple(data or ()), "designs": tuple(design or ())}
    do_one("estimate", run, out, as_json, given, strict=strict)


def validate(
    run: RunArgument,
    estimate: Annotated[
        Path | None,
        typer.Option(
            "--estimate",
            metavar="DIR",
            help="The folder with the estimate.json to predict with; the run folder by default.",
        ),
    ] = None,
    out: OutOption = None,
    strict: StrictOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare measured with predicted forces on the motions that the run file names.

    Computed motions are measured on the digital twin, recorded ones read from their files. Writes
    validation.json, tables and figures.
    """
    do_one("validate", run, out, as_json, {"estimate": estimate}, strict=strict)


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A run folder.", show_default=False)
    ],
    as_json: JsonOption = False,
) -> None:
    """Write the report of a run folder: report.html, one page that needs nothing else.

    It shows every stage that the folder holds. Its main tables are also written as LaTeX into
    tables/.
    """
    from expdesign.cli import shown
    from expdesign.cli.terminal import working
    from expdesign.stages.folder import refuse_run_file, refuse_unwritable
    from expdesign.stages.report import written_report

    place = folder.absolute()
    if place.is_dir():
        refuse_unwritable(place)
    else:
        refuse_run_file(folder)
    with working("report"):
        outcome = written_report(place)
    if as_json:
        write_json({"status": 0, **outcome.summary})
    else:
        shown.report(outcome)


def run(run: RunArgument, out: OutOption = None, as_json: JsonOption = False) -> None:
    """Do every stage that the run file names, in their order; what is done already is kept."""
    from expdesign.cli.terminal import Terminal
    from expdesign.stages.run import run as do_run

    made = do_run(run, out, Terminal(quiet=as_json))
    if as_json:
        stages = made.stages
        write_json(
            {
                "status": 0,
                "folder": str(made.folder),
                "resumed": all(outcome.kept for outcome in stages.values()),
                "stages": {n: {"resumed": o.kept, **o.summary} for n, o in stages.items()},
            }
        )


def do_one(
    stage: str,
    run: str,
    out: Path | None,
    as_json: bool,
    sources: dict[str, Any] | None = None,
    *,
    strict: bool = False,
    repetitions: int | None = None,
) -> None:
    """Do one stage of a run, with what the options name in place of what the folder holds."""
    from expdesign.cli.terminal import Terminal
    from expdesign.configuration import load_run
    from expdesign.stages.folder import run_folder
    from expdesign.stages.outcome import StageFailed
    from expdesign.stages.run import do_stage
    from expdesign.stages.workspace import Sources, Workspace

    configuration = load_run(run)
    terminal = Terminal(quiet=as_json)
    before = configuration.warnings_before(stage)
    if repetitions is not None:
        configuration = configuration.with_section("montecarlo", repetitions=repetitions)
    folder = run_folder(configuration, out)
    work = Workspace(configuration, folder, terminal, Sources(**(sources or {})))
    work.warn(before)
    outcome = do_stage(stage, work)
    if strict and outcome.doubt:
        raise StageFailed(f"{outcome.doubt}, and --strict was asked for", outcome.summary)
    if as_json:
        write_json({"status": 0, **outcome.summary})


def _given(path: Path | None) -> tuple[Path, ...]:
    return () if path is None else (path,)
