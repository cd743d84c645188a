"""Command `certify`: certificates of a run folder's design, lead-in and lead-out, and tables."""

from __future__ import annotations

from collections.abc import Callable
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
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.export.certification import BROKEN, IN_PART, PROVED, PathCertificate
from expdesign.export.definition import round_up
from expdesign.export.result import FOLDER, RECORD, ExportResult
from expdesign.export.table_file import certify_file, find_table_file, unlisted_files
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.motion.executable import ExecutableMotion, Periods, Segment, enclose_segment
from expdesign.motion.planning import check_motion
from expdesign.progress import progress_prefix
from expdesign.recheck.certificate import EnclosedMotion, recheck
from expdesign.recheck.followed_lengths import FollowedLengths
from expdesign.recheck.followed_path import certify_followed
from expdesign.recheck.limit_check import LimitCheck, Motion, range_share_in_words
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
    configuration = planned = run_configuration(folder)
    if robot is not None:
        configuration = _executed_by(configuration, load_robot_description(robot))
    with working("certify") as terminal, consistent_reading(folder):
        warn_of_changes(folder, "", "design", "export")
        work = Workspace(configuration, folder, terminal)
        if path.is_dir():
            parts = certified_motions(work)
        else:
            parts = [certified_table(work, path, piece=piece)]
    verdict = max((part.proof.verdict for part in parts), key=(PROVED, IN_PART, BROKEN).index)
    data = {
        "certified": verdict == PROVED,
        "verdict": verdict,
        "parts": [part.as_data() for part in parts],
    }
    if not as_json:
        _print_certificates(parts)
    if verdict != PROVED:
        left = "; ".join(_shortcoming(part) for part in parts if not part.proof.certified)
        advice = ""
        if robot is not None:
            machines = robot_from(planned.robot), robot_from(configuration.robot)
            advice = _advice(parts, planned.robot, robot, moved=_follower(*machines) is not None)
        raise StageFailed(f"{verdict}: {left}{advice}", data)
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


_ROOM = 1.5
"""Advised reserve, relative to the excess: another motion has another one."""
_LARGEST_RESERVE = 0.5


def _advice(parts: list[CertifiedPart], planned: ResolvedRobot, robot: str, *, moved: bool) -> str:
    """Return the reserves that leave room for the difference of a machine, as a sentence.

    `moved` machines have other joints or zeros than the controller knows.
    """
    shares: dict[str, float] = {}
    for check in (check for part in parts for check in part.proof.broken):
        own = planned.limits.get(check.key)
        share = _ROOM * (check.violation + (0.0 if own is None else own.reserve))
        shares[check.key] = max(share, shares.get(check.key, 0.0))
    again = f"design with `robot: {robot}`"
    if not shares or max(shares.values()) >= _LARGEST_RESERVE:
        return f". What to do: {again}" if shares else ""
    known = ", if the controller gets the joints of the identified machine" if moved else ""
    texts = (f"{key}: {round_up(100 * share):g} %" for key, share in shares.items())
    return (
        ". What to do: keep that much free and design again, `limits: {reserve: {"
        f"{', '.join(texts)}}}}}` in the run file; or{known}, {again}"
    )


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
    robot, trajectory = robot_from(work.configuration.robot), work.design().trajectory
    planned = load_run(work.folder / RUN_FILE)
    controller = robot_from(planned.robot)
    follow = _follower(controller, robot)
    with progress_prefix("design"):
        found = [_design(robot, trajectory, follow)]
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
    motion = result.motion.executable(trajectory, controller.home)
    if motion is None:
        found.append(_left_out("motion", title, f"{RECORD} has those of another design"))
    else:
        with progress_prefix("lead-in and lead-out"):
            limits = _check_motion(work.configuration, planned, motion, follow)
        driven = motion if follow is None else follow(motion)
        remarks = _force_remarks(robot, driven, motion.duration, trajectory.period)
        found.append(CertifiedPart("motion", title, PathCertificate(limits, remarks=remarks)))
    if follow is not None:
        work.progress.note(
            f"{robot.name} has other joints or zeros than {controller.name}, with which the "
            "controller computes the lengths of the struts: their speeds and accelerations are "
            "those commanded, the platform takes another path, and its limits and the forces are "
            "examined there"
        )
        if result.files:
            work.progress.note(
                f"not examined: {', '.join(result.files)}: their rows are these lengths within "
                "the tolerance of a table, which `expdesign certify DIR` examines"
            )
    for name, table in {} if follow is not None else result.files.items():
        try:
            found.append(certified_table(work, place / name))
        except InputError as error:
            reason = "; ".join(problem.message for problem in error.problems)
            found.append(_left_out(name, table.title, reason))
    return found + left


_UNLISTED = f"not examined, since {RECORD} does not describe it"


def _left_out(name: str, title: str, reason: str) -> CertifiedPart:
    return CertifiedPart(name, title, PathCertificate((), unchecked=(reason,)))


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


_Follow = Callable[[Motion], FollowedLengths]


def _follower(controller: Robot, machine: Robot) -> _Follow | None:
    """Return the function from a motion of the controller to that of a machine; None: the same.

    The machine has other joints, or other zeros of its lengths by its identification.
    """
    known, zeros = machine.description.description.identification, np.zeros(ACTUATORS)
    if known is not None:
        # A later entry of a name is the error of a prior.
        estimated = {one.name: one.value for one in reversed(known.deviations)}
        names = actuator_names("strut_length_")
        zeros = np.array([estimated.get(name, 0.0) for name in names])
    same = not np.any(zeros) and all(
        np.array_equal(getattr(controller.description, name), getattr(machine.description, name))
        for name in ("base_joints", "platform_joints")
    )
    return None if same else lambda motion: FollowedLengths(motion, controller, machine, zeros)


def _check_motion(
    configuration: RunConfiguration,
    planned: RunConfiguration,
    motion: ExecutableMotion,
    follow: _Follow | None,
) -> tuple[LimitCheck, ...]:
    if follow is None:
        return check_motion(configuration, motion).limits
    machine = robot_from(configuration.robot)

    def judge(limits: LimitModel, segment: Segment) -> tuple[LimitCheck, ...]:
        # The jerk is commanded. Of the periods the enclosure has the first, from the orbit's t = 0.
        own = LimitModel.of(machine, limits.limits[-1])
        commanded = segment.trajectory if isinstance(segment, Periods) else segment
        return _followed_limits(own, follow(commanded), enclose_segment(segment))

    return check_motion(planned, motion, judge).limits


def _followed_limits(
    limits: LimitModel, followed: FollowedLengths, enclosed: EnclosedMotion
) -> tuple[LimitCheck, ...]:
    try:
        return certify_followed(limits, followed, enclosed)
    except ForwardKinematicsError as trouble:
        name = followed.machine.name
        raise StageFailed(f"{name} cannot follow the lengths of the motion: {trouble}") from trouble


def _design(robot: Robot, trajectory: FourierTrajectory, follow: _Follow | None) -> CertifiedPart:
    model, driven = LimitModel.of(robot), trajectory if follow is None else follow(trajectory)
    if isinstance(driven, FollowedLengths):
        limits = _followed_limits(model, driven, EnclosedSeries(trajectory))
    else:
        limits = recheck(model, trajectory).limits
    remarks = _force_remarks(robot, driven, trajectory.period, trajectory.period)
    proof = PathCertificate(limits, remarks=remarks)
    return CertifiedPart("design", "one period of the design", proof)


_INSTANTS = 400
"""Of one period."""


def _force_remarks(robot: Robot, motion: Motion, duration: float, period: float) -> tuple[str, ...]:
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
