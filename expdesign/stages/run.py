"""A run: its stages in their order, finished ones kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.runfolder import StageResult
from expdesign.runfolder.lock import one_writer
from expdesign.runfolder.manifest import Manifest
from expdesign.stages.execution import (
    Place,
    changes_by_hand,
    clear_leftovers,
    current_configuration,
    execute,
    input_hash,
    is_done,
    keep_configuration,
    refuse_removed,
    refuse_unwritable,
    run_folder,
    workspaces,
)
from expdesign.stages.registry import missing_design, named_stages, reported_stages, stages
from expdesign.stages.stage import Outcome, Progress, Stage, StageFailed, Workspace, short
from results.views.folder import RunFolder


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result of a run."""

    configuration: RunConfiguration
    folder: Path
    """The run folder."""
    stages: dict[str, Outcome]
    """The outcome of every stage that was done or kept, by name, in their order; of a stage of
    several motions by ``motion-1/experiment`` and so on."""

    def __repr__(self) -> str:
        """Return folder and stages with their status."""
        done = ", ".join(f"{name} {one.status}" for name, one in self.stages.items())
        return f"RunResult({str(self.folder)!r}: {done})"


def run(
    config: ConfigurationLike,
    out: Place | None = None,
    progress: Progress | None = None,
    *,
    resume: bool = False,
    effort: str | None = None,
    seed: int | None = None,
) -> RunResult:
    """Do every stage that a run names, as `expdesign run` does; finished stages are kept.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    out : path, optional
        The run folder; ``runs/<name>`` under the current folder by default.
    progress : Progress, optional
        Listener of warnings, remarks, progress and outcomes; nothing is shown by default. The
        first Ctrl-C ends a search or a study with its result so far, the second at once.
    resume : bool
        Whether an interrupted search continues from its starts and hops that had ended.
    effort : {"quick", "normal", "thorough"}, optional
        Size of the search, instead of the run's `design.effort`, starts and hops.
    seed : int, optional
        Seed of the search, instead of `design.seed`.

    Raises
    ------
    InputError
        The run, its data or the run folder cannot be used.
    StageFailed
        A stage failed or was interrupted, or its result breaks a limit.
    """
    configuration = load_run(config)
    folder = run_folder(configuration, out)
    refuse_unwritable(folder)
    with one_writer(folder, "expdesign run"):
        configuration = current_configuration(configuration, folder).with_search(effort, seed)
        refuse_unfit(configuration)
        if missing := missing_design(configuration, folder):
            raise InputError(missing)
        return _run_stages(
            Workspace(
                configuration,
                folder,
                progress or Progress(),
                stages=reported_stages(),
                resume=resume,
            )
        )


def _run_stages(work: Workspace) -> RunResult:
    configuration, folder = work.configuration, work.folder
    clear_leftovers(folder)
    work.warn(configuration.warnings)
    failed: StageFailed | None = None
    of_motions: dict[str, Outcome] = {}
    for stage in named_stages(configuration):
        if reason := stage.reason_left_out(configuration):
            work.progress.note(f"{stage.name}: left out, {reason}")
            continue
        for place in workspaces(stage, work):
            try:
                _do_stage(stage, place)
            except StageFailed as error:
                made = place.made.get(stage.name)
                if made is None or not made.continues:
                    raise
                failed = error
            if place is not work:
                of_motions[f"{place.folder.name}/{stage.name}"] = place.made[stage.name]
    if work.made and work.folder.is_dir():
        # Stages that were kept were made from the same sections; others may have changed.
        keep_configuration(configuration, work.folder)
    refuse_removed(work.folder, work.made.values())
    if failed is not None:
        raise failed
    return RunResult(configuration, work.folder, work.made | of_motions)


def _do_stage(stage: Stage, work: Workspace) -> None:
    folder = work.folder
    if stage.sections is None:
        for change in changes_by_hand(stage, folder, own=False):
            work.progress.warn(change)
    work.inputs[stage.name] = input_hash(stage, work)
    if is_done(stage, work):
        work.progress.note(f"{stage.name}: done already, in {short(folder)}")
        work.made[stage.name] = Outcome(stage.name, folder)
        return
    for change in changes_by_hand(stage, folder, own=True):
        work.progress.warn(f"{change}; {stage.name} is done again")
    execute(stage, work)


def folder_changes(folder: Path, configuration: RunConfiguration, *names: str) -> Iterator[str]:
    """Yield the changes by hand in a run folder that concern stages, all by default."""
    stages = reported_stages()
    changes = RunFolder(folder, stages, configuration, Manifest.known(folder)).changes
    found = (*changes.folder, *changes.of(*names))
    yield from dict.fromkeys(found) if names else changes.all


def refuse_unfit(configuration: RunConfiguration) -> None:
    """Refuse impossible motions of the validation and goals before any stage runs.

    Faults of the configuration alone were refused when it was loaded.
    """
    if configuration.run.validation:
        from expdesign.motion.benchmark import refuse_unfit_motions

        refuse_unfit_motions(configuration, configuration.robot.home)
    refuse_unfit_goals(configuration)


def refuse_unfit_goals(
    configuration: RunConfiguration, wanted: Mapping[str, str] | None = None
) -> None:
    """Refuse impossible goals, by default those of the run file."""
    if wanted or configuration.run.goals:
        from expdesign.experiment.plan import check_goals

        check_goals(configuration, wanted)


def report(folder: Place) -> Path:
    """Write the report of a run folder, one page for all its stages.

    Returns
    -------
    Path
        `report.html` in the folder.

    Raises
    ------
    InputError
        The folder is not a run folder, or one of its files is damaged.
    """
    page: Path = report_of(Path(folder)).result
    return page


def load_results(folder: Place) -> dict[str, Any]:
    """Return the results in a run folder by their stages, with tables and figures in `view`.

    Raises
    ------
    InputError
        The folder has no results, or one of its files is damaged.
    """
    place, found = Path(folder), dict[str, Any]()
    for name, stage in stages().items():
        kind = stage.functions().views.result_type
        if issubclass(kind, StageResult) and (place / kind.FILE).is_file():
            found[name] = kind.read(place)
    if not found:
        files = ", ".join(stage.file for stage in stages().values())
        raise InputError(f"the folder has no results: none of {files}", place)
    return found


def report_of(folder: Path) -> Outcome:
    """Write the report of a run folder; return its page, files and summary."""
    from expdesign.stages.report import report_folder

    place = folder.absolute()
    with one_writer(place, "expdesign report") if place.is_dir() else nullcontext():
        outcome = report_folder(place, reported_stages())
        if (known := Manifest.known(place)) is not None:
            known.with_files(place, outcome.files).write(place)
        return outcome
