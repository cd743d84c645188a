"""Certificates of a run folder's motions: design, lead-in and lead-out, and tables."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from expdesign.configuration import InputError
from expdesign.export.certification import BROKEN, IN_PART, PROVED, PathCertificate
from expdesign.export.result import FOLDER, RECORD, ExportResult
from expdesign.export.table_file import certify_file, find_table_file
from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.planning import check_motion
from expdesign.progress import progress_prefix
from expdesign.recheck.certificate import recheck
from expdesign.robot import ForwardKinematicsError, LimitModel, Robot, robot_from
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.manifest import Manifest, file_hash
from expdesign.stages.folder import refuse_run_file
from expdesign.stages.workspace import StageFailed, Workspace, short
from expdesign.trajectory import FourierTrajectory


@dataclass(frozen=True)
class CertifiedPart:
    """A motion of a run folder with its certificate."""

    name: str
    title: str
    proof: PathCertificate

    def as_data(self) -> dict[str, Any]:
        """Return the same as plain data."""
        limits = [
            asdict(check) | {"kept": check.kept, "certified": check.certified}
            for check in self.proof.limits
        ]
        own = {"name": self.name, "title": self.title, "certified": self.proof.certified}
        own |= {"verdict": self.proof.verdict}
        return {**own, **asdict(self.proof), "limits": limits}


def certified_folder(work: Workspace) -> list[CertifiedPart]:
    """Return the certificates of a run folder's design, of its lead-in and lead-out, and tables.

    Lead-in and lead-out are those of exports.json; they keep `motion.jerk` as well.
    """
    if not work.design_file.exists():
        message = f"there is no {work.design_file.name}"
        raise InputError(message, work.folder, allowed="a folder that `expdesign design` wrote")
    manifest = Manifest.known(work.folder)
    entry = None if manifest is None else manifest.stages.get("design")
    name = work.design_file.name
    if entry is not None and entry.files.get(name) not in (None, file_hash(work.design_file)):
        work.progress.warn(f"{name} was changed after it was designed")
    robot = robot_from(work.configuration.robot)
    trajectory = work.design().trajectory
    with progress_prefix("design"):
        found = [_design(robot, trajectory)]
    place = work.folder / FOLDER
    record = ExportResult.known(place / RECORD)
    if record is None:
        work.progress.note("no table was exported, and therefore no lead-in and lead-out planned")
        return found
    motion = _executable(record, trajectory, robot)
    title = "the motion from rest to rest"
    if motion is None:
        found.append(_left_out("motion", title, f"{RECORD} has those of another design"))
    else:
        with progress_prefix("lead-in and lead-out"):
            limits = check_motion(work.configuration, motion).limits
        found.append(CertifiedPart("motion", title, PathCertificate(limits)))
    for name, table in record.files.items():
        if (place / name).is_file():
            found.append(certified_table(work, place / name))
        else:
            missing = f"it is in {RECORD}, but no longer in the folder"
            found.append(_left_out(name, table.title, missing))
    return found


def _left_out(name: str, title: str, reason: str) -> CertifiedPart:
    return CertifiedPart(name, title, PathCertificate((), unchecked=(reason,)))


def worst_verdict(parts: list[CertifiedPart]) -> str:
    """Return the verdict on all parts: the worst of theirs."""
    verdicts = {part.proof.verdict for part in parts}
    return next(one for one in (BROKEN, IN_PART, PROVED) if one in verdicts)


def certified_table(work: Workspace, path: Path, *, piece: bool = False) -> CertifiedPart:
    """Return the certificate of a table of the run folder's design, or of a copy of one.

    A `piece` of a table may begin and end anywhere.
    """
    robot = robot_from(work.configuration.robot)
    exports = work.folder / FOLDER / RECORD
    table = find_table_file(path, robot, work.design().trajectory, exports)
    if table.described_in == exports != path.with_name(RECORD):
        work.progress.note(
            f"{path.name} has no description in its folder: by its SHA-256 it is "
            f"{table.exported_as} of {short(exports)}, and is read as such"
        )
    if table.changed:
        work.progress.warn(f"{path.name} was changed after it was exported")
    with progress_prefix(path.name):
        try:
            proved = certify_file(table, piece=piece)
        except (ForwardKinematicsError, np.linalg.LinAlgError) as trouble:
            raise StageFailed(f"{path.name} cannot be executed: {trouble}") from trouble
    return CertifiedPart(path.name, table.settings.form.title, proved)


def folder_of_table(path: Path) -> Path:
    """Return the run folder of a table in its exports/."""
    folder = path.parent.parent
    if path.parent.name != FOLDER or not (folder / RUN_FILE).is_file():
        refuse_run_file(path)
        raise InputError(
            "it is not in the exports/ of a run folder, so that its robot and its design are not "
            "known",
            path,
            key="--design",
            allowed="a run folder, a table in its exports/, or a table with --design DIR, the run "
            "folder that it was exported from",
        )
    return folder


def refuse_part_of_folder(path: Path) -> None:
    """Refuse the folder of the tables, and a file of a run folder that is not a table."""
    part = path.is_file() or (path.name == FOLDER and not (path / RUN_FILE).exists())
    if part and (path.parent / RUN_FILE).is_file():
        what = "the folder of the tables" if path.is_dir() else "a file other than a table"
        message = f"this is {what} of the run folder {short(path.parent)}"
        allowed = f"{short(path.parent)}, or a table in its {FOLDER}/"
        raise InputError(message, path, allowed=allowed)


def _design(robot: Robot, trajectory: FourierTrajectory) -> CertifiedPart:
    limits = recheck(LimitModel.of(robot), trajectory).limits
    return CertifiedPart("design", "one period of the design", PathCertificate(limits))


def _executable(
    record: ExportResult, trajectory: FourierTrajectory, robot: Robot
) -> ExecutableMotion | None:
    try:
        ways = record.motion.ways
        return None if ways is None else ways.motion(trajectory, robot.home)
    except ValueError:
        return None
