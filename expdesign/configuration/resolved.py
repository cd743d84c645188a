"""What a robot and a run are once everything is known: arrays in SI units, no open defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration.robot_section import RobotDescription
from expdesign.configuration.run_section import RunDescription
from expdesign.mechanism.term import Term


def read_only(values: object) -> Array:
    """Return a copy of the values as an array of floats that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class ResolvedNoise:
    """Covariances of one sample of the six actuators.

    Attributes
    ----------
    force_covariance : (6, 6) or None
        N²; symmetric positive definite.
    length_covariance : (6, 6) or None
        m²; symmetric positive definite.
    """

    force_covariance: Array | None
    length_covariance: Array | None


@dataclass(frozen=True, eq=False)
class ResolvedRobot:
    """A hexapod, ready to be computed with. The arrays are read-only.

    Attributes
    ----------
    name : str
    description : RobotDescription
        The same robot as it could stand in a file: SI units, every default, this run's limits
        and noise.
    home : (6,)
        x, y, z [m], phi, theta, psi [rad].
    gravity : (3,)
        Base frame, m/s².
    base_joints, platform_joints : (6, 3)
        Base frame and platform frame, m.
    alpha_axes : (6, 3)
        First cardan axes, unit vectors in the base frame.
    platform_joint_axes : (6, 3)
        Reference axes of the platform joints, unit vectors in the platform frame.
    platform : {"symmetric", "general"}
    terms : tuple of Term
        Blocks of the regressor.
    constants : tuple of float
        Of the terms in their order, SI.
    parameters : dict
        Nominal values by name, SI, in the order of the terms.
    noise : ResolvedNoise or None
        None when neither robot nor run state any.
    limits : dict of Limit
        By key, in the order of the limits' catalogue. A limit that is missing does not limit.
    characteristic_length : float
        By which rotations are scaled in condition numbers, m.
    source : Path or None
    warnings : tuple of str
        What is legal but odd.
    """

    name: str
    description: RobotDescription
    home: Array
    gravity: Array
    base_joints: Array
    platform_joints: Array
    alpha_axes: Array
    platform_joint_axes: Array
    platform: str
    terms: tuple[Term, ...]
    constants: tuple[float, ...]
    parameters: Mapping[str, float]
    noise: ResolvedNoise | None
    limits: Mapping[str, Limit]
    characteristic_length: float
    source: Path | None = None
    warnings: tuple[str, ...] = ()

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in their order."""
        return tuple(self.parameters)


@dataclass(frozen=True, eq=False)
class RunConfiguration:
    """A run with its robot, every default filled in.

    Attributes
    ----------
    run : RunDescription
        Its `robot` is the resolved robot's description with the run's own limits and noise in
        it, its own `limits` and `noise` are therefore empty; paths are absolute.
    robot : ResolvedRobot
    file : Path or None
        The run file; None for a mapping.
    warnings : tuple of str
        Those of the robot and those of the run.
    """

    run: RunDescription
    robot: ResolvedRobot
    file: Path | None = None
    warnings: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.name

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that the run names, in the order in which they are done."""
        return self.run.stages
