"""Stage that judges the estimators on many simulated experiments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

from expdesign.interruption import interruptible
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, StageFailed, Workspace, short
from expdesign.workers import Monitor, StoppedError
from results.views.folder import RunFolder
from results.views.view import StageView

if TYPE_CHECKING:
    from estimation.montecarlo.result import EstimatorStatistics, MonteCarloResult

_MOST_REASONS = 3


class MonteCarloStage(Stage):
    """Monte-Carlo study of the estimators."""

    name = "montecarlo"
    does = "judges the estimators on many simulated experiments"
    file = "montecarlo.json"
    writes = TABLES
    sections = run_sections("experiment", "estimate", "montecarlo")
    needs = ("design",)
    compared = "tables/montecarlo.csv"

    def result_type(self) -> type[MonteCarloResult]:
        """Return the type of the stored result."""
        from estimation.montecarlo.result import MonteCarloResult

        return MonteCarloResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the study."""
        from results.views.experiment import montecarlo_view

        del brief
        return montecarlo_view(folder)

    def compare(
        self, folders: Mapping[str, RunFolder], *, precision: float, quick: bool
    ) -> StageView:
        """Return the achieved standard deviations of studies."""
        from results.comparison.comparison import compare_montecarlo

        del precision, quick
        return compare_montecarlo(folders)

    def run(self, work: Workspace) -> Outcome:
        """Simulate and estimate many times; Ctrl-C keeps the complete repetitions."""
        from estimation.montecarlo import run_study
        from estimation.montecarlo.study import NAME as JOURNAL

        configuration, folder = work.configuration, work.folder
        design = work.design()
        warnings = work.warn_of(design)
        kept = "the repetitions that are done are kept"
        with (
            work.progress.count("repetitions") as advanced,
            interruptible(work.progress.note, kept) as stop,
        ):
            monitor = Monitor(stop, advanced=advanced)
            result = run_study(configuration, design.trajectory, folder / JOURNAL, monitor)
        asked = monitor.stop_requested()
        if not result.repetitions:
            raise StoppedError("interrupted before the first repetition was done")
        found = result.estimators
        if not any(each.estimates for each in found.values()):
            raise StageFailed(f"no repetition could be estimated: {_reasons(*found.values())}")
        count = f"{result.counts.done} of {result.counts.wanted} repetitions"
        message = f"interrupted after {count}" if result.interrupted else count
        failed = tuple(_failed_repetitions(result))
        return Outcome(
            result=result,
            record=result,
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
