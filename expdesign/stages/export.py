"""The stage that writes controller tables, what describes them, and the motion that they hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from constraints.arrays import Array
from expdesign.configuration import ExportSection, InputError, Problem, RunConfiguration
from expdesign.experiment.design import judged_parameters
from expdesign.export import (
    FOLDER,
    RECORD,
    Export,
    ExportError,
    ExportsRecord,
    FileEntry,
    MotionEntry,
    Task,
    export_table,
    file_name,
    readme,
    record_of_one,
    refuse_missing_library,
    refuse_unreadable_name,
)
from expdesign.motion import (
    ExecutableMotion,
    NoRampError,
    executable_motion,
)
from expdesign.robot import robot_from
from expdesign.runfolder.atomic import write_text
from expdesign.runfolder.manifest import package_versions, text_hash
from expdesign.stages.outcome import Outcome, StageFailed
from expdesign.stages.progress import Progress, short
from expdesign.stages.record import (
    added_to,
    clear_outdated,
    keep_configuration,
    sections_text,
)
from expdesign.stages.run import refuse_unwritable
from expdesign.stages.workspace import Workspace, trajectory_text
from expdesign.trajectory import FourierTrajectory

NAME = "export"
README = "README.txt"


def perform(work: Workspace) -> Outcome:
    """Write every table that the run names, with README.txt and exports.json.

    Both go on telling of the tables of the same motion that were exported by hand.

    Raises
    ------
    InputError
        An option cannot be kept.
    StageFailed
        A table is beyond a tolerance, or the machine cannot get into the motion.
    """
    configuration, target = work.configuration, work.folder / FOLDER
    sections = configuration.run.export
    for number, section in enumerate(sections, start=1):
        refuse_missing_library(section, f"export[{number}]")
        refuse_taken_name(target / file_name(section), f"export[{number}].file")
    task = export_task(work)
    before = ExportsRecord.known(target / RECORD)
    clear_outdated(NAME, work)
    own = {file_name(section) for section in sections}
    files = _described_files(before, target, task, own, work.progress)
    described = _describe(target, task, files) if files else ()
    made = []
    for number, section in enumerate(sections, start=1):
        path = target / file_name(section)
        made.append(export_checked(section, task, path, f"export[{number}]"))
        # After each: when the next one fails, this one is not without its description, and
        # `expdesign export` does not replace it by one with the options of an earlier run.
        files[path.name] = FileEntry.of(made[-1])
        described = _describe(target, task, files)
        keep_configuration(configuration, work.folder)
    return Outcome(
        NAME,
        work.folder,
        made,
        (*(export.path for export in made), *described),
        summary={"folder": str(work.folder), **_summary(task, made)},
    )


def export_one(section: ExportSection, work: Workspace, out: Path | None) -> Outcome:
    """Write one table, as `expdesign export` does.

    Parameters
    ----------
    section : ExportSection
    work : Workspace
        Of the run folder whose design is exported.
    out : Path or None
        The file; in ``exports/`` of the run folder by default.

    Raises
    ------
    InputError, StageFailed
        As `perform`.
    """
    refuse_missing_library(section)
    target = work.folder / FOLDER
    path = target / file_name(section) if out is None else out.absolute()
    refuse_unreadable_name(section, path, "--out")
    in_folder = path.parent.resolve() == target.resolve()
    if in_folder:
        refuse_taken_name(path, "--file" if out is None else "--out")
    refuse_unwritable(path.parent)
    for warning in work.configuration.warnings:
        work.progress.warn(warning)
    task = export_task(work)
    made = export_checked(section, task, path, "")
    if in_folder:
        before = ExportsRecord.known(target / RECORD)
        files = _described_files(before, target, task, {path.name}, work.progress)
        with added_to(work.folder, (target / RECORD, target / README)):
            _describe(target, task, files | {path.name: FileEntry.of(made)})
    else:
        _describe_beside(path, task, made)
    return Outcome(NAME, work.folder, [made], (path,), summary=_summary(task, [made]))


def refuse_taken_name(path: Path, key: str) -> None:
    """Refuse a table under the name of what describes the tables of its folder.

    Raises
    ------
    InputError
        It has such a name.
    """
    taken = (README, RECORD)
    if path.name.casefold() in {name.casefold() for name in taken}:
        raise InputError(
            Problem(
                f"{path.name} is what describes the tables of this folder",
                key=key,
                allowed=f"another name than {' and '.join(taken)}",
            )
        )


def export_checked(section: ExportSection, task: Task, path: Path, place: str) -> Export:
    """Write a table and read it back; one that fails is not kept.

    Raises
    ------
    InputError
        An option at `place` of the run file cannot be kept.
    StageFailed
        The table is beyond a tolerance.
    """
    try:
        return export_table(section, task, path, place)
    except ExportError as error:
        raise StageFailed(
            f"{error}. The file was not kept{error.remedy and '; '}{error.remedy}.",
            {"failures": list(error.check.failures)},
        ) from error


def export_task(work: Workspace) -> Task:
    """Return what is exported: the design with its ways from and to rest.

    The ways that the folder's tables have are taken when they were made from the same
    configuration, design and versions.

    Raises
    ------
    InputError
        The design is missing or none.
    StageFailed
        The machine cannot get into the motion.
    """
    configuration = work.configuration
    run, noise = configuration.run, configuration.robot.noise
    robot = robot_from(configuration.robot)
    trajectory = work.design().trajectory
    made_from = _made_from(configuration, trajectory)
    record = work.folder / FOLDER / RECORD
    motion = _known_motion(record, made_from, trajectory, robot.home)
    if motion is not None and motion.periods == run.experiment.periods:
        work.progress.note(
            f"the ways from rest into the motion and back are those of {short(record)}"
        )
    else:
        work.progress.note("looking for the ways from rest into the motion and back")
        try:
            motion = executable_motion(configuration, trajectory)
        except NoRampError as error:
            raise StageFailed(str(error)) from error
    return Task(
        name=run.name,
        robot=robot,
        motion=motion,
        controller_period=run.trajectory.controller_period or run.experiment.step,
        sampling=run.experiment.sampling,
        parameters=judged_parameters(configuration, robot),
        force_covariance=None if noise is None else noise.force_covariance,
        made_from=made_from,
    )


def _made_from(configuration: RunConfiguration, trajectory: FourierTrajectory) -> str:
    """Return the hash of everything that the ways depend on."""
    sections = {
        "robot": True,
        "motion": True,
        "trajectory": {"controller_period"},
        "experiment": {"periods", "sampling"},
    }
    text, versions = sections_text(configuration, sections), sorted(package_versions().items())
    return text_hash("executable motion", text, trajectory_text(trajectory), versions)


def _known_motion(
    path: Path, made_from: str, trajectory: FourierTrajectory, home: Array
) -> ExecutableMotion | None:
    record = ExportsRecord.known(path)
    if record is None or record.motion.made_from != made_from or record.motion.ways is None:
        return None
    try:
        return record.motion.ways.motion(trajectory, home)
    except ValueError:
        return None


def _described_files(
    before: ExportsRecord | None, folder: Path, task: Task, replaced: set[str], progress: Progress
) -> dict[str, FileEntry]:
    """Return what is known of the tables of this motion in a folder; warn of those of another.

    Parameters
    ----------
    before : ExportsRecord or None
        What exports.json says, or said before outdated files were removed.
    folder : Path
    task : Task
    replaced : set of str
        Names of the tables that are about to be written: of these, nothing is warned.
    progress : Progress
    """
    if before is None:
        return {}
    present = {name: entry for name, entry in before.files.items() if (folder / name).is_file()}
    if before.motion == MotionEntry.of(task):
        return present
    if others := sorted(present.keys() - replaced):
        progress.warn(
            f"not of the motion that is exported now, and no longer in {README} and {RECORD}: "
            f"{', '.join(others)}"
        )
    return {}


def _describe(folder: Path, task: Task, files: dict[str, FileEntry]) -> tuple[Path, Path]:
    """Write README.txt and exports.json of the tables of a folder."""
    record = ExportsRecord(MotionEntry.of(task), files)
    return _written(record, folder / RECORD, folder / README)


def _describe_beside(path: Path, task: Task, made: Export) -> None:
    """Write the same of one table beside it, under names that tell whose they are.

    Where the table has replaced one of another run's `exports/`, what is said there of the old
    one goes.
    """
    record = ExportsRecord(MotionEntry.of(task), {path.name: FileEntry.of(made)})
    _written(record, record_of_one(path), path.with_name(f"{path.name}.{README}"))
    shared, guide = path.with_name(RECORD), path.with_name(README)
    other = ExportsRecord.known(shared)
    if other is not None and path.name in other.files:
        rest = {name: entry for name, entry in other.files.items() if name != path.name}
        if rest:
            _written(replace(other, files=rest), shared, guide)
        else:
            shared.unlink()
            guide.unlink(missing_ok=True)


def _summary(task: Task, made: list[Export]) -> dict[str, Any]:
    record = ExportsRecord(MotionEntry.of(task), {str(one.path): FileEntry.of(one) for one in made})
    data = record.as_data()
    data["motion"].pop("ways")
    return data


def _written(record: ExportsRecord, path: Path, guide: Path) -> tuple[Path, Path]:
    record.write_as(path)
    write_text(guide, readme(record))
    return path, guide
