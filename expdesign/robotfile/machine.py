"""What is known of a machine before it has a robot file, by whomever or whatever told it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from expdesign.configuration.bodies import Bodies
from expdesign.configuration.drive import Drive
from expdesign.configuration.joint_ring import JointRing

Points = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Question:
    """What the user has to look up, or to confirm."""

    key: str
    """Key of the robot file beside which it stands: ``home``, ``limits.strut_length``; empty for
    one about the machine as a whole."""
    text: str
    """A sentence."""


@dataclass(frozen=True)
class Machine:
    """A hexapod as far as it is known, SI units and radians; None, or no entry: not known."""

    name: str
    """Of the robot, and of both files: as of `values.scalars.Name`."""
    source: str = ""
    """Where the numbers come from, for the robot file's `description`."""
    base_joints: JointRing | Points | None = None
    """(6, 3), base frame, m."""
    platform_joints: JointRing | Points | None = None
    """(6, 3), platform frame, m."""
    home: tuple[float, ...] | None = None
    """(6,): x, y, z [m], phi, theta, psi [rad]."""
    gravity: tuple[float, ...] | None = None
    """(3,), base frame, m/s²."""
    alpha_axes: Points | None = None
    """(6, 3), first cardan axes, base frame."""
    platform_joint_axes: Points | None = None
    """(6, 3), platform frame."""
    limits: Mapping[str, Any] = field(default_factory=dict)
    """By key, as under `limits:` of a robot file: a number, a pair, six of these, or a mapping of
    components."""
    moved_mass: float | None = None
    """Of the platform with everything on it, without the struts, kg."""
    bodies: Bodies | None = None
    """Those that are known."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Nominal values that are known, by name; they count before the bodies."""
    platform_cardan_axes: Points | None = None
    """(6, 3), platform frame, of joints that turn the screws."""
    drive: Drive | None = None
    force_std: tuple[float, ...] | None = None
    """(6,), of one sample, N."""
    length_std: tuple[float, ...] | None = None
    """(6,), of one sample, m."""
    questions: tuple[Question, ...] = ()
    """Beside those that follow from what is not known."""
