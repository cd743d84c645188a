"""Commands on runs: each stage with its options, `run` for all stages, reports, comparisons."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from expdesign.cli.options import JsonOption, RunArgument, argument, flag_option, option

_MOST_EXPERIMENTS = 100_000
_MOST_REPETITIONS = 400_000

OutOption = Annotated[
    Path | None,
    option("--out", "DIR", "The run folder; runs/NAME by default, NAME being that of the run."),
]
DesignOption = Annotated[
    Path | None,
    option(
        "--design",
        "DIR",
        "A folder with the design.json to execute, or that file; the run folder by default.",
    ),
]
DesignsOption = Annotated[
    list[Path] | None,
    option(
        "--design",
        "DIR",
        "The folder with the design.json that was executed, or that file; one for all recordings "
        "or one each. The run folder's by default, if it has one.",
    ),
]
ResumeOption = Annotated[
    bool, flag_option("--resume", "Continue an interrupted search: what had ended is kept.")
]
EffortOption = Annotated[
    Literal["quick", "normal", "thorough"] | None,
    option(
        "--effort",
        "quick|normal|thorough",
        "Size of the search, instead of design.effort, starts and hops of the run file.",
    ),
]
SeedOption = Annotated[
    int | None,
    option("--seed", "S", "Seed of the search, instead of design.seed.", min=0, max=2**63 - 1),
]
ForceOption = Annotated[
    bool, flag_option("--force", "Estimate although channels contradict the section `data`.")
]
StrictOption = Annotated[bool, flag_option("--strict", "Exit status 1 for a doubtful verdict.")]


def design(
    run: RunArgument,
    effort: EffortOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
    as_json: JsonOption = False,
) -> None:
    """Design the optimal excitation trajectory.

    Writes the resolved configuration, design.json, trajectory.csv, tables and figures. Ctrl-C
    ends the search and keeps the best so far, marked.
    """
    _execute("design", run, out, as_json, resume=resume, effort=effort, seed=seed)


def plan(
    run: RunArgument,
    want: Annotated[
        list[str] | None,
        option(
            "--want",
            "NAME=VALUE",
            "A wanted standard deviation: mass=1% (with the sliders), platform_mass=1% (without), "
            "centre=5mm, p10=0.1kg; give it several times. "
            "It replaces that of `goals` in the run file.",
        ),
    ] = None,
    design: DesignOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Plan the measuring time for wanted precisions.

    Prints the periods and minutes that reach each goal, and for goals that 30 days do not reach the
    limiting tolerance with its sufficient size. Makes the design first if there is none.
    Writes plan.json, tables and a figure. Exit status 1 if a goal is not reachable.
    """
    sources = {"designs": _given(design)}
    _execute("goals", run, out, as_json, sources=sources, wanted=want or (), command="plan")


def next_motion(
    folders: Annotated[
        list[Path],
        argument("DIR …", "Run folders with estimates, each from recordings of its own."),
    ],
    effort: EffortOption = None,
    seed: SeedOption = None,
    design: Annotated[
        Path | None,
        option(
            "--design",
            "DIR",
            "The folder with the design.json of the last motion; by default that of its estimate.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        option("--out", "DIR", "The new run folder; by default runs/NAME-next of the last run."),
    ] = None,
    resume: ResumeOption = False,
    as_json: JsonOption = False,
) -> None:
    """Design the motion that adds most to what run folders have measured.

    The run is that of the last folder with `design.prior` set to all of them, in a new folder for
    the same commands. Prints the standard deviations so far, with the last motion repeated for the
    same time, and with the next motion. Writes next.json and a table as well.
    """
    from expdesign.cli.runs import design_next

    design_next(folders, out, as_json, design=design, resume=resume, effort=effort, seed=seed)


def simulate(
    run: RunArgument,
    design: DesignOption = None,
    table: Annotated[
        Path | None,
        option(
            "--table",
            "FILE",
            "A table that `expdesign export` made of the design: its rows are executed instead.",
        ),
    ] = None,
    out: OutOption = None,
    repetitions: Annotated[
        int,
        option(
            "--repetitions",
            "K",
            "How often the experiment is repeated; more than one go to repetitions/0001 …",
            min=1,
            max=_MOST_EXPERIMENTS,
        ),
    ] = 1,
    as_json: JsonOption = False,
) -> None:
    """Measure a designed trajectory, or a controller table of it, on the digital twin.

    Writes measurement.csv (repetitions/0001/measurement.csv … when there are several) and
    truth.json. Noise and disturbances are those of the run file; the same seed gives the same
    files. Ctrl-C keeps the repetitions that are complete.
    """
    sources = {"designs": _given(design), "table": table, "repetitions": repetitions}
    _execute("experiment", run, out, as_json, sources=sources, command="simulate")


def montecarlo(
    run: RunArgument,
    design: DesignOption = None,
    out: OutOption = None,
    repetitions: Annotated[
        int | None,
        option(
            "--repetitions",
            "K",
            "How many repetitions, instead of montecarlo.repetitions.",
            min=1,
            max=_MOST_REPETITIONS,
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Judge the estimators on many simulated experiments.

    Simulates and estimates K times and writes montecarlo.json, tables and figures: bias, spread,
    RMSE and coverage of every parameter against the truth and the Cramér–Rao bound. Ctrl-C keeps
    the repetitions that are done; the same command continues the study.
    """
    sources = {"designs": _given(design)}
    _execute("montecarlo", run, out, as_json, sources=sources, repetitions=repetitions)


def noise(
    run: RunArgument,
    data: Annotated[
        Path | None,
        option(
            "--data",
            "FILE",
            "A recording at rest, or of two periods or more of any motion that repeats; data.file, "
            "or the run folder's measurement.csv, by default.",
        ),
    ] = None,
    design: DesignsOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Analyse the noise of measured forces and lengths, without any model.

    Prints standard deviations and correlations, the test of every assumption, and the lines for
    the robot file. Writes these lines (noise.yaml), noise.json, tables/force_spectrum.csv and
    length_spectrum.csv (`noise: {force_spectrum: FILE}`), tables/noise_covariance.csv, and figures
    of distribution, quantiles, covariance and spectrum.
    """
    sources = {"data": _given(data), "designs": tuple(design or ())}
    _execute("noise", run, out, as_json, sources=sources)


def estimate(
    run: RunArgument,
    data: Annotated[
        list[Path] | None,
        option(
            "--data",
            "FILE",
            "A recording; give it several times to combine recordings. data.file, or the run "
            "folder's measurement.csv, by default.",
        ),
    ] = None,
    design: DesignsOption = None,
    out: OutOption = None,
    strict: StrictOption = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate the parameters from measured data.

    Channels that certainly contradict the section `data` are refused, with the section that is
    right.

    Prints the verdict of the diagnostics with advice, and every estimator's values with their
    standard deviations. Writes estimates.csv (values, standard deviations,
    95 % intervals), estimate.json (covariances, tests, verdict), identified-robot.yaml (the
    identified robot, for further runs), tables/ (precision, residuals; with tolerances budget.csv,
    the uncertainty from each of them) and figures/.
    """
    sources = {"data": tuple(data or ()), "designs": tuple(design or ()), "force": force}
    _execute("estimate", run, out, as_json, sources=sources, strict=strict)


def validate(
    run: RunArgument,
    estimate: Annotated[
        Path | None,
        option(
            "--estimate",
            "DIR",
            "The folder with the estimate.json to predict with; the run folder by default.",
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
    _execute("validate", run, out, as_json, sources={"estimate": estimate}, strict=strict)


def report(
    folder: Annotated[Path, argument("DIR", "A run folder.")], as_json: JsonOption = False
) -> None:
    """Write the report of a run folder: report.html, one page that works offline.

    It shows every stage that the folder holds. Its main tables are also written as LaTeX into
    tables/.
    """
    from expdesign.cli.runs import write_report

    write_report(folder, as_json)


def run(
    run: RunArgument,
    effort: EffortOption = None,
    seed: SeedOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
    as_json: JsonOption = False,
) -> None:
    """Do every stage that the run file names, in their order; finished stages are kept."""
    from expdesign.cli.runs import run_all

    run_all(run, out, as_json, resume=resume, effort=effort, seed=seed)


def compare(
    folders: Annotated[list[Path], argument("DIR DIR …", "Run folders.")],
    out: Annotated[Path, option("--out", "DIR", "Folder of the comparison.", show_default=False)],
    precision: Annotated[
        str,
        option(
            "--precision", "P", "Relative standard deviation for which the periods are counted."
        ),
    ] = "5 %",
    quick: Annotated[
        bool,
        flag_option("--quick", "Leave out the costs of limits, which take one solve per design."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare run folders and write report.html, tables and figures into a folder.

    Designs: criteria in common scalings, precision, limits, effort. Estimates: parameters with
    intervals, and whether they differ. Monte-Carlo studies: achieved standard deviations.
    """
    from expdesign.cli.runs import compare_folders

    compare_folders(folders, out, precision, quick=quick, as_json=as_json)


def _execute(stage: str, run: str, out: Path | None, as_json: bool, **options: Any) -> None:
    """Execute one stage of a run; options replace the inputs that the folder holds."""
    from expdesign.cli.runs import execute_stage

    execute_stage(stage, run, out, as_json, **options)


def _given(path: Path | None) -> tuple[Path, ...]:
    return () if path is None else (path,)
