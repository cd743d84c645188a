"""Registry of the stages, those of plug-ins included, and their choice in a run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from inspect import isabstract
from pathlib import Path
from types import MappingProxyType

from constraints.plugins import declared_classes
from expdesign.configuration import Problem, RunConfiguration
from expdesign.stages.design import DesignStage
from expdesign.stages.estimate import EstimateStage
from expdesign.stages.experiment import ExperimentStage
from expdesign.stages.export import ExportStage
from expdesign.stages.feedforward import FeedforwardStage
from expdesign.stages.montecarlo import MonteCarloStage
from expdesign.stages.noise import NoiseStage
from expdesign.stages.report import ReportStage
from expdesign.stages.stage import Stage
from expdesign.stages.sweep import SweepStage
from expdesign.stages.validate import ValidateStage
from expdesign.stages.workspace import short

_BUILT_IN: tuple[type[Stage], ...] = (
    DesignStage,
    ExperimentStage,
    NoiseStage,
    MonteCarloStage,
    EstimateStage,
    ValidateStage,
    FeedforwardStage,
    SweepStage,
    ExportStage,
    ReportStage,
)
FIRST = DesignStage.name
"""Stage of a run whose file names none."""


@cache
def stages() -> Mapping[str, Stage]:
    """Return the stages by name, in the order of a run.

    `noise` is a command only. Stages of plug-ins follow the stage that they name, or come last
    before the report.
    """
    found: list[Stage] = [kind() for kind in _BUILT_IN]
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
    return tuple(stages()[name] for name in configuration.run.stages or (FIRST,))


def performed_stages(configuration: RunConfiguration) -> list[Stage]:
    """Return the stages that a run does, in their order."""
    named = named_stages(configuration)
    return [stage for stage in named if not stage.reason_left_out(configuration)]


def missing_design(configuration: RunConfiguration, folder: Path) -> Problem | None:
    """Return the problem that stages need a design and there is none; None without it."""
    performed = performed_stages(configuration)
    needing = [stage.name for stage in performed if "design" in stage.inputs(configuration)]
    made = any(stage.name == FIRST for stage in performed)
    file = DesignStage.file
    if made or not needing or (folder / file).exists():
        return None
    verb = "needs" if len(needing) == 1 else "need"
    return Problem(
        f"{' and '.join(needing)} {verb} a design: the run file names none, and {short(folder)} "
        f"has no {file}",
        file=configuration.file,
        key=FIRST,
        allowed="`design:` in the run file, or with --out a folder that `expdesign design` wrote",
    )
