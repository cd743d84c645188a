"""Bodies and friction of a machine of which only size and mass are known.

The bodies: a disc for the platform, and in every strut two thin rods, the stator with its end at
the base joint, the slider with its end at the platform joint, and a ring as heavy as the slider.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.bodies import BodyDescription
from expdesign.configuration.geometry import rms_radius
from expdesign.machines.machine import round_digits
from expdesign.mechanism.hexapod import actuator_names

_STATOR, _SLIDER = 0.08, 0.04
"""Masses as shares of the moved mass."""
_ROD = 0.6
"""Length of a rod as a share of the strut's."""
_SLENDER = 0.04
"""Radius of a rod as a share of its length."""
_THICK = 0.2
"""Height of the disc as a share of its radius."""
_FRICTION = 0.05
"""Dry friction of an actuator as a share of the weight that it carries."""
_JOINT = 2e-3
"""Dry friction of a joint, N m, per N of that weight and m of the strut."""
_DIGITS = 4
_NOTHING = 1e-12


def assumed_bodies(mass: float, strut: float, joints: Array) -> dict[str, BodyDescription]:
    """Return assumed bodies: ring, stator, slider and platform.

    Parameters
    ----------
    mass : float
        Mass of the platform with its load, kg.
    strut : float
        Mean length of the struts at home, m.
    joints : (6, 3)
        Platform joints, platform frame, m.
    """
    rod = _ROD * strut
    across, along = rod**2 / 12, (_SLENDER * rod) ** 2 / 2
    centre = np.mean(joints, axis=0)
    radius = rms_radius(joints - centre)
    disc = radius**2 * np.array([1 / 4 + _THICK**2 / 12] * 2 + [1 / 2])
    # About a diameter the ring has as much as both rods about their axis.
    ring = (_STATOR + _SLIDER) / _SLIDER * along * np.array([1, 1, 2])
    return {
        "ring": _body(_SLIDER * mass, np.zeros(3), ring),
        "stator": _body(
            _STATOR * mass, np.array([0, 0, rod / 2]), np.array([across, across, along])
        ),
        "slider": _body(
            _SLIDER * mass, np.array([0, 0, -rod / 2]), np.array([across, across, along])
        ),
        "platform": _body(mass, centre, disc),
    }


def assumed_friction(strut: float, weight: float, speed: float) -> dict[str, float]:
    """Return the friction of joints and actuators, SI.

    Parameters
    ----------
    strut : float
        Mean length of the struts at home, m.
    weight : float
        Weight that one actuator carries, N.
    speed : float
        Speed at which viscous friction equals dry friction, m/s.
    """
    joint = _round_value(_JOINT * weight * strut)
    return {
        "r_alpha": joint,
        "r_beta": joint,
        **dict.fromkeys(actuator_names("r"), _round_value(_FRICTION * weight)),
        **dict.fromkeys(actuator_names("v"), _round_value(_FRICTION * weight / speed)),
    }


def _body(mass: float, centre: Array, per_mass: Array) -> BodyDescription:
    """Return a body from its inertia about its centre for 1 kg, m²."""
    return BodyDescription(
        mass=_round_value(mass),
        centre=tuple(_round_value(value) for value in centre),
        inertia=tuple(_round_value(mass * value) for value in per_mass),
    )


def _round_value(value: float) -> float:
    return round_digits(value, _DIGITS) if abs(value) > _NOTHING else 0.0
