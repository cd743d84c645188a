"""`expdesign run`: every stage that the YAML names, resuming what is done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from expdesign.cli.design import design_stage
from expdesign.cli.errors import CommandFailed
from expdesign.cli.estimate import estimate_stage, folder_recording
from expdesign.cli.export import export_stage
from expdesign.cli.export_motion import folder_motion
from expdesign.cli.folder import OutOption, run_folder
from expdesign.cli.montecarlo import montecarlo_stage
from expdesign.cli.output import JsonOption, RunArgument, note, short, warn, warn_all, write_json
from expdesign.cli.report import folder_stages, report_stage
from expdesign.cli.simulate import experiment_stage, folder_design
from expdesign.cli.study import needs_design, study_design, study_stage
from expdesign.cli.validate import folder_estimate, validate_stage

if TYPE_CHECKING:
    from expdesign.configuration import Problem, RunConfiguration


class Perform(Protocol):
    """Do a stage in a run folder and return what came out, for machines."""

    def __call__(
        self, configuration: RunConfiguration, folder: Path, *, as_json: bool
    ) -> dict[str, Any]:
        """Raise `CommandFailed` or `InputError` when the run is not to go on."""


def _nothing_else(_folder: Path) -> str:
    return ""


def _needed(_configuration: RunConfiguration) -> str:
    return ""


def _data_is_given(configuration: RunConfiguration) -> str:
    file = configuration.run.data.file
    return "" if file is None else f"the data is measured: {short(Path(file))}"


def _study_does_it(stage: str, configuration: RunConfiguration) -> str:
    """Tell that a study of designs has designs and experiments of its own."""
    section = configuration.run.study
    own = ("design", "experiment", "montecarlo", "estimate")
    if section is None or section.kind != "design" or stage not in own:
        return ""
    return "the study does it for each of its designs"


@dataclass(frozen=True)
class Step:
    """A stage as `run` does it.

    Attributes
    ----------
    perform : callable
    made_from : callable
        What the stage takes from the run folder, as text, beside the configuration.
    result : str
        The file without which it is not done.
    left_out : callable
        Why this run needs no such stage although it names it; empty when it does.
    """

    perform: Perform
    result: str
    made_from: Callable[[Path], str] = _nothing_else
    left_out: Callable[[RunConfiguration], str] = _needed


STEPS = {
    "design": Step(design_stage, "design.json"),
    "experiment": Step(experiment_stage, "measurement.csv", folder_design, _data_is_given),
    "montecarlo": Step(montecarlo_stage, "montecarlo.json", folder_design),
    "estimate": Step(estimate_stage, "estimate.json", folder_recording),
    "validate": Step(validate_stage, "validation.json", folder_estimate),
    "study": Step(study_stage, "study.json", study_design),
    "export": Step(export_stage, "exports/exports.json", folder_motion),
    "report": Step(report_stage, "report.html", folder_stages),
}
"""The stages of this version by their name in the run file."""


_EXECUTE = ("experiment", "montecarlo", "study", "export")
"""Stages that take a design that is there."""


def left_out(stage: str, configuration: RunConfiguration) -> str:
    """Return why the run does not do a stage that it names; empty when it does."""
    return STEPS[stage].left_out(configuration) or _study_does_it(stage, configuration)


def performed(configuration: RunConfiguration) -> list[str]:
    """Return the stages that the run does, in their order."""
    stages = configuration.stages or ("design",)
    return [stage for stage in stages if stage in STEPS and not left_out(stage, configuration)]


def missing_design(configuration: RunConfiguration, folder: Path) -> Problem | None:
    """Return that stages have no design to execute; None when they have one or need none."""
    from expdesign.configuration import Problem

    stages = performed(configuration)
    needing = [
        stage
        for stage in stages
        if stage in _EXECUTE and (stage != "study" or needs_design(configuration))
    ]
    if "design" in stages or not needing or (folder / "design.json").exists():
        return None
    verb = "needs" if len(needing) == 1 else "need"
    return Problem(
        f"{' and '.join(needing)} {verb} a design: the run file names none, and {short(folder)} "
        "has no design.json",
        file=configuration.file,
        key="design",
        allowed="`design:` in the run file, or with --out a folder that `expdesign design` wrote",
    )


def refuse_study(configuration: RunConfiguration) -> None:
    """Refuse a study that cannot be done before anything else is."""
    from estimation.studies import refuse_unfit_study
    from expdesign.robot import robot_from

    if configuration.run.study is not None:
        refuse_unfit_study(configuration, robot_from(configuration.robot))


def run(run: RunArgument, out: OutOption = None, as_json: JsonOption = False) -> None:
    """Do every stage that the run file names, in their order; what is done already is kept."""
    from expdesign.cli.stages import keep_configuration
    from expdesign.configuration import InputError, load_run

    configuration = load_run(run)
    folder = run_folder(configuration, out)
    stages = configuration.stages or ("design",)
    if not set(stages) & set(STEPS):
        raise CommandFailed(
            f"the run names {', '.join(stages)}; this version has {', '.join(STEPS)} only"
        )
    refuse_study(configuration)
    if missing := missing_design(configuration, folder):
        raise InputError(missing)
    warn_all(configuration.warnings)
    done: dict[str, dict[str, Any]] = {}
    for stage in stages:
        step = STEPS.get(stage)
        if step is None:
            warn(f"the stage '{stage}' is not part of this version and is left out")
        elif reason := left_out(stage, configuration):
            note(f"{stage}: left out, {reason}")
        else:
            done[stage] = _done(stage, step, configuration, folder, as_json=as_json)
    if done and folder.is_dir():
        # Stages that were kept were made from the same sections; others may have changed.
        keep_configuration(configuration, folder)
    if as_json:
        resumed = all(summary["resumed"] for summary in done.values())
        write_json({"status": 0, "folder": str(folder), "resumed": resumed, "stages": done})


def _done(
    stage: str, step: Step, configuration: RunConfiguration, folder: Path, *, as_json: bool
) -> dict[str, Any]:
    from expdesign.cli.stages import is_done

    made_from = step.made_from(folder)
    if (folder / step.result).is_file() and is_done(stage, configuration, folder, made_from):
        note(f"{stage}: done already, in {short(folder)}")
        return {"resumed": True}
    return {"resumed": False, **step.perform(configuration, folder, as_json=as_json)}
