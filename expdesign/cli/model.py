"""Command `model`: the control model of a robot, written, tested where possible, and described."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from pydantic_core import PydanticCustomError

from estimation.controlmodel import FOLDER
from estimation.controlmodel.formats import FORMATS, ControlModelFile
from estimation.controlmodel.model import (
    UNCERTAINTY,
    VECTORS,
    ControlModel,
    Origin,
)
from estimation.identification.result import EstimateFile
from estimation.uncertainty.forces import (
    by_actuator,
    force_uncertainty,
    force_warning,
)
from expdesign.cli.output import note, results, write_json
from expdesign.cli.runs import warn_of_changes
from expdesign.cli.terminal import working
from expdesign.configuration import InputError
from expdesign.configuration.quantity import SPEED
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as IDENTIFIED
from expdesign.configuration.tolerances import Identification
from expdesign.library import robot_files
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.progress import report_progress
from expdesign.robot import Robot, load_robot
from expdesign.robot.deviation import FORCE_CONSTANT, estimated_constants
from expdesign.runfolder.files import atomic_write
from expdesign.runfolder.lock import one_writer_to
from expdesign.runfolder.manifest import Manifest, file_hash, package_versions
from expdesign.stages.execution import record_added, refuse_unwritable
from expdesign.stages.stage import Progress, short
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from results.render.terminal import print_view
from results.views.export import control_models_view

_ESTIMATE = "estimate"
_SAME_UNIT = 1e-6
"""Share of the forces up to which the drive's newton is one."""
_WITHIN = 2.0
"""Largest usual error, in standard deviations of the tolerance."""


def write_model(source: str, name: str, out: Path | None, width: str, *, as_json: bool) -> None:
    """Write the control model of a run folder's estimate, or of a robot; test it where possible.

    The source is a run folder with an estimate, a robot file, or the name of a robot that ships;
    the model goes to ``model/<format>`` of the folder, or of ``runs/<robot>``, unless `out` is
    given. The width is that of the sign of dry friction, such as ``"2 mm/s"``.
    """
    speed = _speed(width)
    if name not in FORMATS:
        message = f"there is no format '{name}'" if name else "no format is given"
        raise InputError(message, key="--format", allowed=" | ".join(FORMATS))
    folder = Path(source).resolve() if Path(source).is_dir() else None
    if folder is not None and source in robot_files():
        # A folder without an estimate does not hide the robot.
        folder = folder if (folder / IDENTIFIED).is_file() else None
        used, other = ("robot", "folder") if folder is None else ("folder", "robot")
        note(f"the {used} {source} is used, not the {other} of that name")
    robot_file = source if folder is None else _identified(folder)
    place = Path("runs") / load_robot(robot_file).name if folder is None else folder
    target = (place / FOLDER / name if out is None else out).absolute()
    refuse_unwritable(target)
    target = target if out is None else target.resolve()
    with (
        working("model") as progress,
        one_writer_to(target, "expdesign model", folder) as reading,
    ):
        with reading:
            if folder is not None:
                warn_of_changes(folder, "", "estimate", "design")
            model, motion = _control_model(load_robot(robot_file), folder, speed, progress)
        result = _written_model(model, motion, name, target, progress)
        if folder is not None and target.is_relative_to(folder):
            places = [target / file for file in (*result.files, result.FILE)]
            sources = (folder / name for name in (IDENTIFIED, TrajectoryFile.FILE))
            made_from = {one.name: file_hash(one) for one in sources if one.is_file()}
            record_added(folder, places, {places[-1]: made_from})
    if as_json:
        write_json({"status": 0, "folder": str(target), **result.as_data()})
    else:
        shown_as = short(target)
        print_view(control_models_view({shown_as: result}), results(), shown_as)


def _speed(text: str) -> float:
    allowed = 'zero and more, such as "2 mm/s"'
    try:
        speed = SPEED.parse(text)
    except PydanticCustomError as error:
        allowed = (error.context or {}).get("allowed", allowed)
        raise InputError(error.message(), key="--smoothing", allowed=allowed) from None
    if speed < 0:
        raise InputError(f"{text} is negative", key="--smoothing", allowed=allowed)
    return speed


def _control_model(
    robot: Robot, folder: Path | None, width: float, progress: Progress
) -> tuple[ControlModel, str]:
    """Return the control model, with its doubts reported, and the motion of its uncertainty."""
    known, path = robot.description.description.identification, robot.description.source
    if path is None:
        raise InputError("a robot without a file has no control model", key="DIR")
    report_progress("uncertainty of the forces")
    motion, trajectory = ("", None) if folder is None else _motion(folder)
    uncertainty = None
    if known is not None and trajectory is not None:
        uncertainty = force_uncertainty(robot, known, trajectory)
    model = ControlModel(robot, _origin(path, known, folder), width, uncertainty)
    if known is None:
        progress.note(
            f"{robot.name} does not come from an estimate: the model has nominal parameters"
        )
    else:
        for warning in _doubts(model, known, short(path)):
            progress.warn(warning)
        _report_force_unit(known, progress)
    if uncertainty is not None and (warning := force_warning(by_actuator(uncertainty, robot))):
        progress.warn(warning)
    return model, "" if uncertainty is None else motion


def _written_model(
    model: ControlModel, motion: str, name: str, target: Path, progress: Progress
) -> ControlModelFile:
    """Write a control model into a folder; return its description."""
    report_progress(f"writing and testing {name}")
    with TemporaryDirectory(prefix="expdesign-model-") as place_to_work:
        made = FORMATS[name].make(model, Path(place_to_work))
    if made.untested:
        progress.warn(made.untested)
    (target / ControlModelFile.FILE).unlink(missing_ok=True)
    files = []
    for file_name, content in made.files.items():
        with atomic_write(target / file_name) as file:
            file.write_bytes(content)
        files.append(target / file_name)
    files += VECTORS.write(target, model.vectors)
    uncertainty = model.uncertainty
    if uncertainty is not None:
        files += UNCERTAINTY.write(target, uncertainty)
    result = ControlModelFile(
        model_format=name,
        title=FORMATS[name].title,
        robot=model.robot.name,
        prefix=model.prefix,
        origin=model.origin,
        sign_width=model.width,
        torque_per_force=model.torque_per_force,
        files={each.name: file_hash(each) for each in dict.fromkeys(files)},
        tests=made.tests,
        untested=made.untested,
        uncertainty=() if uncertainty is None else by_actuator(uncertainty, model.robot),
        motion=motion,
        doubts=model.doubts,
    )
    result.write(target)  # last: it says that all else is there
    return result


def _identified(folder: Path) -> Path:
    """Return the robot file of a run folder's estimate."""
    path = folder / IDENTIFIED
    if not path.is_file():
        raise InputError(
            f"there is no estimate: {IDENTIFIED} is missing",
            folder,
            key="DIR",
            allowed="a run folder in which `expdesign estimate` was done, a robot file, or the "
            "name of a robot that ships",
        )
    return path


def _motion(folder: Path) -> tuple[str, FourierTrajectory | None]:
    """Return the motion of the uncertainty: the folder's design, else the estimated motion."""
    if (folder / TrajectoryFile.FILE).is_file():
        return "the design", TrajectoryFile.read(folder).trajectory
    if (folder / EstimateFile.FILE).is_file():
        motions = EstimateFile.read(folder).best_estimator.motions
        if motions:
            return "the motion of the recording, as it was estimated", motions[0].trajectory
    return "", None


def _report_force_unit(known: Identification, progress: Progress) -> None:
    """Report corrected force constants; a warning only if they are beyond their tolerances."""
    constants = [one for one in known.deviations if one.name.startswith(FORCE_CONSTANT)]
    common = sum(one.value for one in constants if one.name == FORCE_CONSTANT)
    own = {one.name: one.value for one in constants}
    shares = [common + own.get(name, 0.0) for name in actuator_names(f"{FORCE_CONSTANT}_")]
    if all(abs(share) <= _SAME_UNIT for share in shares):
        return
    beyond = any(abs(one.value) > _WITHIN * one.tolerance for one in constants)
    errors = ", ".join(f"{100 * share:+.2g} %" for share in shares)
    report = progress.warn if beyond else progress.note
    report(
        f"the estimate has corrected the force constants, {'beyond' if beyond else 'within'} their "
        "tolerances: the model's forces are true newtons, and the drive's newtons are off by "
        f"{errors} (actuators 1 to {ACTUATORS})"
    )


def _origin(path: Path, known: Identification | None, folder: Path | None) -> Origin:
    manifest = None if folder is None else Manifest.known(folder)
    entry = None if manifest is None else manifest.stages.get(_ESTIMATE)
    about = {"file": path.name, "sha256": file_hash(path)}
    about |= {"version": package_versions()["expdesign"], "made": entry.finished if entry else ""}
    if known is None:
        return Origin(**about)
    return Origin(run=known.run, estimator=known.estimator, verdict=known.verdict, **about)


def _doubts(model: ControlModel, known: Identification, file: str) -> Iterator[str]:
    """Yield doubts about an identified model."""
    estimated = [one.name for one in estimated_constants(model.robot)]
    lacking = [name for name in estimated if name not in known.constants]
    if model.uncertainty is not None and lacking:
        yield (
            f"{file} lacks the covariance of the parameters with {', '.join(lacking)} "
            "(identification.constants): they were not estimated together. The standard deviations "
            "of the forces count the parameters alone, and are usually too large. Estimate again"
        )
    yield from known.warnings
    yield from model.doubts
