"""The Monte-Carlo stage simulates and estimates many experiments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

from estimation.montecarlo import run_study as run_montecarlo
from estimation.montecarlo.result import EstimatorKeys, MonteCarloFile, MonteCarloRecord
from estimation.montecarlo.study import NAME as JOURNAL
from expdesign.interruption import interruptible
from expdesign.stages.outcome import Outcome, StageFailed, short
from expdesign.stages.workspace import Workspace
from expdesign.workers import Monitor, StoppedError

_MOST_REASONS = 3


def montecarlo(work: Workspace) -> Outcome:
    """Simulate and estimate many times."""
    configuration, folder = work.configuration, work.folder
    design = work.design()
    warnings = work.warn_of(design)
    kept = "the repetitions that are done are kept"
    with (
        work.progress.count("repetitions") as advanced,
        interruptible(work.progress.note, kept) as stop,
    ):
        monitor = Monitor(stop, advanced=advanced)
        study = run_montecarlo(configuration, design.trajectory, folder / JOURNAL, monitor)
    asked = monitor.stop_requested()
    if not study.repetitions:
        raise StoppedError("interrupted before the first repetition was done")
    record = MonteCarloRecord.of(study)
    found = record.summary.estimators
    if not any(keys.estimates for keys in found.values()):
        raise StageFailed(f"no repetition could be estimated: {_reasons(*found.values())}")
    count = f"{len(study.repetitions)} of {study.wanted} repetitions"
    message = f"interrupted after {count}" if study.interrupted else count
    failed = tuple(_failed_repetitions(record.summary))
    return Outcome(
        result=study,
        record=record,
        summary={
            "repetitions": len(study.repetitions),
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
        status="interrupted" if study.interrupted else "done",
        message=message,
        warnings=failed,
        failure=f"{message}; what they show is in {short(folder)}, and the same command goes on "
        "from there"
        if study.interrupted
        else "",
        asked_to_stop=asked,
    )


def _failed_repetitions(summary: MonteCarloFile) -> Iterator[str]:
    """Yield a warning for every estimator that failed or did not converge somewhere."""
    for name, keys in summary.estimators.items():
        if failed := len(keys.failures):
            yield (
                f"{name} failed in {failed} of {summary.repetitions.done} repetitions, which its "
                f"numbers leave out: {_reasons(keys)}"
            )
        if stuck := len(keys.not_converged):
            yield f"{name} did not converge in {stuck} repetitions, which are counted"


def _reasons(*estimators: EstimatorKeys) -> str:
    reasons = dict.fromkeys(failure.reason for keys in estimators for failure in keys.failures)
    shown = list(reasons)[:_MOST_REASONS]
    return "; ".join(shown) + ("; …" if len(reasons) > len(shown) else "")
