"""Stage that drives the twin by a position controller, with and without the model's forces."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView


class FeedforwardStage(Stage):
    """Comparison of feed-forwards on the closed loop."""

    name = "feedforward"
    does = "drives the twin with and without the forces of the identified model"
    file = "feedforward.json"
    writes = TABLES
    sections = run_sections("trajectory", "experiment", "data", "estimate", "feedforward")
    needs = ("estimate", "design")
    compared = "tables/feedforward.csv"

    def inputs(self, configuration: RunConfiguration) -> tuple[str, ...]:
        """Return the inputs; without the design for a motion of the run file."""
        designed = configuration.run.feedforward.motion == "design"
        return self.needs if designed else ("estimate",)

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from estimation.feedforward.result import FeedforwardResult

        return FeedforwardResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the comparison."""
        from results.views.validate import feedforward_view

        del brief
        return feedforward_view(folder)

    def run(self, work: Workspace) -> Outcome:
        """Compare the tracking errors with each feed-forward."""
        from estimation.feedforward.comparison import compare_feedforward

        configuration, saved = work.estimate()
        design = None
        if "design" in self.inputs(configuration):
            design = work.design().trajectory
        record = compare_feedforward(configuration, saved, design)
        reduction = record.case("identified").reduction
        return Outcome(
            result=record,
            record=record,
            summary={
                "machine": record.machine,
                "motion": record.motion,
                "cases": [asdict(each) for each in record.cases],
                "left": record.left,
                "warnings": list(record.warnings),
            },
            message=f"error {reduction:.3g} times smaller with the identified model",
            warnings=record.warnings[len(configuration.warnings) :],
            doubt="" if reduction > 1 else "the identified model does not make the error smaller",
        )
