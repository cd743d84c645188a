"""Export of controller tables, of their descriptions, and of the motion that they hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from expdesign.configuration import ComputationError, ExportSection, InputError, RunConfiguration
from expdesign.experiment.judging import unknown_parameters
from expdesign.export.definition import Task
from expdesign.export.exporting import (
    Export,
    export_job,
    export_table,
    file_name,
    refuse_missing_library,
    refuse_unreadable_name,
)
from expdesign.export.result import (
    FOLDER,
    README,
    RECORD,
    ExportedMotion,
    ExportedTable,
    ExportResult,
    exported_motion,
    exported_table,
    readme,
    result_file,
)
from expdesign.motion.executable import has_enclosure
from expdesign.motion.planning import check_motion, executable_motion
from expdesign.progress import forward_progress, progress_prefix, report_progress
from expdesign.recheck.limit_check import range_share_in_words
from expdesign.robot import robot_from
from expdesign.runfolder.files import RUN_FILE, remove_leftovers, write_text
from expdesign.runfolder.manifest import (
    package_versions,
    sections_hash,
    sections_text,
    text_hash,
)
from expdesign.stages.execution import (
    add_to_files,
    clear_outdated,
    keep_configuration,
    origins,
    record_added,
    view_result,
)
from expdesign.stages.stage import (
    Outcome,
    Stage,
    StageFunctions,
    Workspace,
    short,
    trajectory_text,
)
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Job, Monitor, run_jobs
from results.views.export import export_view
from results.views.folder import StageViews


def run_export(work: Workspace) -> Outcome:
    """Write every table that the run names, with README.txt and exports.json.

    Both keep the tables of the same motion that were exported by hand.
    """
    configuration, target = work.configuration, work.folder / FOLDER
    sections = configuration.run.export
    for number, section in enumerate(sections, start=1):
        refuse_missing_library(section, f"export[{number}]")
        _refuse_taken_name(target / file_name(section), f"export[{number}].file")
    task = export_task(work)
    before = ExportResult.known(target / RECORD)
    clear_outdated("export", work)
    own = {file_name(section) for section in sections}
    motion = exported_motion(task)
    files = _files_of_motion(before, motion, own, work)
    places = target / RECORD, target / README
    described = _describe(ExportResult(motion, files), *places) if files else ()
    made, refused = [], list[Exception]()
    for one in _export_all(task, sections, target, configuration.run.workers or 1):
        if isinstance(one, Exception):
            refused.append(one)
            continue
        made.append(one)
        if one.note:
            work.progress.note(one.note)
        # After each table: when another one fails, this one has its description, and
        # `expdesign export` does not replace it by one with the options of an earlier run.
        files[one.path.name] = exported_table(one)
        described = _describe(ExportResult(motion, files), *places)
        keep_configuration(configuration, work.folder)
    if refused:
        for error in refused[1:]:
            work.progress.warn(f"failed, too: {error}")
        raise refused[0]
    written = (path for one in made for path in (one.path, *one.companions))
    return _outcome(motion, made, (*written, *described))


EXPORT = StageFunctions(run_export, StageViews(ExportResult, export_view))


def _export_all(
    task: Task, sections: Sequence[ExportSection], target: Path, workers: int
) -> Iterator[Export | InputError | ComputationError]:
    """Yield the tables that worker processes write, in their order, or the errors instead."""
    jobs = [
        Job(export_job, (section, target / name, f"export[{k}]", f"{name}, table {k} of {count}"))
        for count in [len(sections)]
        for k, section in enumerate(sections, start=1)
        for name in [file_name(section)]
    ]
    try:
        yield from run_jobs(partial(copy, task), jobs, workers, Monitor(report=forward_progress()))
    finally:
        # Files of a worker that was ended while it wrote a table.
        remove_leftovers(target, locked=True)


def export_path(section: ExportSection, work: Workspace, out: Path | None) -> Path:
    """Return the path of a table, by default in ``exports/`` of the run folder; refuse others."""
    refuse_missing_library(section)
    target = work.folder / FOLDER
    path = target / file_name(section) if out is None else out.absolute()
    refuse_unreadable_name(section, path, "--out")
    place = path.parent.resolve()
    if place == target.resolve():
        _refuse_taken_name(path, "--file" if out is None else "--out")
    elif place.name == FOLDER and (place.parent / RUN_FILE).is_file():
        message = f"{short(place)} has the tables of another run folder"
        allowed = f"{short(target)}, or a folder outside of run folders"
        raise InputError(message, key="--out", allowed=allowed)
    return path


def export_one(
    stage: Stage, section: ExportSection, work: Workspace, task: Task, path: Path
) -> Outcome:
    """Write one table of a run folder's `export_task` to an `export_path`."""
    target = work.folder / FOLDER
    in_folder = path.parent.resolve() == target.resolve()
    with progress_prefix(path.name):
        made = export_table(section, task, path)
    if made.note:
        work.progress.note(made.note)
    motion, entry = exported_motion(task), {path.name: exported_table(made)}
    if in_folder:
        made_from = origins(stage, work) | {
            RUN_FILE: sections_hash(work.configuration, stage.sections, without=stage.name)
        }
        known = ExportResult.known(target / RECORD)
        others = _files_of_motion(known, motion, {path.name}, work)
        places = target / RECORD, target / README
        with add_to_files(work.folder, places):
            _describe(ExportResult(motion, others | entry), *places)
        own = (path, *made.companions)
        record_added(work.folder, (*own, *places), dict.fromkeys(own, made_from))
    else:
        _describe_alone(path, ExportResult(motion, entry))
    outcome = _outcome(motion, [made], (path, *made.companions))
    return replace(outcome, view=view_result(stage, outcome.result, work))


def _refuse_taken_name(path: Path, key: str) -> None:
    if path.name.casefold() in {README.casefold(), RECORD.casefold()}:
        message = f"{path.name} describes the tables of this folder"
        allowed = f"another name than {README} and {RECORD}"
        raise InputError(message, key=key, allowed=allowed)


def export_task(work: Workspace) -> Task:
    """Return the task of an export: the design with its lead-in and lead-out.

    Those of the folder's tables are used when they were made from the same configuration, design
    and versions.
    """
    configuration = work.configuration
    run, noise = configuration.run, configuration.robot.noise
    robot = robot_from(configuration.robot)
    trajectory = work.design().trajectory
    made_from = _made_from(configuration, trajectory)
    result = work.folder / FOLDER / RECORD
    known, motion = ExportResult.known(result), None
    if known is not None and known.motion.made_from == made_from:
        motion = known.motion.executable(trajectory, robot.home)
    if motion is not None and motion.periods == run.experiment.periods:
        work.progress.note(f"the lead-in and lead-out are those of {short(result)}")
    else:
        report_progress("lead-in and lead-out")
        motion = executable_motion(configuration, trajectory)
    check = check_motion(configuration, motion) if has_enclosure(motion) else None
    if check is not None and not check.certified:
        left = (one for one in check.limits if not one.certified)
        worst = max(left, key=lambda one: one.possible)
        reason = "nothing is proved"
        if np.isfinite(worst.proved):
            reason = f"it may be beyond its bound by {range_share_in_words(worst.proved)}"
        work.progress.warn(
            f"the motion from rest to rest is not proved to keep {worst.title}: {reason}"
        )
    return Task(
        check=check,
        name=run.name,
        robot=robot,
        motion=motion,
        controller_period=run.controller_period,
        sampling=run.experiment.sampling,
        parameters=unknown_parameters(configuration, robot),
        force_covariance=None if noise is None else noise.force_covariance,
        made_from=made_from,
    )


def _made_from(configuration: RunConfiguration, trajectory: FourierTrajectory) -> str:
    """Return the hash of everything that lead-in and lead-out depend on."""
    sections = {
        "robot": True,
        "motion": True,
        "trajectory": {"controller_period"},
        "experiment": {"periods", "sampling", "payload"},
    }
    text, versions = sections_text(configuration, sections), sorted(package_versions().items())
    return text_hash("executable motion", text, trajectory_text(trajectory), versions)


def _files_of_motion(
    before: ExportResult | None, motion: ExportedMotion, replaced: set[str], work: Workspace
) -> dict[str, ExportedTable]:
    """Return the folder's tables of this motion; warn of tables of another one.

    `before` is the content of exports.json, before outdated files were removed. Tables that are
    `replaced` now cause no warning.
    """
    if before is None:
        return {}
    folder = work.folder / FOLDER
    present = {name: entry for name, entry in before.files.items() if (folder / name).is_file()}
    if before.motion == motion:
        return present
    if others := sorted(present.keys() - replaced):
        work.progress.warn(
            f"not of the motion that is exported now, and no longer in {README} and {RECORD}: "
            f"{', '.join(others)}"
        )
    return {}


def _describe_alone(path: Path, result: ExportResult) -> None:
    """Write the description of one table next to it, under names that begin with the table's.

    Where the table has replaced one in a copy of an `exports/`, the old description is removed.
    """
    _describe(result, result_file(path), path.with_name(f"{path.name}.{README}"))
    shared, guide = path.with_name(RECORD), path.with_name(README)
    other = ExportResult.known(shared)
    if other is not None and path.name in other.files:
        rest = {name: entry for name, entry in other.files.items() if name != path.name}
        if rest:
            _describe(replace(other, files=rest), shared, guide)
        else:
            shared.unlink()
            guide.unlink(missing_ok=True)


def _describe(result: ExportResult, path: Path, guide: Path) -> tuple[Path, Path]:
    """Write the description of tables, for programs and for people; return both paths."""
    result.write_as(path)
    write_text(guide, readme(result))
    return path, guide


def _outcome(motion: ExportedMotion, made: list[Export], files: tuple[Path, ...]) -> Outcome:
    """Return the outcome of an export, a failure if a table makes the machine break a limit."""
    tables = {one.path: exported_table(one) for one in made}
    data = ExportResult(motion, {str(path): table for path, table in tables.items()}).as_data()
    data["motion"].pop("leads")
    broken = [f"{one.path.name}: {text}" for one in made for text in one.check.broken]
    failure = f"with these tables the machine breaks limits: {'; '.join(broken)}. They were written"
    return Outcome(
        result=ExportResult(motion, {path.name: table for path, table in tables.items()}),
        files=files,
        summary=data,
        status="limits broken" if broken else "done",
        failure=failure if broken else "",
        continues=True,
    )
