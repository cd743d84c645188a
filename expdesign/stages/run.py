"""A run: its stages one after the other, what is done already being kept."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile

from expdesign.configuration import (
    ComputationError,
    ConfigurationLike,
    InputError,
    RunConfiguration,
    load_run,
)
from expdesign.stages.outcome import Outcome, Progress, StageFailed, short
from expdesign.stages.record import is_done, keep_configuration, stage_inputs, write_entry
from expdesign.stages.table import STAGES, left_out, loaded, named, stages_without_design
from expdesign.stages.workspace import Workspace


@dataclass(frozen=True, eq=False)
class RunResult:
    """What a run has made."""

    configuration: RunConfiguration
    folder: Path
    """The run folder."""
    stages: dict[str, Outcome]
    """The outcome of every stage that was done or kept, by name, in their order."""


def run(
    config: ConfigurationLike,
    out: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Do every stage that a run names, as `expdesign run` does; what is done already is kept.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    out : path, optional
        The run folder; ``runs/<name>`` under the current folder by default.
    progress : Progress, optional
        Takes warnings, remarks, how far a stage is and what it made; nothing is shown by default.
        The first Ctrl-C ends a search or a study with what it has, the second at once.

    Raises
    ------
    InputError
        The run, its data or the run folder cannot be used.
    StageFailed
        A stage failed or was interrupted, or its result breaks a limit.
    """
    configuration = load_run(config)
    work = Workspace(configuration, run_folder(configuration, out), progress or Progress())
    refuse_study(configuration)
    if missing := stages_without_design(configuration, work.folder):
        raise InputError(missing)
    for warning in configuration.warnings:
        work.progress.warn(warning)
    for stage in named(configuration):
        if reason := left_out(stage, configuration):
            work.progress.note(f"{stage}: left out, {reason}")
            continue
        work.inputs[stage] = stage_inputs(stage, work)
        if is_done(stage, work):
            work.progress.note(f"{stage}: done already, in {short(work.folder)}")
            work.made[stage] = Outcome(stage, work.folder)
        else:
            do_stage(stage, work)
    if work.made and work.folder.is_dir():
        # Stages that were kept were made from the same sections; others may have changed.
        keep_configuration(configuration, work.folder)
    return RunResult(configuration, work.folder, work.made)


def do_stage(name: str, work: Workspace) -> Outcome:
    """Do a stage, leave its configuration in the folder and write its entry to the manifest.

    A stage that fails leaves `run.yaml` as it was: nothing there was made from its configuration.
    Files of an earlier run stay, but the manifest no longer vouches for them.

    Raises
    ------
    InputError
        What it needs is not there or cannot be used, or the folder cannot be written to.
    StageFailed
        It failed or was interrupted, or its result breaks a limit.
    """
    work.inputs[name] = stage_inputs(name, work)
    refuse_unwritable(work.folder)
    began = time.perf_counter()
    try:
        outcome: Outcome = loaded(STAGES[name].perform)(work)
    except ComputationError as error:
        if work.folder.is_dir():
            failed = Outcome(name, work.folder, status="failed", message=error.message)
            write_entry(work, failed, time.perf_counter() - began)
        raise StageFailed(error.message, error.details) from error
    files, record = outcome.files, outcome.record
    if record is not None and not files:
        from results import record_figures

        formats = work.configuration.run.report.figures
        files = (*record.write(work.folder), *record_figures(record, work.folder, formats))
    seconds = time.perf_counter() - began
    told = {"folder": str(work.folder), "seconds": seconds, **outcome.summary}
    outcome = replace(outcome, stage=name, folder=work.folder, files=files, summary=told)
    keep_configuration(work.configuration, work.folder)
    write_entry(work, outcome, seconds)
    work.made[name] = outcome
    for warning in outcome.warnings:
        work.progress.warn(warning)
    if outcome.failure:
        raise StageFailed(outcome.failure, outcome.summary)
    work.progress.finished(outcome)
    return outcome


def run_folder(configuration: RunConfiguration, out: str | PathLike[str] | None) -> Path:
    """Return the run folder: what was asked for, or runs/<name> in the current folder."""
    return (Path("runs") / configuration.run.name if out is None else Path(out)).absolute()


def refuse_unwritable(folder: Path) -> None:
    """Find out before the work, not after it, that its result cannot be written."""
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        with TemporaryFile(dir=existing):
            pass
    except OSError as error:
        message = f"cannot write there: {error.strerror}"
        allowed = "a folder that is new, or may be written to"
        raise InputError(message, folder, key="--out", allowed=allowed) from error


def refuse_study(configuration: RunConfiguration) -> None:
    """Refuse a study that cannot be done before anything else is."""
    if configuration.run.study is not None:
        from estimation.studies import refuse_unfit_study
        from expdesign.robot import robot_from

        refuse_unfit_study(configuration, robot_from(configuration.robot))
