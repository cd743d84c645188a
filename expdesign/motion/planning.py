"""From a designed trajectory to the motion that a machine executes.

The search for a ramp starts from simple motions between its ends, the least bad first.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration
from expdesign.motion.executable import WHOLE, ExecutableMotion, Periods
from expdesign.motion.limits import jerk_limit, moving_states
from expdesign.motion.ramp import NoRampError, find_ramp, shortest
from expdesign.motion.ramp_problem import RampProblem
from expdesign.motion.spline import FIXED, MotionState, SplineRamp, derivatives
from expdesign.problem.variables import coordinate_reach
from expdesign.progress import told
from expdesign.recheck.certificate import recheck
from expdesign.recheck.judge import Motion
from expdesign.robot import LimitModel, robot_from
from expdesign.trajectory import FourierTrajectory

RAMP_IN, RAMP_OUT = "ramp in", "ramp out"
PIECES = 12
"""Polynomial pieces of a ramp."""

_COARSE_PIECES, _COARSE_POINTS = 6, 16
_PHASES = 12
_MOST_PHASES = 4
_WIDTH = 0.05
"""Smoothing of dry friction, as a share of the designed motion's rms strut speed."""
_SMALLEST_WIDTH = 1e-4
"""m/s."""
_SAMPLES = 200
_SHORTEST, _GROWTH, _COUNT = 0.05, 1.35, 20
"""Durations of the polynomials that are tried: 50 ms to 15 s."""
_FADES = (0.25, 0.5, 1.0)


def executable_motion(
    configuration: RunConfiguration, trajectory: FourierTrajectory
) -> ExecutableMotion:
    """Return the motion from rest at home through M periods back to rest at home.

    The ramps are the shortest found that keep every limit of the robot by the unsmoothed model
    and the bound on the jerk, each a whole number of controller steps. The same input gives the
    same motion.

    Raises
    ------
    InputError
        The periods are not a whole number of controller steps, or the trajectory itself breaks
        a limit or `motion.jerk`.
    NoRampError
        No ramp keeps the limits; it says which one binds.
    """
    began = time.perf_counter()
    plan = _plan(configuration, trajectory)
    if configuration.run.motion.phase == "best":
        phase, (first, last) = _best_phase(plan)
    else:
        phase = 0.0
        try:
            first, last = plan.ramps(phase)
        except NoRampError as error:
            hint = "motion.phase: best looks for a better place on the orbit than its t = 0"
            raise NoRampError(error.name, error.limit, f"{error}; {hint}") from error
    segments = first, Periods(trajectory, plan.periods, phase), last
    seconds = time.perf_counter() - began
    return ExecutableMotion(segments, trajectory, plan.periods, phase, seconds)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What the ramps of one motion have in common."""

    limits: LimitModel
    trajectory: FourierTrajectory
    periods: int
    step: float
    scale: Array
    width: float

    def problems(self, phase: float, pieces: int) -> list[tuple[str, RampProblem]]:
        """Return both ramps for a phase on the orbit as problems."""
        home = MotionState.at_rest(self.limits.robot.home)
        orbit = MotionState.of(self.trajectory.sample(phase))
        return [
            (name, RampProblem(self.limits, start, end, pieces, self.scale, 1.0))
            for name, start, end in ((RAMP_IN, home, orbit), (RAMP_OUT, orbit, home))
        ]

    def guesses(self, problem: RampProblem, phase: float) -> list[SplineRamp]:
        """Return where the search for a ramp starts."""
        return guesses(problem, self.trajectory.shifted(phase), self.trajectory.period, self.width)

    def ramps(self, phase: float) -> tuple[SplineRamp, SplineRamp]:
        """Find both ramps for a phase on the orbit."""
        problems = self.problems(phase, PIECES)
        first, last = (
            find_ramp(problem, self.guesses(problem, phase), name, self.step, self.width)
            for name, problem in told("ways from rest and back: the shortest", problems)
        )
        return first, last

    def estimate(self, phase: float) -> float:
        """Return roughly how long both ramps take, s, and more where they break limits."""
        total = 0.0
        for _, problem in self.problems(phase, _COARSE_PIECES):
            guess = self.guesses(problem, phase)[0]
            attempt = shortest(problem, guess, self.width, _COARSE_POINTS)
            total += attempt.duration * (1 + 10 * max(attempt.violation, 0.0))
        return total


def _plan(configuration: RunConfiguration, trajectory: FourierTrajectory) -> _Plan:
    run = configuration.run
    robot = robot_from(configuration.robot)
    limits = LimitModel.of(robot)
    step = run.controller_period
    _refuse_broken_steps(configuration, trajectory, step)
    _refuse_broken_limits(configuration, limits, trajectory)
    jerk = jerk_limit(configuration, robot, Periods(trajectory, 1))
    _, reach = coordinate_reach(limits)
    motion = trajectory.sample(trajectory.sample_times(_SAMPLES))
    rms_speed = float(np.sqrt(np.mean(robot.strut_motion(*motion).length_rate ** 2)))
    return _Plan(
        LimitModel.of(robot, jerk),
        trajectory,
        run.experiment.periods,
        step,
        reach / 2,
        max(_WIDTH * rms_speed, _SMALLEST_WIDTH),
    )


def _best_phase(plan: _Plan) -> tuple[float, tuple[SplineRamp, SplineRamp]]:
    """Return the phase, on a controller step, with the shortest ramps, and these."""
    steps = plan.trajectory.period / plan.step
    phases = [float(np.floor(k * steps / _PHASES) * plan.step) for k in range(_PHASES)]
    phases = list(dict.fromkeys(phases))
    places = told("ways from rest and back: places on the orbit", phases)
    ranked = [phase for _, phase in sorted((plan.estimate(phase), phase) for phase in places)]
    refused: NoRampError | None = None
    for phase in ranked[:_MOST_PHASES]:
        try:
            return phase, plan.ramps(phase)
        except NoRampError as error:
            refused = refused or error
    if refused is None:
        raise ValueError("the period has no controller step")
    raise refused


def _refuse_broken_steps(
    configuration: RunConfiguration, trajectory: FourierTrajectory, step: float
) -> None:
    steps = trajectory.period / step
    if abs(steps - round(steps)) > WHOLE:
        raise InputError(
            f"a period of {trajectory.period:.9g} s is {steps:.6f} controller steps: the "
            "measurement window would not end on one",
            file=configuration.file,
            key="trajectory.controller_period",
            allowed="a step of which the designed period is a whole number",
        )


def _refuse_broken_limits(
    configuration: RunConfiguration, limits: LimitModel, trajectory: FourierTrajectory
) -> None:
    check = recheck(limits, trajectory)
    if check.passed:
        return
    worst = max(check.limits, key=lambda item: item.violation)
    raise InputError(
        f"the designed motion itself breaks this limit: {worst}",
        file=configuration.file,
        key=f"limits.{worst.key}",
        allowed="a design made for these limits",
    )


def guesses(problem: RampProblem, orbit: Motion, period: float, width: float) -> list[SplineRamp]:
    """Return ramps between the problem's ends, sorted by how much they break the limits.

    Polynomials of fifth order through both ends, of many durations, and the periodic motion
    itself with an amplitude that grows from zero (or fades to it). Those that keep every limit
    come first, the shortest of them before the others. `orbit` is the periodic motion on the
    ramp's own time axis, which begins (ramp in: ends) at 0; dry friction has a width in m/s.
    """
    shares = np.linspace(0.0, 1.0, _SAMPLES)
    durations = _SHORTEST * _GROWTH ** np.arange(_COUNT)
    ramps = [_polynomial(problem, float(duration), shares) for duration in durations]
    ramps += [_faded(problem, orbit, share * period, shares) for share in _FADES]

    def rank(ramp: SplineRamp) -> tuple[float, float]:
        states = moving_states(ramp, shares * ramp.duration)
        worst = float(np.max(problem.limits.smooth_violations(states, width)))
        return max(worst, 0.0), ramp.duration

    return sorted(ramps, key=rank)


def _polynomial(problem: RampProblem, duration: float, shares: Array) -> SplineRamp:
    # One piece has six control points: the ends determine them all.
    ends = replace(problem, intervals=1).at_duration(duration)
    return _fitted(problem, duration, shares, derivatives(1, shares)[0] @ ends)


def _faded(problem: RampProblem, orbit: Motion, duration: float, shares: Array) -> SplineRamp:
    home = problem.limits.robot.home
    arriving = np.array_equal(problem.start.pose, home)
    times = (shares - 1) * duration if arriving else shares * duration
    grown = shares if arriving else 1 - shares
    weight = grown**3 * (10 - 15 * grown + 6 * grown**2)
    poses = home + weight[:, None] * (orbit.sample(times).pose - home)
    return _fitted(problem, duration, shares, poses)


def _fitted(problem: RampProblem, duration: float, shares: Array, poses: Array) -> SplineRamp:
    """Return the ramp between the problem's ends that is closest to the poses."""
    basis = derivatives(problem.intervals, shares)[0]
    coefficients = problem.at_duration(duration)
    coefficients[FIXED:-FIXED] = 0.0
    left = poses - basis @ coefficients
    inner, *_ = np.linalg.lstsq(basis[:, FIXED:-FIXED], left, rcond=None)
    coefficients[FIXED:-FIXED] = inner
    return SplineRamp("guess", duration, coefficients)
