"""Stage that estimates the parameters from recordings, and judges the estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.linalg import LinAlgError

from expdesign.configuration.fields import MOST_SAMPLES, require_at_most
from expdesign.progress import track
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import ESTIMATE_FILE, Outcome, StageFailed, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.diagnostics.diagnosis_result import Diagnosis
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
        from estimation.identification.record import EstimateRecord

        return EstimateRecord

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
        """Estimate, and judge the estimate.

        The result is the `EstimationResult` and the `Diagnosis`, which is None where the intervals
        do not cover.
        """
        from estimation import identification
        from estimation.diagnostics.diagnosis import diagnose
        from estimation.identification.record import EstimateRecord

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
        diagnosis = None
        if result.intervals_cover:
            diagnosis = diagnose(result.robot, result.experiments, result.knowledge, result.best)
        summary = _summary(result, diagnosis)
        return Outcome(
            result=(result, diagnosis),
            record=EstimateRecord.of(result, diagnosis),
            summary=summary,
            message="; ".join(f"{name}: {e.status}" for name, e in result.estimates.items()),
            warnings=result.warnings[len(configuration.warnings) :],
            doubt="" if summary["verdict"] == "accepted" else "a diagnostic failed",
        )


def _summary(result: EstimationResult, diagnosis: Diagnosis | None) -> dict[str, Any]:
    verdict = None if diagnosis is None else diagnosis.verdict
    near = result.consistent[result.best.estimator]
    best = [row for row in result.rows if row.estimator == result.best.estimator]
    return {
        "best": result.best.estimator,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit} for row in best
        },
        **({} if result.selection is None else {"terms_added": list(result.selection.chosen)}),
        "not_identified": [row.parameter for row in best if row.identified is False],
        "consistent": None
        if near is None
        else {
            "distance": near.distance,
            "p": near.p,
            "values": dict(zip(result.knowledge.names, near.values.tolist(), strict=True)),
        },
        "verdict": "not judged" if verdict is None else verdict.status.value,
        "findings": [] if verdict is None else [finding.sentence for finding in verdict.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }
