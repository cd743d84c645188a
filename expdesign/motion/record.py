"""An executable motion as data: the ramps that were found, so that no search has to find them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.periods import PERIODS, Periods
from expdesign.motion.spline import FIXED, SplineRamp
from expdesign.trajectory import FourierTrajectory, PoseSamples

_LEAST_POINTS = 2 * FIXED
_COORDINATES = 6
_JUNCTION = 1e-9
"""m, rad, and per s and s²: by how much parts of one motion may differ where they meet."""


def motion_to_record(motion: ExecutableMotion) -> dict[str, Any] | None:
    """Return phase, periods and ramps with all digits; None for ramps of another kind."""
    ramps = [segment for segment in motion.segments if segment.name != PERIODS]
    recorded = [
        {
            "name": ramp.name,
            "duration": ramp.duration,
            "control_points": ramp.coefficients.tolist(),
        }
        for ramp in ramps
        if isinstance(ramp, SplineRamp)
    ]
    if len(recorded) != len(ramps):
        return None
    return {"phase": motion.phase, "periods": motion.periods, "ramps": recorded}


def motion_from_record(
    record: Mapping[str, Any], trajectory: FourierTrajectory
) -> ExecutableMotion:
    """Return the motion of a record, the same to the last digit.

    Parameters
    ----------
    record : dict
        As `motion_to_record` makes it.
    trajectory : FourierTrajectory
        The designed motion that the periods repeat.

    Raises
    ------
    ValueError
        It is no such record, or its ramps do not lead into this trajectory and back.
    """
    try:
        phase, periods = float(record["phase"]), int(record["periods"])
        first, last = (_ramp(ramp) for ramp in record["ramps"])
    except (KeyError, TypeError, OverflowError) as error:
        raise ValueError(f"no ramps of a motion: {error}") from error
    if not (0 <= phase <= trajectory.period and periods >= 1):
        raise ValueError(f"{periods} periods from {phase} s on")
    orbit = trajectory.sample(phase)
    ends = (first.sample(np.array([first.duration])), last.sample(np.zeros(1)))
    if not all(_meet(orbit, end) for end in ends):
        raise ValueError("the ramps do not lead into the designed motion and back")
    return ExecutableMotion(
        (first, Periods(trajectory, periods, phase), last), trajectory, periods, phase
    )


def _ramp(record: Mapping[str, Any]) -> SplineRamp:
    duration, points = float(record["duration"]), np.array(record["control_points"], dtype=float)
    if points.ndim != 2 or points.shape[1] != _COORDINATES or len(points) < _LEAST_POINTS:  # noqa: PLR2004 - rows and columns
        raise ValueError(f"control points of the shape {points.shape}, not (N, 6)")
    if not (np.all(np.isfinite(points)) and 0 < duration < np.inf):
        raise ValueError("a ramp with numbers that are not finite")
    return SplineRamp(str(record["name"]), duration, points)


def _meet(one: PoseSamples, other: PoseSamples) -> bool:
    return all(
        np.allclose(getattr(one, part), getattr(other, part), rtol=_JUNCTION, atol=_JUNCTION)
        for part in ("pose", "rate", "acceleration")
    )
