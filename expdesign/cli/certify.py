"""Command `certify`: certificates of a run folder's design, lead-in and lead-out, and tables."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimation.uncertainty.forces import (
    by_actuator,
    force_limit_in_words,
    forces_along,
    worst_force,
)
from expdesign.cli.output import results, say, write_json
from expdesign.cli.runs import run_configuration, warn_of_changes
from expdesign.cli.terminal import working
from expdesign.configuration import (
    InputError,
    ResolvedRobot,
    RunConfiguration,
    load_run,
    quantity_text,
)
from expdesign.configuration.robot import load_robot_description
from expdesign.export.certification import BROKEN, IN_PART, PROVED, PathCertificate
from expdesign.export.result import FOLDER, RECORD, ExportResult
from expdesign.export.table_file import certify_file, find_table_file, unlisted_files
from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.planning import check_motion
from expdesign.progress import progress_prefix
from expdesign.recheck.certificate import recheck
from expdesign.recheck.limit_check import LimitCheck, range_share_in_words
from expdesign.robot import ForwardKinematicsError, LimitModel, Robot, robot_from
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.lock import consistent_reading
from expdesign.stages.execution import motion_workspaces, refuse_run_file
from expdesign.stages.stage import StageFailed, Workspace, short
from expdesign.trajectory import FourierTrajectory
from results.render.terminal import print_table
from results.views.view import ReportTable, TableColumn


def certify_motions(
    place: Path, design: Path | None, robot: str | None, *, piece: bool, as_json: bool
) -> None:
    """Certify the motions of a run folder, or one controller table or a piece of one.

    `robot` is the name or file of another robot that executes them.
    """
    path = place.absolute()
    refuse_part_of_folder(path)
    if not path.exists():
        refuse_run_file(place)
        message = "there is no such run folder or table"
        raise InputError(message, path, allowed="expdesign certify DIR | TABLE")
    if path.is_dir() and (design is not None or piece):
        key = "--part" if design is None else "--design"
        message = "a run folder has its design and whole tables"
        raise InputError(message, key=key, allowed=f"a table, or no {key}")
    folder = path
    if not path.is_dir():
        folder = folder_of_table(path) if design is None else design.absolute()
    configuration = run_configuration(folder)
    if robot is not None:
        configuration = _executed_by(configuration, load_robot_description(robot))
    with working("certify") as terminal, consistent_reading(folder):
        warn_of_changes(folder, "", "design", "export")
        work = Workspace(configuration, folder, terminal)
        if path.is_dir():
            parts = certified_motions(work)
        else:
            parts = [certified_table(work, path, piece=piece)]
    verdict = worst_verdict(parts)
    data = {
        "certified": verdict == PROVED,
        "verdict": verdict,
        "parts": [part.as_data() for part in parts],
    }
    if not as_json:
        _print_certificates(parts)
    if verdict != PROVED:
        left = "; ".join(_shortcoming(part) for part in parts if not part.proof.certified)
        raise StageFailed(f"{verdict}: {left}", data)
    if as_json:
        write_json({"status": 0, **data})
    else:
        rows = [
            f"{', '.join(part.proof.sampled)} of {part.name}"
            for part in parts
            if part.proof.sampled
        ]
        but = f"; {'; '.join(rows)} at the rows, all others" if rows else ""
        by = "" if robot is None else f" by {configuration.robot.name}"
        span = " of the piece" if piece else ""
        say(f"proved: every limit is kept{by}{but} at every instant{span}")


def _executed_by(configuration: RunConfiguration, robot: ResolvedRobot) -> RunConfiguration:
    """Return a run with another robot and its stated limits; the run's where it states none.

    A reserve does not count: it is kept free for differences of the machine.
    """
    own = {key: one for key, one in robot.limits.items() if not one.is_default}
    limits = {
        key: one.with_reserve(0.0) for key, one in {**configuration.robot.limits, **own}.items()
    }
    return replace(configuration, robot=replace(robot, limits=limits))


def _print_certificates(parts: list[CertifiedPart]) -> None:
    for part in parts:
        if part.proof.limits:
            print_table(results(), _certificate_table(part))
        if np.isfinite(part.proof.unproved_from):
            say(
                f"The strut lengths determine the pose up to {part.proof.unproved_from:.4f} s "
                "only: nothing is proved for this table."
            )
        for remark in part.proof.remarks:
            say(f"{part.name}: {remark}")


def _shortcoming(part: CertifiedPart) -> str:
    """Return what is wrong with a part, or not proved of it, in words."""
    proof = part.proof
    broken = ", ".join(check.key for check in proof.broken)
    not_proved = ", ".join(check.key for check in proof.open)
    found = [f"breaks {broken}"] if broken else []
    found += proof.faults
    found += [f"not proved: {not_proved}"] if not_proved else []
    return f"{part.name}: {'; '.join([*found, *proof.unchecked])}"


def _certificate_table(part: CertifiedPart) -> ReportTable:
    def left(check: LimitCheck) -> float | None:
        decided = check.key not in part.proof.sampled and np.isfinite(check.proved)
        return check.left if decided else None

    def remark(check: LimitCheck) -> str:
        if check.key not in part.proof.sampled:
            return "" if np.isfinite(check.proved) else "nothing is proved"
        if check in part.proof.broken:
            return f"at a row by {range_share_in_words(check.violation)}"
        return "judged at the rows only: undefined on straight lines"

    remarks = any(map(remark, part.proof.limits))
    columns = (
        TableColumn("limit", kind="text", of="key"),
        TableColumn("where", kind="text", of="row"),
        TableColumn("worst", kind="text", of=lambda one: quantity_text(one.value, one.unit, 5)),
        TableColumn("bound", kind="text", of=lambda one: quantity_text(one.bound, one.unit, 5)),
        TableColumn("left", "%", digits=3, of=left, factor=100, proof=True),
        *([TableColumn("proved", kind="text", of=remark)] if remarks else []),
        TableColumn("cells", of="cells"),
        TableColumn("open", "s", digits=2, of=lambda one: one.open_time or None),
    )
    caption = f"{part.name}: {part.title}"
    return ReportTable.of(part.name, caption, columns, part.proof.limits, screen=True)


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


def certified_motions(work: Workspace) -> list[CertifiedPart]:
    """Certify a run folder, or those of its several motions."""
    if len(work.motion_folders) == 1:
        return certified_folder(work)
    return [
        replace(part, name=f"{place.folder.name}/{part.name}")
        for place in motion_workspaces(work)
        for part in certified_folder(place)
    ]


def certified_folder(work: Workspace) -> list[CertifiedPart]:
    """Return the certificates of a run folder's design, of its lead-in and lead-out, and tables.

    Lead-in and lead-out are those of exports.json; they keep `motion.jerk` as well.
    """
    if not work.design_file.exists():
        message = f"there is no {work.design_file.name}"
        raise InputError(message, work.folder, allowed="a folder that `expdesign design` wrote")
    robot = robot_from(work.configuration.robot)
    trajectory = work.design().trajectory
    with progress_prefix("design"):
        found = [_design(robot, trajectory)]
    place = work.folder / FOLDER
    result = ExportResult.known(place / RECORD)
    tables, others = unlisted_files(place, result)
    left = [_left_out(name, "a table without a description", _UNLISTED) for name in tables]
    if others:
        work.progress.note(f"in {FOLDER}/ and not examined: {', '.join(others)}")
    title = "the motion from rest to rest"
    if result is None and (place / RECORD).exists():
        found.append(_left_out("motion", title, f"{RECORD} is damaged"))
        return found + left
    if result is None:
        work.progress.note("no table was exported, and therefore no lead-in and lead-out planned")
        return found + left
    motion = _executable(result, trajectory, robot)
    if motion is None:
        found.append(_left_out("motion", title, f"{RECORD} has those of another design"))
    else:
        with progress_prefix("lead-in and lead-out"):
            limits = check_motion(work.configuration, motion).limits
        remarks = _force_remarks(robot, motion, motion.duration, trajectory.period)
        found.append(CertifiedPart("motion", title, PathCertificate(limits, remarks=remarks)))
    planned = load_run(work.folder / RUN_FILE).robot
    moved = any(
        not np.array_equal(getattr(planned, name), getattr(robot.description, name))
        for name in ("base_joints", "platform_joints")
    )
    if moved and result.files:
        work.progress.note(
            f"not examined: {', '.join(result.files)}; {robot.name} has other joints than the "
            "robot that the tables were made for, and follows their lengths on another path"
        )
    for name, table in {} if moved else result.files.items():
        try:
            found.append(certified_table(work, place / name))
        except InputError as error:
            reason = "; ".join(problem.message for problem in error.problems)
            found.append(_left_out(name, table.title, reason))
    return found + left


_UNLISTED = f"not examined, since {RECORD} does not describe it"


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
    remarks = _force_remarks(robot, trajectory, trajectory.period, trajectory.period)
    proof = PathCertificate(limits, remarks=remarks)
    return CertifiedPart("design", "one period of the design", proof)


_INSTANTS = 400
"""Of one period."""


def _force_remarks(
    robot: Robot, motion: FourierTrajectory | ExecutableMotion, duration: float, period: float
) -> tuple[str, ...]:
    """Compare forces and their uncertainty with the limit, at instants: no proof."""
    known = robot.description.description.identification
    if known is None:
        return ()
    times = np.arange(0.0, duration, period / _INSTANTS)
    states = np.concatenate(motion.sample(times), axis=1)
    row = worst_force(by_actuator(forces_along(robot, known, times, states), robot))
    if row is None:
        return ()
    words = f"force by the identified parameters, {force_limit_in_words(row)}"
    return (f"{words}, at {len(times)} instants",)


def _executable(
    result: ExportResult, trajectory: FourierTrajectory, robot: Robot
) -> ExecutableMotion | None:
    try:
        leads = result.motion.leads
        return None if leads is None else leads.motion(trajectory, robot.home)
    except ValueError:
        return None
