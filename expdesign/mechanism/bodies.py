"""Rigid bodies, and the parameters p1 … p10 (with sx … Iyz) that those of a hexapod make.

Frames as of docs/model.md. The ring turns with its joint: origin in the cardan centre A, x the
first cardan axis and y the second. Stator (origin A) and slider (origin in the platform joint B)
turn with the strut: z along it from A to B, y the second cardan axis, x = y × z. The platform's
bodies are in the platform frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of the moments Ixx, Iyy, Izz, Ixy, Ixz, Iyz in an inertia matrix."""


def inertia_of(moments: Iterable[float]) -> Array:
    """Return the inertia, (3, 3), of its six entries; products as matrix entries."""
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(ENTRIES, moments, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def pseudo_inertia(mass: float, moment: Array, inertia: Array) -> Array:
    """Return [[Σ, s], [sᵀ, m]] with Σ = ½ tr(I) 1 − I = ∫ x xᵀ dm, (4, 4): kg m², kg m and kg.

    Positive semidefinite for every body of positive density, and only then (Wensing, Kim, Slotine,
    Linear Matrix Inequalities for Physically Consistent Inertial Parameter Identification, 2018).
    """
    found = np.empty((4, 4))
    with np.errstate(all="ignore"):
        found[:3, :3] = np.trace(inertia) / 2 * np.eye(3) - inertia
    found[:3, 3] = found[3, :3] = moment
    found[3, 3] = mass
    return found


def point_masses(points: Array) -> Array:
    """Return the pseudo-inertia, (4, 4), of a mass of one at each of the points, (n, 3)."""
    places = np.column_stack([points, np.ones(len(points))])
    return places.T @ places


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A body in some frame."""

    mass: float
    """kg."""
    moment: Array
    """(3,), first moment about the frame's origin, kg m."""
    inertia: Array
    """(3, 3), about the frame's origin; products as matrix entries, kg m²."""

    @classmethod
    def of(cls, mass: float, centre: Array, inertia: Array) -> RigidBody:
        """Return a body from its centre (3,), m, and its inertia (3, 3) about it, kg m²."""
        return cls(mass, mass * centre, inertia + mass * _about(centre))

    @classmethod
    def of_pseudo_inertia(cls, matrix: Array) -> RigidBody:
        """Return the body that has a pseudo-inertia, (4, 4)."""
        second = matrix[:3, :3]
        return cls(float(matrix[3, 3]), matrix[:3, 3], np.trace(second) * np.eye(3) - second)

    @property
    def pseudo_inertia(self) -> Array:
        """(4, 4), kg m², kg m and kg."""
        return pseudo_inertia(self.mass, self.moment, self.inertia)

    @property
    def about_centre(self) -> Array:
        """(3, 3), inertia about the centre of mass, kg m²."""
        if self.mass == 0:
            return self.inertia
        return self.inertia - _about(self.moment / np.sqrt(self.mass))

    def placed(self, rotation: Array, origin: Array) -> RigidBody:
        """Return the body in another frame, by rotation and origin, m, of this frame in it.

        The rotation (3, 3) takes vectors of this frame into the other one.
        """
        centre = self.moment / self.mass if self.mass else np.zeros(3)
        inertia = rotation @ self.about_centre @ rotation.T
        return RigidBody.of(self.mass, origin + rotation @ centre, inertia)


def _about(point: Array) -> Array:
    """Return the inertia about the origin of a mass of one at a point, (3, 3)."""
    return (point @ point) * np.eye(3) - np.outer(point, point)


def about_centre(values: Array) -> tuple[Array, Array]:
    """Return the centre of mass and the inertia about it, with their derivatives.

    Parameters
    ----------
    values : (10,)
        Mass, first moments x, y, z, and the inertia of `ENTRIES` about the frame's origin, SI.

    Returns
    -------
    derived : (9,)
        Centre x, y, z, m, then the inertia of `ENTRIES` about it, kg m².
    slope : (9, 10)
        Its derivatives with respect to the ten, for the delta method.

    Examples
    --------
    >>> values = np.array([2.0, 0.0, 0.0, 1.0, 3.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    >>> about_centre(values)[0].tolist()
    [0.0, 0.0, 0.5, 2.5, 2.5, 1.0, 0.0, 0.0, 0.0]
    """
    mass, moment = float(values[0]), values[1:4]
    centre = moment / mass
    inertia = RigidBody(1.0, centre, inertia_of(values[4:] / mass)).about_centre * mass
    slope = np.zeros((9, 10))
    slope[:3, 0] = -centre / mass
    slope[:3, 1:4] = np.eye(3) / mass
    by_moment = [
        -(2 * centre[k] * np.eye(3) - np.outer(axis, centre) - np.outer(centre, axis))
        for k, axis in enumerate(np.eye(3))
    ]
    by_mass = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    for row, (i, j) in enumerate(ENTRIES, start=3):
        slope[row, 0] = by_mass[i, j]
        slope[row, 1:4] = [each[i, j] for each in by_moment]
    slope[3:, 4:] = np.eye(6)
    derived = np.concatenate([centre, [inertia[i, j] for i, j in ENTRIES]])
    return derived, slope


def together(bodies: Iterable[RigidBody]) -> RigidBody:
    """Return bodies of one frame that move as one; nothing at all is a body without mass."""
    found = RigidBody(0.0, np.zeros(3), np.zeros((3, 3)))
    for body in bodies:
        found = RigidBody(
            found.mass + body.mass, found.moment + body.moment, found.inertia + body.inertia
        )
    return found


def strut_parameters(ring: RigidBody, stator: RigidBody, slider: RigidBody) -> dict[str, float]:
    """Return p1 … p5 of the bodies of a strut."""
    swinging = stator.inertia + slider.inertia
    along = swinging[2, 2]
    found = {
        "p1": ring.inertia[0, 0] + along,
        "p2": swinging[0, 0] - along,
        "p3": swinging[1, 1],
        "p4": stator.moment[2],
        "p5": slider.moment[2],
    }
    return {name: float(value) for name, value in found.items()}


def platform_parameters(platform: RigidBody, slider_mass: float, joints: Array) -> dict[str, float]:
    """Return p6 … p10 and sx … Iyz of the platform with all that is fixed to it.

    Parameters
    ----------
    slider_mass : float
        Of one slider, kg: it counts at its platform joint.
    joints : (6, 3)
        Platform joints, platform frame, m.
    """
    sliders = slider_mass * sum((_about(joint) for joint in joints), np.zeros((3, 3)))
    inertia = platform.inertia + sliders
    moment = platform.moment + slider_mass * np.sum(joints, axis=0)
    found = {
        "p6": inertia[0, 0],
        "p7": inertia[1, 1],
        "p8": inertia[2, 2],
        "p9": moment[2],
        "p10": platform.mass + ACTUATORS * slider_mass,
        "sx": moment[0],
        "sy": moment[1],
        "Ixy": inertia[0, 1],
        "Ixz": inertia[0, 2],
        "Iyz": inertia[1, 2],
    }
    return {name: float(value) for name, value in found.items()}


@dataclass(frozen=True, eq=False)
class MachineBodies:
    """Moving bodies: those of one strut (all six are equal) and the platform."""

    ring: RigidBody
    stator: RigidBody
    slider: RigidBody
    platform: RigidBody

    def parameters(self, joints: Array) -> dict[str, float]:
        """Return p1 … p10 and sx … Iyz; `joints`, (6, 3), are those of the platform."""
        struts = strut_parameters(self.ring, self.stator, self.slider)
        return struts | platform_parameters(self.platform, self.slider.mass, joints)
