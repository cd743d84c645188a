"""What LinuxCNC's genhexkins has built in, and what it makes of axes and a lead.

Source: genhexkins.h, and StrutLengthCorrection in genhexkins.c.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.drive import Thread
from expdesign.configuration.geometry import StrutGeometry

BUILT_IN_JOINTS: dict[str, tuple[tuple[float, float], ...]] = {
    "base": (
        (-22.95, 13.25),
        (22.95, 13.25),
        (22.95, 13.25),
        (0, -26.5),
        (0, -26.5),
        (-22.95, 13.25),
    ),
    "platform": (
        (-1, 11.5),
        (1, 11.5),
        (10.459, -4.884),
        (9.459, -6.616),
        (-9.459, -6.616),
        (-10.459, -4.884),
    ),
}
"""x and y of the joints that genhexkins has where no line sets them; z is zero. Machine units."""

BUILT_IN_AXES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "base-n": (
        (0.707107, 0, 0.707107),
        (0, -0.707107, 0.707107),
        (-0.707107, 0, 0.707107),
        (-0.707107, 0, 0.707107),
        (0, 0.707107, 0.707107),
        (0.707107, 0, 0.707107),
    ),
    "platform-n": (
        (-1, 0, 0),
        (0.866025, 0.5, 0),
        (0.866025, 0.5, 0),
        (0.866025, -0.5, 0),
        (0.866025, -0.5, 0),
        (-1, 0, 0),
    ),
}
"""The axes of its joints, likewise."""


def hand(lead: float, base_axes: Array, platform_axes: Array, home: StrutGeometry) -> Thread | None:
    """Return the hand of the thread that it computes with, None where that is not the same for all.

    With axes of base and platform against each other a lead above zero is a right-handed thread,
    with both alike a left-handed one.

    Parameters
    ----------
    lead : float
        ``screw-lead``.
    base_axes, platform_axes : (6, 3)
        ``base-n``, ``platform-n``: base frame, platform frame.
    home : StrutGeometry
        Of the pose at which the axes are compared.
    """
    lower = np.cross(base_axes, home.directions)
    upper = np.cross(platform_axes @ home.rotation.T, home.directions)
    alike = np.sum(lower * upper, axis=1) * lead
    if np.all(alike < 0):
        return "right"
    return "left" if np.all(alike > 0) else None
