"""The stages that simulate many experiments: the Monte-Carlo study, and studies of comparison."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict

from estimation.montecarlo import Study
from estimation.montecarlo import run_study as run_montecarlo
from estimation.montecarlo.journal import NAME as JOURNAL
from estimation.montecarlo.record import MonteCarloRecord
from estimation.studies import Claim, run_study
from expdesign.stages.outcome import Outcome, StageFailed, interruptible, short
from expdesign.stages.record import clear_outdated
from expdesign.stages.table import STAGES
from expdesign.stages.workspace import Workspace
from expdesign.workers import Monitor

_MOST_REASONS = 3


def montecarlo(work: Workspace) -> Outcome:
    """Simulate and estimate many times."""
    configuration, folder = work.configuration, work.folder
    design = work.design()
    warnings = work.warn_of(design)
    with _watched(work, "repetitions") as monitor:
        study = run_montecarlo(configuration, design.trajectory, folder / JOURNAL, monitor)
    if not study.repetitions:
        raise StageFailed("interrupted before the first repetition was done")
    if not any(study.estimated(name) for name in study.estimators):
        raise StageFailed(f"no repetition could be estimated: {_reasons(study)}")
    count = f"{len(study.repetitions)} of {study.wanted} repetitions"
    message = f"interrupted after {count}" if study.interrupted else count
    failed = tuple(_failed_repetitions(study))
    pooled = {name: study.pooled(name) for name in study.estimators}
    return Outcome(
        result=study,
        record=MonteCarloRecord.of(study),
        summary={
            "repetitions": len(study.repetitions),
            "estimators": {
                name: {
                    "estimates": len(study.estimated(name)),
                    "failures": len(study.failures(name)),
                    "pooled": None if found is None else asdict(found),
                }
                for name, found in pooled.items()
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
    )


def study(work: Workspace) -> Outcome:
    """Do the comparison that the run names."""
    configuration = work.configuration
    trajectory = None
    if STAGES["study"].needed(configuration):
        design = work.design()
        work.warn_of(design)
        trajectory = design.trajectory
    with _watched(work, "steps of the study") as monitor:
        found = run_study(configuration, trajectory, monitor)
    clear_outdated("study", work)
    claims = found.record.summary.claims
    return Outcome(
        result=claims,
        record=found,
        summary={"claims": [asdict(claim) for claim in claims]},
        message=_how_many_hold(claims),
    )


@contextmanager
def _watched(work: Workspace, what: str) -> Iterator[Monitor]:
    stopping = f"stopping: the {what} that are done are kept …"
    with (
        work.progress.count(what) as advanced,
        interruptible(work.progress.note, stopping) as stop,
    ):
        yield Monitor(stop, advanced=advanced)


def _how_many_hold(found: Sequence[Claim]) -> str:
    judged = [claim for claim in found if claim.holds is not None]
    return f"{sum(bool(claim.holds) for claim in judged)} of {len(judged)} claims hold"


def _failed_repetitions(study: Study) -> Iterator[str]:
    """Yield a warning for every estimator that failed or did not converge somewhere."""
    for name in study.estimators:
        if failed := len(study.failures(name)):
            yield (
                f"{name} failed in {failed} of {len(study.repetitions)} repetitions, which its "
                f"numbers leave out: {_reasons(study, name)}"
            )
        if stuck := sum(not outcome.converged for _, outcome in study.estimated(name)):
            yield f"{name} did not converge in {stuck} repetitions, which are counted"


def _reasons(study: Study, *estimators: str) -> str:
    names = estimators or study.estimators
    reasons = dict.fromkeys(reason for name in names for _, reason in study.failures(name))
    shown = list(reasons)[:_MOST_REASONS]
    return "; ".join(shown) + ("; …" if len(reasons) > len(shown) else "")
