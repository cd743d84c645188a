"""The motion that the tables of a run folder hold: searched once, then taken from its record."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from expdesign.cli.errors import CommandFailed
from expdesign.cli.export_files import FOLDER
from expdesign.cli.output import note, short

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from expdesign.configuration import RunConfiguration
    from expdesign.export import Task
    from expdesign.motion import ExecutableMotion
    from expdesign.trajectory import FourierTrajectory


def folder_motion(folder: Path) -> str:
    """Return what the tables of a run folder are made from: the coefficients of its design."""
    return _digits(_trajectory(folder))


def export_task(configuration: RunConfiguration, folder: Path) -> Task:
    """Return what is exported: the design of a run folder with its ways from and to rest.

    The ways that the folder's tables have are taken when they were made from the same
    configuration, design and versions.

    Raises
    ------
    InputError
        The design is missing or none.
    CommandFailed
        The machine cannot get into the motion.
    """
    from expdesign.experiment.design import judged_parameters
    from expdesign.export import Task
    from expdesign.robot import robot_from

    run = configuration.run
    robot = robot_from(configuration.robot)
    noise = configuration.robot.noise
    trajectory = _trajectory(folder)
    made_from = _made_from(configuration, trajectory)
    motion = _known_motion(folder, made_from, trajectory, robot.home)
    if motion is None or motion.periods != run.experiment.periods:
        motion = _found_motion(configuration, trajectory)
    else:
        note(f"the ways from rest into the motion and back are those of {short(_record(folder))}")
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
    from expdesign.runfolder.manifest import Manifest, text_hash

    sections = configuration.run.model_dump_json(
        include={
            "robot": True,
            "motion": True,
            "trajectory": {"controller_period"},
            "experiment": {"periods", "sampling"},
        }
    )
    versions = sorted(Manifest.new({}).versions.items())
    return text_hash("executable motion", sections, _digits(trajectory), versions)


def _known_motion(
    folder: Path, made_from: str, trajectory: FourierTrajectory, home: NDArray[np.float64]
) -> ExecutableMotion | None:
    from expdesign.export import read_record
    from expdesign.motion import motion_from_record

    motion = read_record(_record(folder)).get("motion", {})
    if motion.get("made_from") != made_from or motion.get("ways") is None:
        return None
    try:
        return motion_from_record(motion["ways"], trajectory, home)
    except ValueError:
        return None


def _record(folder: Path) -> Path:
    from expdesign.export import RECORD

    return folder / FOLDER / RECORD


def _found_motion(
    configuration: RunConfiguration, trajectory: FourierTrajectory
) -> ExecutableMotion:
    from expdesign.motion import NoRampError, executable_motion

    note("looking for the ways from rest into the motion and back")
    try:
        return executable_motion(configuration, trajectory)
    except NoRampError as error:
        raise CommandFailed(str(error)) from error


def _trajectory(folder: Path) -> FourierTrajectory:
    from expdesign.trajectory import TrajectoryFile

    return TrajectoryFile.read(folder).trajectory


def _digits(trajectory: FourierTrajectory) -> str:
    return " ".join(value.hex() for value in trajectory.vector().tolist())
