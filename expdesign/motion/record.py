"""An executable motion as data: the ramps that were found, so that no search has to find them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Strict

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


@dataclass(frozen=True)
class RecordedRamp:
    """A ramp as the control points of its quintic B-spline: m, rad, (N, 6)."""

    name: str
    duration: float
    control_points: tuple[tuple[float, ...], ...]

    def ramp(self) -> SplineRamp:
        """Return the ramp.

        Raises
        ------
        ValueError
            It is none.
        """
        if {len(point) for point in self.control_points} != {COORDINATES}:
            raise ValueError(f"control points with other than {COORDINATES} coordinates")
        points = np.array(self.control_points)
        if len(points) < _LEAST_POINTS:
            raise ValueError(f"{len(points)} control points where {_LEAST_POINTS} are needed")
        if not (np.all(np.isfinite(points)) and 0 < self.duration < np.inf):
            raise ValueError("a ramp with numbers that are not finite")
        if self.name == PERIODS:
            raise ValueError(f"a ramp with the name '{PERIODS}'")
        return SplineRamp(self.name, self.duration, points)


@dataclass(frozen=True)
class RecordedMotion:
    """Phase on the orbit, s, number of periods, and the ramps, with all digits.

    `before` is how many of the ramps come before the periods.
    """

    phase: float
    periods: Annotated[int, Strict()]
    ramps: tuple[RecordedRamp, ...]
    # Earlier versions had one ramp before and one after.
    before: Annotated[int, Strict()] = 1

    @classmethod
    def of(cls, motion: ExecutableMotion) -> RecordedMotion | None:
        """Return the record of a motion; None for ramps of another kind."""
        ramps = [segment for segment in motion.segments if segment.name != PERIODS]
        recorded = [
            RecordedRamp(
                ramp.name,
                ramp.duration,
                tuple(tuple(point) for point in ramp.coefficients.tolist()),
            )
            for ramp in ramps
            if isinstance(ramp, SplineRamp)
        ]
        if len(recorded) != len(ramps):
            return None
        names = [segment.name for segment in motion.segments]
        return cls(motion.phase, motion.periods, tuple(recorded), names.index(PERIODS))

    def motion(self, trajectory: FourierTrajectory, home: Array) -> ExecutableMotion:
        """Return the motion, the same to the last digit.

        Parameters
        ----------
        trajectory : FourierTrajectory
            The designed motion that the periods repeat.
        home : (6,)
            Pose at which the motion begins and ends at rest: m, rad.

        Raises
        ------
        ValueError
            The ramps are none, or do not lead from rest at home into this trajectory and back.
        """
        if not (0 <= self.phase <= trajectory.period and 1 <= self.periods <= _MOST_PERIODS):
            raise ValueError("no motion has its phase, or as many periods")
        if not 1 <= self.before < len(self.ramps):
            raise ValueError("no ramps lead into the designed motion and back")
        ramps = [recorded.ramp() for recorded in self.ramps]
        into, back = ramps[: self.before], ramps[self.before :]
        orbit, rest = MotionState.of(trajectory.sample(self.phase)), MotionState.at_rest(home)
        if not (_meet(into[-1], into[-1].duration, orbit) and _meet(back[0], 0.0, orbit)):
            raise ValueError("the ramps do not lead into the designed motion and back")
        if not (_meet(into[0], 0.0, rest) and _meet(back[-1], back[-1].duration, rest)):
            raise ValueError("the ramps do not begin and end at rest at home")
        for one, other in (*pairwise(into), *pairwise(back)):
            if not _meet(other, 0.0, MotionState.of(one.sample(np.array([one.duration])))):
                raise ValueError(f"'{other.name}' does not begin where '{one.name}' ends")
        periods = Periods(trajectory, self.periods, self.phase)
        return ExecutableMotion((*into, periods, *back), trajectory, self.periods, self.phase)


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
