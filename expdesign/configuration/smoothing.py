"""Widths of the smoothed friction sign where a run gives none: shares of the speed limit.

What counts as slow depends on the machine: a width that suits struts of 2 m/s would hide the
friction of one that moves at 0.5 mm/s altogether.
"""

from __future__ import annotations

import numpy as np

from expdesign.configuration.resolved import ResolvedRobot

SHARES = (0.2, 0.1, 0.05)
"""Of the largest strut speed that the limits allow."""

WITHOUT_LIMIT = (0.4, 0.2, 0.1)
"""m/s, where nothing limits the strut speed."""


def smoothing_widths(robot: ResolvedRobot) -> tuple[float, ...]:
    """Return falling widths of the smoothed friction sign, m/s."""
    limit = robot.limits.get("strut_speed")
    if limit is None:
        return WITHOUT_LIMIT
    fastest = float(np.max(np.abs([limit.lower, limit.upper])))
    # Six digits: the numbers are printed, and copied by people.
    return tuple(float(f"{share * fastest:.6g}") for share in SHARES)
