"""Registry of the stages: the built-in ones, those of plug-ins, and their choice in a run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from inspect import isabstract
from pathlib import Path
from types import MappingProxyType

from constraints.plugins import declared_classes
from expdesign.configuration import Problem, RunConfiguration
from expdesign.configuration.several_runs import motion_folders
from expdesign.stages.stage import (
    ESTIMATE_FILE,
    FIGURES,
    MEASUREMENT_FILE,
    TABLES,
    Stage,
    StageFunctions,
    Workspace,
    run_sections,
    short,
    too_long_to_simulate,
)

_EXPERIMENT, _VOLTAGES = {"periods", "sampling", "payload"}, {"units"}
_ESTIMATOR = {"systematic", "estimators", "harmonics"}
_PREDICTION = {"experiment": _EXPERIMENT, "estimate": _ESTIMATOR, "data": _VOLTAGES}
"""Keys that the predicted precision of a motion depends on."""


class SearchStage(Stage):
    """Stage that searches or judges designs."""

    def functions(self) -> StageFunctions:
        """Return the search or the judgement, and its view."""
        from expdesign.stages.design import stage_functions

        return stage_functions(DesignStage())[self.name]


class SimulationStage(Stage):
    """Stage on the digital twin."""

    def functions(self) -> StageFunctions:
        """Return the simulation and its view."""
        from expdesign.stages.experiment import FUNCTIONS

        return FUNCTIONS[self.name]


class EstimationStage(Stage):
    """Stage that analyses a recording or uses an estimate."""

    def functions(self) -> StageFunctions:
        """Return the computation, its view and its comparison."""
        from expdesign.stages.estimate import FUNCTIONS

        return FUNCTIONS[self.name]

    def read_inputs(self, work: Workspace) -> None:
        """Read the recordings."""
        if "recording" in self.inputs(work.configuration):
            from expdesign.stages.recordings import recordings_of

            recordings_of(work)


class DesignStage(SearchStage):
    """Search for the optimal excitation trajectory."""

    name = "design"
    does = "searches the optimal excitation trajectory"
    file = "design.json"
    writes = ("trajectory.csv", *TABLES)
    sections = run_sections("trajectory", "design", experiment=_EXPERIMENT)
    needs = ("others", "tolerances")
    compared = "trajectory.csv"

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason against a single design in a sweep."""
        sweeps = configuration.run.sweep is not None
        return "the sweep does it for each of its designs" if sweeps else ""


class MotionsStage(DesignStage):
    """Search for several motions of one experiment."""

    name = "motions"
    does = "searches the motions of the experiment"
    file = "motions.json"
    writes = (*TABLES, "motion-*/design.json")
    compared = ""


class NextStage(SearchStage):
    """Gain of the next motion over the last one repeated."""

    name = "next"
    does = "compares the next motion with the last one repeated"
    file = "next.json"
    writes = TABLES
    sections = run_sections("trajectory", "design", **_PREDICTION)
    needs = ("design",)
    shown_after = "design"


class GoalsStage(SearchStage):
    """Measuring time for wanted precisions."""

    name = "goals"
    does = "plans the measuring time for wanted precisions"
    file = "plan.json"
    writes = TABLES
    sections = run_sections("trajectory", "design", "goals", **_PREDICTION)
    needs = ("design",)
    makes_design = True


class ExperimentStage(SimulationStage):
    """Simulated experiment on the digital twin."""

    name = "experiment"
    does = "measures the trajectory on the digital twin"
    file = "truth.json"
    output = MEASUREMENT_FILE
    writes = ("columns.json", MEASUREMENT_FILE, "repetitions/*/measurement.csv")
    sections = run_sections("experiment", "data")
    needs = ("design",)
    motions = "each"

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason against a simulation: a measured recording, its length, or a sweep."""
        run = configuration.run
        if run.data.recording is not None:
            return f"the data is measured: {short(Path(run.data.recording))}"
        return too_long_to_simulate(run) or super().reason_left_out(configuration)


class NoiseStage(EstimationStage):
    """Noise analysis of a recording, without any model."""

    name = "noise"
    does = "analyses the noise of a recording"
    file = "noise.json"
    writes = ("noise.yaml", *TABLES)
    sections = run_sections("trajectory", "data", estimate={"frequency"})
    needs = ("recording",)
    in_sweep = True


class MonteCarloStage(SimulationStage):
    """Monte-Carlo study of the estimators."""

    name = "montecarlo"
    does = "judges the estimators on many simulated experiments"
    file = "montecarlo.json"
    writes = TABLES
    sections = run_sections("experiment", "estimate", "montecarlo", data=_VOLTAGES)
    needs = ("design",)
    compared = "tables/montecarlo.csv"

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason against the simulations: their length, or a sweep."""
        left_out = super().reason_left_out(configuration)
        return left_out or too_long_to_simulate(configuration.run)


class EstimateStage(EstimationStage):
    """Estimate of the parameters."""

    name = "estimate"
    does = "estimates the parameters from a recording"
    file = ESTIMATE_FILE
    writes = ("estimates.csv", "identified-robot.yaml", *TABLES)
    sections = run_sections(
        "trajectory", "data", "estimate", "goals", design={"interest"}, experiment={"payload"}
    )
    needs = ("recording",)
    compared = "estimates.csv"


class ValidateStage(EstimationStage):
    """Validation of an estimate on other motions."""

    name = "validate"
    does = "predicts motions that were not used for the estimate"
    file = "validation.json"
    writes = TABLES
    sections = run_sections("trajectory", "experiment", "data", "estimate", "validation")
    needs = ("estimate", "validation")
    compared = "tables/validation.csv"


class FeedforwardStage(EstimationStage):
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


class SweepStage(SearchStage):
    """Designs over a grid."""

    name = "sweep"
    does = "designs at every point of a grid"
    file = "sweep.json"
    writes = (*TABLES, "designs/*/design.json")
    sections = run_sections(
        *("trajectory", "design", "sweep", "goals"),
        **_PREDICTION,
    )
    needs = ("others",)
    in_sweep = True


class ExportStage(Stage):
    """Controller tables."""

    name = "export"
    does = "writes controller tables of the motion"
    file = "exports/exports.json"
    writes = ("exports/*",)
    sections = run_sections(
        "trajectory",
        "motion",
        "export",
        design={"parameters", "known"},
        experiment=_EXPERIMENT,
    )
    needs = ("design",)
    motions = "each"
    shown_after = "design"

    def functions(self) -> StageFunctions:
        """Return the export of every table that the run names, and the view of the tables."""
        from expdesign.stages.export import EXPORT

        return EXPORT


class ReportStage(Stage):
    """One page for everything in the folder."""

    name = "report"
    does = "writes one page for everything in the folder"
    file = "report.html"
    writes = ("tables/*.tex", FIGURES)
    needs = ("folder",)
    motions = "both"
    in_sweep = True

    def functions(self) -> StageFunctions:
        """Return the report of a run folder."""
        from expdesign.stages.report import REPORT

        return REPORT


FIRST = DesignStage.name
"""Stage of a run whose file names none."""


@cache
def stages() -> Mapping[str, Stage]:
    """Return the stages by name, in the order of a run, which is that of their classes here.

    `next` and `noise` are commands only. Stages of plug-ins follow the stage that they name, or
    come last before the report.
    """
    own = [
        kind for kind in globals().values() if isinstance(kind, type) and issubclass(kind, Stage)
    ]
    found: list[Stage] = [kind() for kind in own if hasattr(kind, "name")]
    for kind in declared_classes(Stage):  # type: ignore[type-abstract]
        if not isabstract(kind):
            stage = kind()
            names = [one.name for one in found]
            found.insert(names.index(stage.after) + 1 if stage.after else len(found) - 1, stage)
    return MappingProxyType({stage.name: stage for stage in found})


def reported_stages() -> dict[str, Stage]:
    """Return the stages with a section in reports, in the order of the sections."""
    every = [stage for stage in stages().values() if not isinstance(stage, ReportStage)]
    found = [stage for stage in every if not stage.shown_after]
    for stage in every:
        if stage.shown_after:
            found.insert([one.name for one in found].index(stage.shown_after) + 1, stage)
    return {stage.name: stage for stage in found}


def named_stages(configuration: RunConfiguration) -> tuple[Stage, ...]:
    """Return the stages that a run names, in their order."""
    return tuple(stage_of(name, configuration) for name in configuration.run.stages or (FIRST,))


def stage_of(name: str, configuration: RunConfiguration) -> Stage:
    """Return a stage by its key in a run file; `design` of several motions is `motions`."""
    several = name == FIRST and configuration.run.trajectory.count > 1
    return stages()[MotionsStage.name if several else name]


def performed_stages(configuration: RunConfiguration) -> list[Stage]:
    """Return the stages that a run does, in their order."""
    named = named_stages(configuration)
    return [stage for stage in named if not stage.reason_left_out(configuration)]


def missing_design(configuration: RunConfiguration, folder: Path) -> Problem | None:
    """Return the problem that stages need a design and there is none; None without it."""
    performed = performed_stages(configuration)
    needing = [stage.name for stage in performed if "design" in stage.inputs(configuration)]
    made = any(isinstance(stage, DesignStage) for stage in performed)
    file, places = DesignStage.file, motion_folders(configuration, folder)
    if made or not needing or all((place / file).exists() for place in places):
        return None
    verb = "needs" if len(needing) == 1 else "need"
    return Problem(
        f"{' and '.join(needing)} {verb} a design: the run file names none, and {short(folder)} "
        f"has no {file}",
        file=configuration.file,
        key=FIRST,
        allowed="`design:` in the run file, or with --out a folder that `expdesign design` wrote",
    )
