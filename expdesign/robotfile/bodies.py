"""Nominal parameters of a machine of which little but its size and mass is known.

The bodies: a disc for the platform, and in every strut two thin rods, the stator with its end at
the base joint, the slider with its end at the platform joint. Equations of docs/model.md.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.geometry import rms_radius
from expdesign.mechanism.hexapod import ACTUATORS

_STATOR, _SLIDER = 0.08, 0.04
"""Masses as shares of the moved mass."""
_ROD = 0.6
"""Length of a rod as a share of the strut's."""
_SLENDER = 0.04
"""Radius of a rod as a share of its length."""
_THICK = 0.2
"""Height of the disc as a share of its radius."""
_FRICTION = 0.05
"""Dry friction of an actuator as a share of the weight that it bears."""
_JOINT = 2e-3
"""Dry friction of a joint, N m, per N of that weight and m of the strut."""


def assumed_parameters(
    mass: float, strut: float, joints: Array, weight: float, speed: float
) -> dict[str, float]:
    """Return p1 … p10, the lateral moments, and friction, SI.

    Parameters
    ----------
    mass : float
        Of the platform with what it carries, kg.
    strut : float
        Mean length of the struts at home, m.
    joints : (6, 3)
        Platform joints, platform frame, m.
    weight : float
        Borne by one actuator, N.
    speed : float
        At which viscous friction is as large as dry friction, m/s.
    """
    stator, slider, rod = _STATOR * mass, _SLIDER * mass, _ROD * strut
    across = (stator + slider) * rod**2 / 3
    along = (stator + slider) * (_SLENDER * rod) ** 2 / 2
    centre = np.mean(joints, axis=0)
    radius = rms_radius(joints - centre)
    disc = mass * radius**2 * np.array([1 / 4 + _THICK**2 / 12] * 2 + [1 / 2])
    # The disc's middle is that of the joints; about the TCP it and the sliders' masses have
    points = np.vstack([joints, centre])
    masses = np.array([slider] * ACTUATORS + [mass])
    squares = np.einsum("n,ni,nj->ij", masses, points, points)
    inertia = np.diag(disc) + np.trace(squares) * np.eye(3) - squares
    first = masses @ points
    found = {
        "p1": 2 * along,  # as much for the ring as for the rods
        "p2": across - along,
        "p3": across,
        "p4": stator * rod / 2,
        "p5": -slider * rod / 2,
        "p6": inertia[0, 0],
        "p7": inertia[1, 1],
        "p8": inertia[2, 2],
        "p9": first[2],
        "p10": mass + ACTUATORS * slider,
        "sx": first[0],
        "sy": first[1],
        "Ixy": inertia[0, 1],
        "Ixz": inertia[0, 2],
        "Iyz": inertia[1, 2],
        "r_alpha": _JOINT * weight * strut,
        "r_beta": _JOINT * weight * strut,
    }
    for j in range(1, ACTUATORS + 1):
        found |= {f"r{j}": _FRICTION * weight, f"v{j}": _FRICTION * weight / speed}
    return {name: float(value) for name, value in found.items()}
