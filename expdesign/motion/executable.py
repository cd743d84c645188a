"""An executable motion: consecutive segments of the pose in time."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Strict

from constraints.arrays import Array
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.ramp import FIXED, EnclosedSpline, MotionState, SplineRamp
from expdesign.recheck.certificate import EnclosedMotion
from expdesign.recheck.limit_check import Motion, states_at
from expdesign.robot import Robot
from expdesign.runfolder.fields import (
    ACCELERATION_COLUMNS,
    POSE_COLUMNS,
    RATE_COLUMNS,
    TIME,
    strutwise,
)
from expdesign.trajectory import FourierTrajectory, PoseSamples

PERIODS = "periods"
WHOLE = 1e-6
"""Largest deviation of a duration from a whole number of steps, in steps."""
_LEAST_POINTS = 2 * FIXED
_MOST_PERIODS = 1_000_000
_SHORTEST_RAMP = 1e-3
"""s; no controller takes a shorter one for a motion."""
_JUNCTION = (1e-9, 1e-7, 1e-5)
"""m, m/s, m/s², and with rad: largest differences where two parts of a motion meet.

The last digits of the control points of a ramp of a few milliseconds turn into as much speed and
acceleration.
"""
_SHARE = 1e-9
"""The same as a share of the value."""


@dataclass(frozen=True, eq=False)
class Periods:
    """A segment of whole periods of a Fourier series."""

    trajectory: FourierTrajectory
    periods: int
    """Their number M."""
    phase: float = 0.0
    """Time on the trajectory's orbit at both ends, s."""

    @property
    def name(self) -> str:
        """Name of the segment."""
        return PERIODS

    @property
    def duration(self) -> float:
        """M periods, s."""
        return self.periods * self.trajectory.period

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times from the segment's own start, s."""
        return self.trajectory.sample(self._on_orbit(times))

    def jerk(self, times: Array) -> Array:
        """Return the third derivative of the pose, (N, 6): m/s³, rad/s³."""
        series = self.trajectory
        orders = series.omega * np.arange(1, series.harmonics + 1)
        angles = np.multiply.outer(self._on_orbit(times), orders)
        mu, nu = series.mu * orders**2, series.nu * orders**2
        return -np.cos(angles) @ mu.T - np.sin(angles) @ nu.T

    def scaled(self, factor: float, home: Array) -> Periods:
        """Return home + F (λ(F t) − home) for the factor F and the pose home, (6,): m, rad."""
        return Periods(self.trajectory.scaled(factor, home), self.periods, self.phase / factor)

    def _on_orbit(self, times: Array) -> Array:
        # Within one period, so that all periods have exactly the same values.
        return np.mod(np.asarray(times, dtype=float) + self.phase, self.trajectory.period)


Segment = Periods | SplineRamp
"""A part of the motion: ``"ramp in"``, ``"periods"`` or ``"ramp out"``, in its own time."""


@dataclass(frozen=True, eq=False)
class ExecutableMotion:
    """The whole motion, from rest at home to rest at home."""

    segments: tuple[Segment, ...]
    trajectory: FourierTrajectory
    """The designed motion that the periods repeat."""
    periods: int
    """Their number M."""
    phase: float = 0.0
    """Time on the trajectory's orbit at which the periods begin, s."""
    seconds: float = 0.0

    @property
    def starts(self) -> Array:
        """(K + 1,), beginnings of the segments and end of the last, s."""
        return np.concatenate([[0.0], np.cumsum([segment.duration for segment in self.segments])])

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self.starts[-1])

    @property
    def window(self) -> tuple[float, float]:
        """Beginning and end of the measurement window, the M periods, s."""
        k = [segment.name for segment in self.segments].index(PERIODS)
        return float(self.starts[k]), float(self.starts[k + 1])

    def steps(self, step: float) -> tuple[int, ...]:
        """Return the number of controller steps, of a length in s, of each segment.

        Raises
        ------
        ValueError
            A segment is not a whole number of steps.
        """
        counts = [segment.duration / step for segment in self.segments]
        for segment, count in zip(self.segments, counts, strict=True):
            if abs(count - round(count)) > WHOLE:
                raise ValueError(f"{segment.name} takes {count:.9g} steps of {step:g} s")
        return tuple(round(count) for count in counts)

    def scaled(self, factor: float, home: Array) -> ExecutableMotion:
        """Return a smaller and slower motion: home + F (λ(F t) − home).

        Distances from home are multiplied by F, rates by F², accelerations by F³, times by 1/F.

        Parameters
        ----------
        factor : float
            F, 0 < F ≤ 1.
        home : (6,)
            Pose from which it begins: m, rad.
        """
        return replace(
            self,
            segments=tuple(segment.scaled(factor, home) for segment in self.segments),
            trajectory=self.trajectory.scaled(factor, home),
            phase=self.phase / factor,
        )

    def with_periods(self, periods: int) -> ExecutableMotion:
        """Return the motion with another number of periods; itself if they are not `Periods`."""
        if periods == self.periods or not any(isinstance(s, Periods) for s in self.segments):
            return self
        segments = (
            replace(segment, periods=periods) if isinstance(segment, Periods) else segment
            for segment in self.segments
        )
        return replace(self, segments=tuple(segments), periods=periods)

    def sample(self, times: ArrayLike) -> PoseSamples:
        """Return pose, rate and acceleration at any times, s; outside the motion it is at rest."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        starts = self.starts
        inside = np.clip(t, 0.0, starts[-1])
        last = len(self.segments) - 1
        place = np.clip(np.searchsorted(starts, inside, side="right") - 1, 0, last)
        found = PoseSamples(*(np.empty((len(t), COORDINATES)) for _ in PoseSamples._fields))
        for k, segment in enumerate(self.segments):
            rows = place == k
            if np.any(rows):
                states = segment.sample(inside[rows] - starts[k])
                for part, values in zip(found, states, strict=True):
                    part[rows] = values
        resting = (t < 0) | (t > self.duration)
        found.rate[resting] = found.acceleration[resting] = 0.0
        return found


@dataclass(frozen=True)
class RampPoints:
    """Control points of the quintic B-spline of a ramp: m, rad, (N, 6)."""

    name: str
    duration: float
    control_points: tuple[tuple[float, ...], ...]

    def ramp(self) -> SplineRamp:
        """Return the ramp.

        Raises
        ------
        ValueError
            The control points do not define a ramp.
        """
        if {len(point) for point in self.control_points} != {COORDINATES}:
            raise ValueError(f"control points with other than {COORDINATES} coordinates")
        points = np.array(self.control_points)
        if len(points) < _LEAST_POINTS:
            raise ValueError(f"{len(points)} control points where {_LEAST_POINTS} are needed")
        if not (np.all(np.isfinite(points)) and 0 < self.duration < np.inf):
            raise ValueError("a ramp with numbers that are not finite")
        if self.duration < _SHORTEST_RAMP:
            raise ValueError(f"a ramp of {self.duration:g} s")
        if self.name == PERIODS:
            raise ValueError(f"a ramp with the name '{PERIODS}'")
        return SplineRamp(self.name, self.duration, points)


@dataclass(frozen=True)
class LeadRamps:
    """Lead-in and lead-out of a motion as data with all digits.

    Phase on the orbit, s, number of periods, the ramps, and the number of ramps `before` the
    periods.
    """

    phase: float
    periods: Annotated[int, Strict()]
    ramps: tuple[RampPoints, ...]
    before: Annotated[int, Strict()]

    def motion(self, trajectory: FourierTrajectory, home: Array) -> ExecutableMotion:
        """Return the executable motion, identical to the last digit.

        Parameters
        ----------
        trajectory : FourierTrajectory
            The designed motion that the periods repeat.
        home : (6,)
            Pose at which the motion begins and ends at rest: m, rad.

        Raises
        ------
        ValueError
            The ramps do not lead from rest at home into this trajectory and back.
        """
        if not (0 <= self.phase <= trajectory.period and 1 <= self.periods <= _MOST_PERIODS):
            raise ValueError("no motion has its phase, or as many periods")
        if not 1 <= self.before < len(self.ramps):
            raise ValueError("no ramps lead into the designed motion and back")
        ramps = [points.ramp() for points in self.ramps]
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
    """Return whether a ramp has this state at a time from its start, s."""
    there = MotionState.of(ramp.sample(np.array([time])))
    return all(
        np.allclose(found, expected, rtol=_SHARE, atol=allowed)
        for found, expected, allowed in zip(there, state, _JUNCTION, strict=True)
    )


def lead_ramps(motion: ExecutableMotion) -> LeadRamps | None:
    """Return lead-in and lead-out of a motion as data; None for ramps of another kind."""
    names, ramps = [segment.name for segment in motion.segments], []
    for segment in motion.segments:
        if isinstance(segment, SplineRamp):
            points = tuple(tuple(point) for point in segment.coefficients.tolist())
            ramps.append(RampPoints(segment.name, segment.duration, points))
        elif segment.name != PERIODS:
            return None
    return LeadRamps(motion.phase, motion.periods, tuple(ramps), names.index(PERIODS))


def moving_states(segment: Segment, times: Array) -> Array:
    """Return pose, rate, acceleration and jerk of the pose, (N, 24), at times from its start, s."""
    return np.concatenate([states_at(segment, times), segment.jerk(times)], axis=1)


def enclose_segment(segment: Segment) -> EnclosedMotion:
    """Return the enclosure of a segment from its own start; of the periods only the first."""
    if isinstance(segment, Periods):
        return EnclosedSeries(segment.trajectory)
    return EnclosedSpline(segment)


def has_enclosure(motion: ExecutableMotion) -> bool:
    """Return whether each segment has an enclosure."""
    return all(isinstance(segment, Periods | SplineRamp) for segment in motion.segments)


_AT_ONCE = 20_000
"""Instants."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Pose, struts and forces, (N, 6) each, at N instants; base frame, SI units and radians."""

    time: Annotated[Array, TIME]
    pose: Annotated[Array, POSE_COLUMNS]
    pose_rate: Annotated[Array, RATE_COLUMNS]
    pose_acceleration: Annotated[Array, ACCELERATION_COLUMNS]
    length: Annotated[Array, strutwise("q", "m", "length")]
    speed: Annotated[Array, strutwise("dq", "m/s", "speed")]
    acceleration: Annotated[Array, strutwise("ddq", "m/s^2", "acceleration")]
    alpha: Annotated[Array, strutwise("alpha", "rad", "first cardan angle")]
    beta: Annotated[Array, strutwise("beta", "rad", "second cardan angle")]
    force: Annotated[
        Array, strutwise("Q", "N", "actuator force at the nominal parameters, positive extends,")
    ]

    @classmethod
    def of(cls, robot: Robot, motion: Motion, times: Array) -> SampledMotion:
        """Sample a motion of a robot at the times (N,), s."""
        # Intermediate results take ten times the memory of the result.
        parts = [
            cls._at_once(robot, motion, times[begin : begin + _AT_ONCE])
            for begin in range(0, max(len(times), 1), _AT_ONCE)
        ]
        if len(parts) == 1:
            return parts[0]
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    @classmethod
    def _at_once(cls, robot: Robot, motion: Motion, times: Array) -> SampledMotion:
        state = motion.sample(times)
        struts = robot.strut_motion(*state)
        return cls(
            times,
            *state,
            struts.length,
            struts.length_rate,
            struts.length_acceleration,
            struts.alpha,
            struts.beta,
            robot.actuator_forces(*state),
        )

    @property
    def period(self) -> float:
        """Duration of one period of equidistant samples without its end, s."""
        steps = self.time.size - 1
        return float((self.time[-1] - self.time[0]) * (steps + 1) / steps)

    @property
    def increases(self) -> bool:
        """Whether there are at least two instants, in increasing order."""
        return self.time.size > 1 and bool(np.all(np.diff(self.time) > 0))
