"""An executable motion as data: the ramps that were found, so that no search has to find them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.executable import PERIODS, ExecutableMotion, Periods
from expdesign.motion.spline import FIXED, MotionState, SplineRamp
from expdesign.trajectory import FourierTrajectory

_LEAST_POINTS = 2 * FIXED
_MOST_PERIODS = 1_000_000
_JUNCTION = 1e-9
"""m, rad, and per s and s²: by how much parts of one motion may differ where they meet.

For ramps of less than a second: per ramp, since a short one turns the last digits of its control
points into more speed.
"""


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
    record: Mapping[str, Any], trajectory: FourierTrajectory, home: Array
) -> ExecutableMotion:
    """Return the motion of a record, the same to the last digit.

    Parameters
    ----------
    record : dict
        As `motion_to_record` makes it.
    trajectory : FourierTrajectory
        The designed motion that the periods repeat.
    home : (6,)
        Pose at which the motion begins and ends at rest: m, rad.

    Raises
    ------
    ValueError
        It is no such record, or its ramps do not lead from rest at home into this trajectory and
        back.
    """
    try:
        phase, periods = float(record["phase"]), record["periods"]
        first, last = (_ramp(ramp) for ramp in record["ramps"])
    except (KeyError, TypeError, OverflowError) as error:
        raise ValueError(f"no ramps of a motion: {error}") from error
    if not isinstance(periods, int) or isinstance(periods, bool):
        raise ValueError("its number of periods is not whole")
    if not (0 <= phase <= trajectory.period and 1 <= periods <= _MOST_PERIODS):
        raise ValueError("no motion has its phase, or as many periods")
    orbit, rest = MotionState.of(trajectory.sample(phase)), MotionState.at_rest(home)
    if not (_meet(first, first.duration, orbit) and _meet(last, 0.0, orbit)):
        raise ValueError("the ramps do not lead into the designed motion and back")
    if not (_meet(first, 0.0, rest) and _meet(last, last.duration, rest)):
        raise ValueError("the ramps do not begin and end at rest at home")
    return ExecutableMotion(
        (first, Periods(trajectory, periods, phase), last), trajectory, periods, phase
    )


def _ramp(record: Mapping[str, Any]) -> SplineRamp:
    duration, points = float(record["duration"]), np.array(record["control_points"], dtype=float)
    if points.ndim != 2 or points.shape[1] != COORDINATES or len(points) < _LEAST_POINTS:  # noqa: PLR2004 - rows and columns
        raise ValueError(f"control points of the shape {points.shape}, not (N, 6)")
    if not (np.all(np.isfinite(points)) and 0 < duration < np.inf):
        raise ValueError("a ramp with numbers that are not finite")
    name = str(record["name"])
    if name == PERIODS:
        raise ValueError(f"a ramp with the name '{PERIODS}'")
    return SplineRamp(name, duration, points)


def _meet(ramp: SplineRamp, time: float, state: MotionState) -> bool:
    """Tell whether a ramp has this state at a time from its start, s."""
    there = MotionState.of(ramp.sample(np.array([time])))
    return all(
        np.allclose(
            getattr(there, part),
            getattr(state, part),
            rtol=_JUNCTION,
            atol=_JUNCTION * max(1.0, ramp.duration**-order),
        )
        for order, part in enumerate(("pose", "rate", "acceleration"))
    )
