"""From a designed trajectory to the motion that a machine executes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from constraints import Limit, plain_limit
from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.limits import row_labels
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.motion.executable import (
    WHOLE,
    ExecutableMotion,
    Periods,
    Segment,
    enclose_segment,
    moving_states,
)
from expdesign.motion.ramp import MotionState, RampProblem, SplineRamp
from expdesign.motion.ramp_search import (
    NoRampError,
    find_ramp,
    guesses,
    pause_near,
    polynomials,
    shortest,
)
from expdesign.problem.variables import coordinate_reach
from expdesign.progress import track
from expdesign.recheck.certificate import certify, recheck
from expdesign.recheck.limit_check import LimitCheck, Recheck, worst_of_each
from expdesign.robot import LimitModel, Robot, robot_from
from expdesign.trajectory import FourierTrajectory

RAMP_IN, RAMP_OUT = "ramp in", "ramp out"
FAR = {RAMP_IN: "approach", RAMP_OUT: "return"}
"""Names of the ramps between home and a pause near the orbit."""
Leads = tuple[tuple[SplineRamp, ...], tuple[SplineRamp, ...]]
"""Lead-in from rest at home to the orbit, and lead-out."""
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
    segments: tuple[Segment, ...] = (*first, Periods(trajectory, plan.periods, phase), *last)
    seconds = time.perf_counter() - began
    return ExecutableMotion(segments, trajectory, plan.periods, phase, seconds)


@dataclass(frozen=True, eq=False)
class _Plan:
    """Common inputs of the ramps of one motion."""

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
        """Return the initial values of the search for a ramp."""
        return guesses(problem, self.trajectory.shifted(phase), self.trajectory.period, self.width)

    def ramps(self, phase: float) -> Leads:
        """Find lead-in and lead-out for a phase on the orbit."""
        problems = self.problems(phase, PIECES)
        first, last = (
            self._lead(name, problem, phase)
            for name, problem in track("lead-in and lead-out: the shortest", problems)
        )
        return first, last

    def _lead(self, name: str, problem: RampProblem, phase: float) -> tuple[SplineRamp, ...]:
        """Return one ramp between home and the orbit, or two with a pause at rest near the orbit.

        A slow machine needs half a minute for the distance and a tenth of a second to join the
        motion: no spline of equal pieces does both.
        """
        try:
            guessed = self.guesses(problem, phase)
            return (find_ramp(problem, guessed, name, self.step, self.width),)
        except NoRampError as refused:
            try:
                return self._with_pause(name, problem)
            except NoRampError:
                raise refused from None

    def _with_pause(self, name: str, problem: RampProblem) -> tuple[SplineRamp, ...]:
        """Return the ramps between home and rest, and between rest and the orbit, in order."""
        arriving = name == RAMP_IN
        near = pause_near(problem, self.width, arriving=arriving)
        far = replace(problem, end=near.start) if arriving else replace(problem, start=near.end)
        close, away = (
            find_ramp(part, polynomials(part, self.width), called, self.step, self.width)
            for part, called in ((near, name), (far, FAR[name]))
        )
        return (away, close) if arriving else (close, away)

    def estimate(self, phase: float) -> float:
        """Return the approximate duration of both ramps, s, longer if they break limits."""
        total = 0.0
        for _, problem in self.problems(phase, _COARSE_PIECES):
            guess = self.guesses(problem, phase)[0]
            total += shortest(problem, guess, self.width, _COARSE_POINTS).promise
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


def _best_phase(plan: _Plan) -> tuple[float, Leads]:
    """Return the phase, on a controller step, with the shortest ramps, and the ramps."""
    steps = plan.trajectory.period / plan.step
    phases = [float(np.floor(k * steps / _PHASES) * plan.step) for k in range(_PHASES)]
    phases = list(dict.fromkeys(phases))
    places = track("lead-in and lead-out: places on the orbit", phases)
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


STRUT_JERK = plain_limit("strut_jerk", "strut jerk", "m/s^3", "symmetric")
"""Limit of ramps alone, not in the catalogue; its key in the run file is `motion.jerk`."""


RISE = 0.02
"""Time from zero to a strut's largest acceleration with the default bound, s."""


OWN = 1.2
"""The default bound is at least this multiple of the designed motion's own jerk."""


_POINTS = 4000


def jerk_limit(configuration: RunConfiguration, robot: Robot, orbit: Periods) -> Limit:
    """Return `motion.jerk`, or the default: the struts' acceleration limit within 20 ms.

    Without such a limit it is the largest acceleration of the designed motion within 20 ms. The
    default is at least 1.2 times the jerk of the designed motion.

    Raises
    ------
    InputError
        The designed motion itself exceeds `motion.jerk`.
    """
    times = np.linspace(0.0, orbit.trajectory.period, _POINTS)
    states = moving_states(orbit, times)
    given = configuration.run.motion.jerk
    if given is not None:
        limit = _within(np.full(ACTUATORS, given), "motion.jerk")
        (check,) = certify(LimitModel(robot, (limit,)), enclose_segment(orbit))
        if not check.kept:
            largest = f"{abs(check.value):.4g} m/s^3"
            raise InputError(
                f"the designed motion itself has a strut jerk of {largest}",
                file=configuration.file,
                key="motion.jerk",
                allowed=f"at least {largest}, or a calmer design",
            )
        return limit
    unbounded = _within(np.full(ACTUATORS, np.inf), "")
    own = np.max(np.abs(LimitModel(robot, (unbounded,)).values(states)), axis=0)
    bound = robot.limit("strut_acceleration")
    if bound is None:
        struts = robot.strut_motion(*np.split(states[:, : 3 * COORDINATES], 3, axis=1))
        largest_acceleration = np.max(np.abs(struts.length_acceleration), axis=0)
    else:
        largest_acceleration = np.minimum(np.abs(bound.lower), np.abs(bound.upper))
    return _within(np.maximum(largest_acceleration / RISE, OWN * own), "default of motion.jerk")


def _within(largest: Array, origin: str) -> Limit:
    return Limit(STRUT_JERK, -largest, largest, row_labels(STRUT_JERK), origin)


def check_motion(
    configuration: RunConfiguration,
    motion: ExecutableMotion,
    judge: Callable[[LimitModel, Segment], tuple[LimitCheck, ...]] = (
        lambda limits, segment: certify(limits, enclose_segment(segment))
    ),
) -> Recheck:
    """Judge every limit and the struts' jerk from rest to rest, at every instant.

    Of the identical periods one is judged. Times are from the start of the motion. `judge` returns
    the checks of a segment, the last limit being that of the jerk.
    """
    robot = robot_from(configuration.robot)
    orbit = Periods(motion.trajectory, motion.periods)
    limits = LimitModel.of(robot, jerk_limit(configuration, robot, orbit))
    checks: list[LimitCheck] = []
    for start, segment in zip(motion.starts[:-1], motion.segments, strict=True):
        found = judge(limits, segment)
        if isinstance(segment, Periods):
            period = segment.trajectory.period
            found = tuple(
                replace(check, time=(check.time - segment.phase) % period) for check in found
            )
        checks += [replace(check, time=float(start) + check.time) for check in found]
    return Recheck(worst_of_each(checks), "the motion from rest to rest")
