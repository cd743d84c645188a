"""Stage that estimates the parameters from recordings, and judges the estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.linalg import LinAlgError

from expdesign.configuration.schema import MOST_SAMPLES, require_at_most
from expdesign.progress import track
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import ESTIMATE_FILE, Outcome, StageFailed, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification import EstimationResult


class EstimateStage(Stage):
    """Estimate of the parameters."""

    name = "estimate"
    does = "estimates the parameters from a recording"
    file = ESTIMATE_FILE
    writes = ("estimates.csv", "identified-robot.yaml", *TABLES)
    sections = run_sections("trajectory", "data", "estimate", experiment={"payload"})
    needs = ("recording",)
    compared = "estimates.csv"

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from estimation.identification.result import EstimationResult

        return EstimationResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the estimate."""
        from results.views.estimate import estimate_view

        del brief
        return estimate_view(folder)

    def compare(
        self, folders: Mapping[str, RunFolder], *, precision: float, quick: bool
    ) -> StageView:
        """Return the comparison of estimates."""
        from results.comparison.estimates import compare_estimates

        del precision, quick
        return compare_estimates(folders)

    def run(self, work: Workspace) -> Outcome:
        """Estimate the parameters and diagnose the estimate."""
        from estimation import identification

        configuration, files = work.configuration, work.data_files()
        designs = work.recorded_designs(len(files))
        recordings: list[Measurement] = []
        for file in track("reading recordings", files):
            recordings.append(work.recording(file))
            count = sum(len(recording.time) for recording in recordings)
            require_at_most(count, MOST_SAMPLES, f"{len(recordings)} recordings", key="--data")
        try:
            result = identification.estimate(configuration, recordings, designs)
        except LinAlgError as error:
            raise StageFailed(
                "the parameters cannot be determined from these data: is a channel constant? "
                f"({error})"
            ) from error
        summary = _summary(result)
        return Outcome(
            result=result,
            record=result,
            summary=summary,
            message="; ".join(f"{name}: {e.status}" for name, e in result.estimators.items()),
            warnings=result.warnings[len(configuration.warnings) :],
            doubt="" if summary["verdict"] == "accepted" else "a diagnostic failed",
        )


def _summary(result: EstimationResult) -> dict[str, Any]:
    verdict = None if result.diagnostics is None else result.diagnostics.verdict
    near = result.best_estimator.consistent
    best = result.by_estimator()[result.best]
    return {
        "best": result.best,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit} for row in best
        },
        **({} if result.selection is None else {"terms_added": list(result.selection.chosen)}),
        "not_identified": [row.parameter for row in best if row.identified is False],
        "consistent": None
        if near is None
        else {"distance": near.distance, "p": near.p, "values": near.values},
        "verdict": "not judged" if verdict is None else verdict.status.value,
        "findings": [] if verdict is None else [finding.sentence for finding in verdict.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }
