"""The stages of a run, in one table: everything that names them reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from expdesign.configuration import Problem, RunConfiguration
from expdesign.stages.outcome import short

Keys = bool | set[str]


def _data_is_given(configuration: RunConfiguration) -> str:
    file = configuration.run.data.file
    return "" if file is None else f"the data is measured: {short(Path(file))}"


def _sweep_does_it(configuration: RunConfiguration) -> str:
    sweeps = configuration.run.sweep is not None
    return "the sweep does it for each of its designs" if sweeps else ""


def _sweep_has_many(configuration: RunConfiguration) -> str:
    if configuration.run.sweep is None:
        return ""
    return "the sweep makes several designs, and `expdesign run` of the run.yaml of one does it"


def _own_motion(configuration: RunConfiguration) -> bool:
    return configuration.run.feedforward.motion != "design"


def _sections(*names: str, **keys: set[str]) -> Mapping[str, Keys]:
    return {**dict.fromkeys(("name", "robot", *names), True), **keys}


@dataclass(frozen=True)
class Stage:
    """A stage: what it needs, what it does and what becomes of it."""

    does: str
    """In words."""
    record: str
    """The file without which a run folder does not hold the stage."""
    perform: str
    """Function ``(Workspace) -> Outcome`` that does it, as ``module:function``: its imports take
    seconds, and are only made when it is done. It raises `InputError` for what cannot be used, and
    `ComputationError` where there is no result."""
    sections: Mapping[str, Keys] | None
    """Sections of the run file, or keys of them, that the result depends on; None: on all."""
    needs: tuple[str, ...] = ()
    """What it may be made from beside the run file: ``"design"``, ``"recording"`` (with the design
    that was executed, if there is one), ``"estimate"``, or ``"folder"``, all other stages. It
    comes from the options of the command, from memory when the same run has just made it, or
    from the run folder."""
    writes: tuple[str, ...] = ()
    """Further files that it writes in any case, and patterns of those that depend on the run."""
    result: str = ""
    """The file without which it is done again; `record` when it is not given."""
    report: str | None = None
    """Function that makes its section of the report, as ``module:function``."""
    reported_after: str = ""
    """Stage after which that section stands; where the stage stands in this table by default."""
    does_without: Mapping[str, Callable[[RunConfiguration], bool]] = field(default_factory=dict)
    """Of what it needs, that which only some runs need, with whether this one does without."""
    left_out: tuple[Callable[[RunConfiguration], str], ...] = ()
    """Reasons why a run does not do it although it names it; empty texts are none."""

    def needed(self, configuration: RunConfiguration) -> tuple[str, ...]:
        """Return what it needs in this run."""
        spared = {need for need, spares in self.does_without.items() if spares(configuration)}
        return tuple(need for need in self.needs if need not in spared)


_FIGURES = "figures/*"
_TABLES = ("columns.json", "tables/*.csv", _FIGURES)

STAGES: dict[str, Stage] = {
    "design": Stage(
        does="searches the optimal excitation trajectory",
        record="design.json",
        perform="expdesign.stages.design:perform",
        sections=_sections("trajectory", "design", experiment={"periods", "sampling", "payload"}),
        writes=("trajectory.csv", *_TABLES),
        report="results.views.design:design_report",
        left_out=(_sweep_does_it,),
    ),
    "experiment": Stage(
        does="measures the trajectory on the digital twin",
        record="truth.json",
        perform="expdesign.stages.experiment:perform",
        needs=("design",),
        sections=_sections("experiment"),
        writes=("columns.json", "measurement.csv", "repetitions/*/measurement.csv"),
        result="measurement.csv",
        report="results.views.noise:experiment_report",
        left_out=(_data_is_given, _sweep_has_many),
    ),
    "noise": Stage(
        does="analyses the noise of a recording",
        record="noise.json",
        perform="expdesign.stages.estimate:analyse_noise",
        needs=("recording",),
        sections=_sections("trajectory", "data"),
        writes=("noise.yaml", *_TABLES),
        report="results.views.noise:noise_report",
    ),
    "montecarlo": Stage(
        does="judges the estimators on many simulated experiments",
        record="montecarlo.json",
        perform="expdesign.stages.montecarlo:montecarlo",
        needs=("design",),
        sections=_sections("experiment", "estimate", "montecarlo"),
        writes=_TABLES,
        report="results.views.montecarlo:montecarlo_report",
        left_out=(_sweep_has_many,),
    ),
    "estimate": Stage(
        does="estimates the parameters from a recording",
        record="estimate.json",
        perform="expdesign.stages.estimate:perform",
        needs=("recording",),
        sections=_sections("trajectory", "data", "estimate", experiment={"payload"}),
        writes=("estimates.csv", "identified-robot.yaml", *_TABLES),
        report="results.views.estimate:estimate_report",
        left_out=(_sweep_has_many,),
    ),
    "validate": Stage(
        does="predicts motions that were not used for the estimate",
        record="validation.json",
        perform="expdesign.stages.estimate:predict",
        needs=("estimate",),
        sections=_sections("trajectory", "experiment", "data", "estimate", "validation"),
        writes=_TABLES,
        report="results.views.validate:validation_report",
        left_out=(_sweep_has_many,),
    ),
    "feedforward": Stage(
        does="drives the twin with and without the forces of the identified model",
        record="feedforward.json",
        perform="expdesign.stages.feedforward:perform",
        needs=("estimate", "design"),
        does_without={"design": _own_motion},
        sections=_sections("trajectory", "experiment", "data", "estimate", "feedforward"),
        writes=_TABLES,
        report="results.views.feedforward:feedforward_report",
        left_out=(_sweep_has_many,),
    ),
    "sweep": Stage(
        does="designs at every point of a grid",
        record="sweep.json",
        perform="expdesign.stages.sweep:perform",
        sections=_sections(
            "trajectory", "design", "sweep", experiment={"periods", "sampling", "payload"}
        ),
        writes=(*_TABLES, "designs/*/design.json"),
        report="results.views.sweep:sweep_report",
    ),
    "export": Stage(
        does="writes controller tables of the motion",
        record="exports/exports.json",
        perform="expdesign.stages.export:perform",
        needs=("design",),
        sections=_sections(
            "trajectory",
            "motion",
            "export",
            design={"parameters"},
            experiment={"periods", "sampling", "payload"},
        ),
        writes=("exports/*",),
        report="results.views.export:export_report",
        reported_after="design",
        left_out=(_sweep_has_many,),
    ),
    "report": Stage(
        does="writes one page for everything in the folder",
        record="report.html",
        perform="expdesign.stages.report:perform",
        needs=("folder",),
        sections=None,
        writes=("tables/*.tex", _FIGURES),
    ),
}
"""By name, in the order in which a run does them; `noise` is a command only."""

FIRST = next(iter(STAGES))
"""What a run does whose file names no stage."""


def loaded(place: str) -> Any:
    """Return a function that is named as ``module:function``."""
    module, name = place.split(":")
    return getattr(import_module(module), name)


def named(configuration: RunConfiguration) -> tuple[str, ...]:
    """Return the stages that a run names, in their order."""
    return configuration.run.stages or (FIRST,)


def left_out(stage: str, configuration: RunConfiguration) -> str:
    """Return why the run does not do a stage that it names; empty when it does."""
    return next(filter(None, (why(configuration) for why in STAGES[stage].left_out)), "")


def performed(configuration: RunConfiguration) -> list[str]:
    """Return the stages that the run does, in their order."""
    return [stage for stage in named(configuration) if not left_out(stage, configuration)]


def stages_without_design(configuration: RunConfiguration, folder: Path) -> Problem | None:
    """Return the problem that stages need a design and there is none; None when there is one."""
    stages = performed(configuration)
    needing = [stage for stage in stages if "design" in STAGES[stage].needed(configuration)]
    record = STAGES[FIRST].record
    if FIRST in stages or not needing or (folder / record).exists():
        return None
    verb = "needs" if len(needing) == 1 else "need"
    return Problem(
        f"{' and '.join(needing)} {verb} a design: the run file names none, and {short(folder)} "
        f"has no {record}",
        file=configuration.file,
        key=FIRST,
        allowed="`design:` in the run file, or with --out a folder that `expdesign design` wrote",
    )
