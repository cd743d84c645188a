"""Executable motions for the tests: analytic ramps between rest at home and random periods."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from expdesign.export.definition import Task
from expdesign.motion.executable import ExecutableMotion, LeadRamps
from expdesign.motion.executable import Periods as RealPeriods
from expdesign.motion.ramp import MotionState, SplineRamp, end_coefficients, reversed_in_time
from expdesign.robot import LimitModel, load_robot
from expdesign.trajectory import FourierTrajectory, PoseSamples, TrajectoryFile

# w(s) of s = 0 … 1 with w(0) = 0, w(1) = 1 and three vanishing derivatives at both ends.
BLEND = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
RAMP = 1.2
SHORT_RAMP = 0.4
RESERVE = 0.02
PERIODS = 1
FREQUENCY = {("palida", 5): 0.6, ("palida", 12): 0.4, ("linuxcnc", 5): 0.5, ("linuxcnc", 12): 0.35}
SIZES = {
    "palida": [0.06, 0.06, 0.04, 0.2, 0.2, 0.3],
    "linuxcnc": [0.08, 0.08, 0.05, 0.15, 0.15, 0.2],
}
DESIGNED = ("linuxcnc design", 12)
"""A real design at its limits with the ramps that the search found, instead of a random orbit."""
CASES = (("palida", 5), DESIGNED)
"""Both robots, few and many harmonics, a random orbit and what the search finds."""
REFERENCE = Path(__file__).parents[1] / "reference" / "linuxcnc_design_12.json"


@dataclass(frozen=True, eq=False)
class Blend:
    """home + w (λ_F − home), forwards in time or backwards."""

    name: str
    home: np.ndarray
    trajectory: FourierTrajectory
    start: float
    outwards: bool
    duration: float = RAMP

    def sample(self, times):
        share = times / self.duration
        sign = 1.0 if self.outwards else -1.0
        share = share if self.outwards else 1 - share
        w, dw, ddw = (
            (sign / self.duration) ** k * BLEND.deriv(k)(share)[:, None] for k in range(3)
        )
        moved = self.trajectory.sample(self.start + times)
        off = moved.pose - self.home
        return PoseSamples(
            self.home + w * off,
            dw * off + w * moved.rate,
            ddw * off + 2 * dw * moved.rate + w * moved.acceleration,
        )


@dataclass(frozen=True, eq=False)
class Periods:
    trajectory: FourierTrajectory
    duration: float
    name: str = "periods"

    def sample(self, times):
        return self.trajectory.sample(times)


def recorded(data):
    """Return the type of what a record says in plain data."""
    return TypeAdapter(LeadRamps).validate_python(data)


def motion_of(robot, trajectory, periods=PERIODS):
    return ExecutableMotion(
        (
            Blend("ramp in", robot.home, trajectory, -RAMP, outwards=True),
            Periods(trajectory, periods * trajectory.period),
            Blend("ramp out", robot.home, trajectory, 0.0, outwards=False),
        ),
        trajectory,
        periods,
    )


def _trajectory(robot, harmonics, frequency, size):
    rng = np.random.default_rng(harmonics)
    amplitudes = np.multiply.outer(SIZES[robot.name], 1 / np.arange(1, harmonics + 1) ** 1.5)
    sine, cosine = (size * amplitudes * rng.uniform(-1, 1, amplitudes.shape) for _ in range(2))
    return FourierTrajectory.from_displacements(2 * np.pi * frequency, robot.home, sine, cosine)


@cache
def task(name="palida", harmonics=5):
    """Return a task whose motion uses the limits up to a few percent; a design all of them."""
    robot = load_robot(name.split()[0])
    if (name, harmonics) == DESIGNED:
        trajectory = TrajectoryFile.read(REFERENCE).trajectory
        ways = json.loads(REFERENCE.read_text(encoding="utf-8"))["ways"]
        return _task(robot, recorded(ways).motion(trajectory, robot.home))
    model = LimitModel.of(robot)
    frequency = FREQUENCY[name, harmonics]
    low, high = 0.0, 4.0
    for _ in range(9):
        size = (low + high) / 2
        motion = motion_of(robot, _trajectory(robot, harmonics, frequency, size))
        states = motion.sample(np.linspace(0, motion.duration, 2001))
        parts = np.concatenate([states.pose, states.rate, states.acceleration], axis=1)
        if model.violations(parts).max() < -RESERVE:
            low = size
        else:
            high = size
    return _task(robot, motion_of(robot, _trajectory(robot, harmonics, frequency, low)))


def _task(robot, motion):
    return Task(
        name="test",
        robot=robot,
        motion=motion,
        controller_period=1e-3,
        sampling=500.0,
        parameters=robot.parameter_names,
        force_covariance=robot.description.noise.force_covariance,
    )


def _quintic(name, start, end):
    """Return the polynomial of fifth order between two states as a ramp of one piece."""
    first, _ = end_coefficients(1, SHORT_RAMP, start)
    last, _ = end_coefficients(1, SHORT_RAMP, reversed_in_time(end))
    return SplineRamp(name, SHORT_RAMP, np.concatenate([first, last[::-1]]))


def spline_motion_of(robot, trajectory, periods=PERIODS, phase=0.0):
    """Return the motion with ramps of the kind that the search finds."""
    home, orbit = MotionState.at_rest(robot.home), MotionState.of(trajectory.sample(phase))
    return ExecutableMotion(
        (
            _quintic("ramp in", home, orbit),
            RealPeriods(trajectory, periods, phase),
            _quintic("ramp out", orbit, home),
        ),
        trajectory,
        periods,
        phase,
    )
