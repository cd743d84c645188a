"""`expdesign montecarlo`: bias, spread and coverage of the estimators, in a run folder."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.errors import CommandFailed
from expdesign.cli.folder import OutOption, refuse_unwritable, run_folder
from expdesign.cli.output import (
    JsonOption,
    RunArgument,
    messages,
    results,
    short,
    warn,
    warn_all,
    write_json,
)
from expdesign.cli.simulate import DesignOption, design_doubts, design_to_execute, trajectory_text

if TYPE_CHECKING:
    from estimation.montecarlo import Study, StudyMonitor
    from expdesign.configuration import RunConfiguration
    from expdesign.trajectory import FourierTrajectory

STAGE = "montecarlo"

_MOST_REASONS = 3

RepetitionsOption = Annotated[
    int | None,
    typer.Option(
        "--repetitions",
        metavar="K",
        min=1,
        max=10_000_000,
        help="How many repetitions, instead of montecarlo.repetitions.",
        show_default=False,
    ),
]


def montecarlo(
    run: RunArgument,
    design: DesignOption = None,
    out: OutOption = None,
    repetitions: RepetitionsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Judge the estimators on many simulated experiments.

    Simulates and estimates K times and writes montecarlo.json, tables and figures: bias, spread,
    RMSE and coverage of every parameter against the truth and the Cramér–Rao bound. Ctrl-C keeps
    the repetitions that are done; the same command goes on from there.
    """
    from expdesign.configuration import load_run

    configuration = load_run(run)
    warn_all(configuration.warnings)
    if repetitions is not None:
        configuration = _with_repetitions(configuration, repetitions)
    folder = run_folder(configuration, out)
    summary = montecarlo_stage(configuration, folder, design=design, as_json=as_json)
    if as_json:
        write_json({"status": 0, **summary})


def montecarlo_stage(
    configuration: RunConfiguration, folder: Path, *, design: Path | None = None, as_json: bool
) -> dict[str, Any]:
    """Do the study, write the run folder, say what came out and return it for machines.

    Raises
    ------
    InputError
        The design is missing or none, or the run cannot be simulated or estimated.
    CommandFailed
        Interrupted, workers died, or nothing could be estimated.
    """
    from estimation.montecarlo.output import write_study
    from expdesign.cli.counting import StudyDisplay
    from expdesign.cli.stages import record_stage
    from results import study_figures

    found = design_to_execute(folder, design)
    refuse_unwritable(folder)
    doubts = design_doubts(configuration, found)
    warn_all(doubts)
    warnings = [*configuration.warnings, *doubts]
    began = time.perf_counter()
    display = StudyDisplay(messages(), "repetitions")
    with record_stage(STAGE, configuration, folder, trajectory_text(found)) as stage:
        with display.shown():
            study = _computed(configuration, found.trajectory, folder, display)
        if not study.repetitions:
            raise CommandFailed("interrupted before the first repetition was done")
        if not any(study.estimated(name) for name in study.estimators):
            raise CommandFailed(f"no repetition could be estimated: {_reasons(study)}")
        stage.files = [
            *write_study(study, folder),
            *study_figures(folder, configuration.run.report.figures),
        ]
        stage.status = "interrupted" if study.interrupted else "done"
        count = f"{len(study.repetitions)} of {study.wanted} repetitions"
        stage.message = f"interrupted after {count}" if study.interrupted else count
    found_odd = _doubts(study)
    for warning in found_odd:
        warn(warning)
    summary = _summary(study, folder, time.perf_counter() - began, [*warnings, *found_odd])
    if study.interrupted:
        raise CommandFailed(
            f"{stage.message}; what they show is in {short(folder)}, and the same command goes on "
            "from there",
            summary,
        )
    if not as_json:
        _show(study, folder)
    return summary


def _computed(
    configuration: RunConfiguration,
    design: FourierTrajectory,
    folder: Path,
    monitor: StudyMonitor,
) -> Study:
    from estimation.estimators import UnidentifiableError
    from estimation.montecarlo import run_study
    from estimation.montecarlo.journal import NAME
    from expdesign.workers import ClusterError, WorkerDiedError

    try:
        return run_study(configuration, design, folder / NAME, monitor)
    except UnidentifiableError as error:
        raise CommandFailed(str(error), {"undetermined": list(error.names)}) from error
    except (WorkerDiedError, ClusterError) as error:
        raise CommandFailed(str(error)) from error


def _with_repetitions(configuration: RunConfiguration, repetitions: int) -> RunConfiguration:
    run = configuration.run
    section = run.montecarlo.model_copy(update={"repetitions": repetitions})
    return replace(configuration, run=run.model_copy(update={"montecarlo": section}))


def _doubts(study: Study) -> list[str]:
    doubts = []
    for name in study.estimators:
        failed = len(study.failures(name))
        if failed:
            doubts.append(
                f"{name} failed in {failed} of {len(study.repetitions)} repetitions, which its "
                f"numbers leave out: {_reasons(study, name)}"
            )
        stuck = sum(not outcome.converged for _, outcome in study.estimated(name))
        if stuck:
            doubts.append(f"{name} did not converge in {stuck} repetitions, which are counted")
    return doubts


def _reasons(study: Study, *estimators: str) -> str:
    names = estimators or study.estimators
    reasons = dict.fromkeys(reason for name in names for _, reason in study.failures(name))
    shown = list(reasons)[:_MOST_REASONS]
    return "; ".join(shown) + ("; …" if len(reasons) > len(shown) else "")


def _summary(study: Study, folder: Path, seconds: float, warnings: list[str]) -> dict[str, Any]:
    from dataclasses import asdict

    pooled = {name: study.pooled(name) for name in study.estimators}
    return {
        "folder": str(folder),
        "repetitions": len(study.repetitions),
        "estimators": {
            name: {
                "estimates": len(study.estimated(name)),
                "failures": len(study.failures(name)),
                "pooled": None if found is None else asdict(found),
            }
            for name, found in pooled.items()
        },
        "seconds": seconds,
        "warnings": warnings,
    }


def _show(study: Study, folder: Path) -> None:
    from rich.table import Table

    console = results()
    identified, free = len(study.identified), len(study.free)
    console.print(
        f"{study.configuration.name}: {len(study.repetitions)} repetitions of "
        f"{study.truth.experiment.periods} periods at {study.truth.experiment.sampling:g} Hz; "
        f"{identified} of {free} parameters are identified"
    )
    table = Table(
        title="In brackets 95 % intervals; bias in its standard errors", title_justify="left"
    )
    table.add_column("estimator")
    for head in ("estimates", "RMSE / bound", "coverage (%)", "largest bias"):
        table.add_column(head, justify="right")
    for name in study.estimators:
        pooled = study.pooled(name)
        cells = ["", "", ""]
        if pooled is not None:
            cells = [
                f"{pooled.rmse_over_bound:.3g} [{pooled.rmse_over_bound_low:.3g}, "
                f"{pooled.rmse_over_bound_high:.3g}]",
                f"{100 * pooled.coverage:.1f} [{100 * pooled.coverage_low:.1f}, "
                f"{100 * pooled.coverage_high:.1f}]",
                f"{pooled.largest_bias_t:.1f}",
            ]
        table.add_row(name.upper(), str(len(study.estimated(name))), *cells)
    console.print(table)
    console.print(f"written to {short(folder)}")
