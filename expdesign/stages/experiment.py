"""Simulated experiments: a recording of the digital twin, and a Monte-Carlo study."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from os import PathLike
from pathlib import Path

from estimation.data.measurement import Measurement
from estimation.montecarlo import run_study
from estimation.montecarlo.result import EstimatorStatistics, MonteCarloResult
from estimation.montecarlo.study import NAME as JOURNAL
from estimation.twin import Truth, Twin
from estimation.twin.truth import REPETITIONS, write_measurement, write_truth
from expdesign.configuration import ConfigurationLike, load_run
from expdesign.experiment import DesignResult
from expdesign.export.table_file import find_table_file
from expdesign.interruption import interruptible
from expdesign.progress import report_progress
from expdesign.robot import robot_from
from expdesign.runfolder.manifest import text_hash
from expdesign.stages.execution import Place, clear_outdated
from expdesign.stages.stage import (
    MEASUREMENT_FILE,
    Outcome,
    StageFailed,
    StageFunctions,
    Workspace,
    short,
)
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from expdesign.workers import ClusterError, Monitor, StoppedError
from results.views.experiment import compare_montecarlo, experiment_view, montecarlo_view
from results.views.folder import StageViews

_MOST_REASONS = 3


def run_experiment(work: Workspace) -> Outcome:
    """Simulate, and write the run folder; Ctrl-C keeps the complete repetitions."""
    configuration, folder, sources = work.configuration, work.folder, work.sources
    design = work.design()
    warnings = work.warn_of(design)
    table = None
    if sources.table is not None:
        robot = robot_from(configuration.robot)
        table = find_table_file(sources.table.absolute(), robot, design.trajectory)
        inputs = work.inputs["experiment"]
        work.inputs["experiment"] = text_hash(inputs, table.path.name, table.digest)
    report_progress("the motion without noise")
    twin = Twin.of(configuration, design.trajectory if table is None else table)
    if table is not None and table.changed:
        # Afterwards, since the twin refuses a table of another motion.
        changed = (
            f"{table.path.name} was changed after it was exported: the executed motion was not "
            "checked, and the description of its axes and window may be wrong"
        )
        work.progress.warn(changed)
        warnings.append(changed)
    repetitions, done, measurement = sources.repetitions, 0, None
    files = clear_outdated("experiment", work)
    status = "done"
    try:
        files |= set(write_truth(twin.truth, folder, configuration, repeated=repetitions > 1))
        with work.progress.count("repetitions") as advanced:
            for number in range(1, repetitions + 1):
                place = f"{REPETITIONS}/{number:04d}" if repetitions > 1 else "."
                file = folder / place / MEASUREMENT_FILE
                advanced(done, repetitions)
                measurement = twin.measurement(number)
                write_measurement(measurement, file, configuration)
                files.add(file)
                done = number
                advanced(done, repetitions)
    except KeyboardInterrupt:
        status = "interrupted"
    message = "" if status == "done" else f"interrupted after {done} of {repetitions} measurements"
    truth = twin.truth
    return Outcome(
        result=truth,
        recording=measurement,
        files=tuple(sorted(files)),
        summary={
            "repetitions": done,
            "periods": truth.experiment.periods,
            "samples": truth.experiment.samples,
            "samples_per_period": truth.experiment.samples_per_period,
            "table": None if truth.table is None else truth.table.file,
            "warnings": [*configuration.warnings, *warnings],
        },
        status=status,
        message=message,
        failure=message and f"{message}; they are in {short(folder)}",
    )


def simulate(
    config: ConfigurationLike,
    design: DesignResult | FourierTrajectory | Place,
    repetition: int = 1,
) -> Measurement:
    """Measure a designed trajectory on the digital twin.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Run with the robot and the section `experiment`.
    design : DesignResult, FourierTrajectory or path
        Executed motion: a result, a run folder or `design.json`.
    repetition : int
        Number of the repetition, from 1; each has different noise.

    Returns
    -------
    Measurement
        Time, lengths and forces, in SI.

    Raises
    ------
    InputError
        Run or design cannot be used, or the robot cannot make the motion.
    """
    return Twin.of(load_run(config), trajectory_of(design)).measurement(repetition)


def trajectory_of(design: DesignResult | FourierTrajectory | Place) -> FourierTrajectory:
    """Return the trajectory of a design: of a result, a run folder or `design.json`."""
    if isinstance(design, FourierTrajectory):
        return design
    if isinstance(design, str | PathLike):
        return TrajectoryFile.read(Path(design).absolute()).trajectory
    return design.trajectory


def run_montecarlo(work: Workspace) -> Outcome:
    """Simulate and estimate many times; Ctrl-C keeps the complete repetitions."""
    configuration, folder = work.configuration, work.folder
    design = work.design()
    warnings = work.warn_of(design)
    kept = "the repetitions that are done are kept"
    with (
        work.progress.count("repetitions") as advanced,
        interruptible(work.progress.note, kept) as stop,
    ):
        lost: list[ClusterError] = []
        monitor = Monitor(stop, lost.append, advanced)
        result = run_study(configuration, design.trajectory, folder / JOURNAL, monitor)
    asked = monitor.stop_requested()
    if not result.repetitions:
        raise StoppedError("interrupted before the first repetition was done")
    found = result.estimators
    if not any(each.estimates for each in found.values()):
        raise StageFailed(f"no repetition could be estimated: {_reasons(*found.values())}")
    count = f"{result.counts.done} of {result.counts.wanted} repetitions"
    message = f"interrupted after {count}" if result.interrupted else count
    if lost:
        message = f"{message} ({lost[0].message})"
    failed = tuple(_failed_repetitions(result))
    return Outcome(
        result=result,
        summary={
            "repetitions": result.counts.done,
            "estimators": {
                name: {
                    "estimates": keys.estimates,
                    "failures": len(keys.failures),
                    "pooled": None if keys.pooled is None else asdict(keys.pooled),
                }
                for name, keys in found.items()
            },
            "warnings": [*configuration.warnings, *warnings, *failed],
        },
        status="interrupted" if result.interrupted else "done",
        message=message,
        warnings=failed,
        failure=f"{message}; the results are in {short(folder)}, and the same command "
        "continues the study"
        if result.interrupted
        else "",
        asked_to_stop=asked,
    )


def _failed_repetitions(result: MonteCarloResult) -> Iterator[str]:
    """Yield a warning for every estimator that failed or did not converge somewhere."""
    for name, keys in result.estimators.items():
        if failed := len(keys.failures):
            yield (
                f"{name} failed in {failed} of {result.counts.done} repetitions, which its "
                f"numbers leave out: {_reasons(keys)}"
            )
        if stuck := len(keys.not_converged):
            yield f"{name} did not converge in {stuck} repetitions, which are counted"


def _reasons(*estimators: EstimatorStatistics) -> str:
    reasons = dict.fromkeys(failure.reason for keys in estimators for failure in keys.failures)
    shown = list(reasons)[:_MOST_REASONS]
    return "; ".join(shown) + ("; …" if len(reasons) > len(shown) else "")


FUNCTIONS = {
    "experiment": StageFunctions(run_experiment, StageViews(Truth, experiment_view)),
    "montecarlo": StageFunctions(
        run_montecarlo, StageViews(MonteCarloResult, montecarlo_view, compare_montecarlo)
    ),
}
"""Functions of the stages by name."""
