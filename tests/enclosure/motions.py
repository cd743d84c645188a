"""Motions drawn at random about a robot's home, as large as its limits admit, and their worst."""

from dataclasses import dataclass, replace

import numpy as np

from constraints import Limit
from expdesign.configuration.limits import row_labels
from expdesign.motion.planning import STRUT_JERK
from expdesign.recheck.limit_check import states_at
from expdesign.robot import LimitModel
from expdesign.trajectory import FourierTrajectory

_PEAKS, _ROUNDS, _LOCAL, _BLOCK = 6, 5, 33, 50_000


def drawn(limits, rng, harmonics=5):
    """Return a small motion about home, about as fast in every harmonic."""
    robot = limits.robot
    omega = 2 * np.pi * rng.uniform(0.1, 0.6)
    sizes = np.where(np.arange(6) < 3, 1.0, 3.0)[:, None] * 0.02
    mu, nu = (omega * sizes * rng.standard_normal((6, harmonics)) for _ in range(2))
    return FourierTrajectory(omega, robot.home, mu, nu)


def larger(trajectory, factor):
    """Return the same motion about the same centre, so many times as large."""
    return replace(trajectory, mu=factor * trajectory.mu, nu=factor * trajectory.nu)


def near_limits(limits, trajectory, spare, points=400):
    """Return the motion made as large as leaves a share of the limits to spare, about."""

    def excess(factor):
        moved = larger(trajectory, factor)
        return np.max(limits.violations(states(limits, moved, moved.sample_times(points))))

    low, high = 1e-6, 1e3
    for _ in range(40):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if excess(middle) <= -spare else (low, middle)
    return larger(trajectory, low)


def with_jerk(limits, trajectory, spare):
    """Return the limits and one on the struts' jerk that the motion leaves a share of to spare."""
    labels = row_labels(STRUT_JERK)
    alone = LimitModel(limits.robot, (Limit.boundless(STRUT_JERK, labels),))
    jerk = alone.values(states(alone, trajectory, trajectory.sample_times(4000)))
    bound = np.max(np.abs(jerk)) * (1 + 2 * spare) * np.ones(len(labels))
    return LimitModel(
        limits.robot, (*limits.limits, Limit(STRUT_JERK, -bound, bound, labels, "test"))
    )


@dataclass(frozen=True)
class Moment:
    """The largest excess of a limit that was found, and where."""

    excess: float
    row: int
    value: float
    time: float


def highest(limits, trajectory, points):
    """Return the worst moment of each limit: on a grid, and about its highest peaks there."""
    times, blocks = trajectory.sample_times(points), max(1, points // _BLOCK)
    looked = [_worst(limits, trajectory, part) for part in np.array_split(times, blocks)]
    found = [moments for moments, _ in looked]
    excess = np.concatenate([each for _, each in looked])
    peaks = (excess >= np.roll(excess, 1, axis=0)) & (excess >= np.roll(excess, -1, axis=0))
    ranked = np.argsort(np.where(peaks, -excess, np.inf), axis=0)[:_PEAKS]
    centers, width = times[np.unique(ranked)], trajectory.period / points
    for _ in range(_ROUNDS):
        local = centers[:, None] + np.linspace(-width, width, _LOCAL)
        moments, each = _worst(limits, trajectory, local.ravel())
        found.append(moments)
        most = np.max(each, axis=1).reshape(local.shape)
        centers = np.take_along_axis(local, np.argmax(most, axis=1)[:, None], axis=1)[:, 0]
        centers = np.concatenate([centers, [moment.time for moment in moments]])
        width *= 3 / _LOCAL
    return [max(moments, key=lambda one: one.excess) for moments in zip(*found, strict=True)]


def _worst(limits, trajectory, times):
    """Return the worst moment of each limit, and the excess of each at all times, (N, L)."""
    values = limits.values(states(limits, trajectory, times))
    excess, moments, each = limits.excess(values), [], []
    for columns in limits.columns:
        part = excess[:, columns]
        moment, row = np.unravel_index(int(np.argmax(part)), part.shape)
        value = float(values[moment, columns.start + row])
        moments.append(Moment(float(part[moment, row]), int(row), value, float(times[moment])))
        each.append(np.max(part, axis=1))
    return moments, np.stack(each, axis=1)


def states(limits, trajectory, times):
    """Return the states at times, (N, 18), or (N, 24) with the jerk that some limits ask for."""
    found = states_at(trajectory, times)
    if not np.any(limits.of_jerk):
        return found
    orders = trajectory.omega * np.arange(1, trajectory.harmonics + 1)
    phases, squares = np.multiply.outer(times, orders), orders**2
    jerk = -np.cos(phases) @ (trajectory.mu * squares).T
    jerk -= np.sin(phases) @ (trajectory.nu * squares).T
    return np.concatenate([found, jerk], axis=1)


def lowered(limit, moment, excess):
    """Return a limit with the bound nearest to a moment's value where the value is beyond it."""
    lower, upper, row = limit.lower.copy(), limit.upper.copy(), moment.row
    if np.isfinite(lower[row]) and np.isfinite(upper[row]):
        if moment.value - lower[row] > upper[row] - moment.value:
            upper[row] = moment.value - 1.01 * excess * (moment.value - lower[row])
        else:
            lower[row] = moment.value + 1.01 * excess * (upper[row] - moment.value)
    elif np.isfinite(upper[row]):
        upper[row] = moment.value / (1 + excess)
    else:
        lower[row] = moment.value / (1 - excess)
    return replace(limit, lower=lower, upper=upper)


def spiked(limits, rng, gap, rates):
    """Return a motion in which two rates change their signs within a gap in time, and when.

    The motion is changed by d/ω sin ω(t − t₀), which at t₀ leaves pose and acceleration alone.
    """
    one, start = limits.robot, drawn(limits, rng, harmonics=1)
    time = float(rng.uniform(0, start.period))
    pose, rate, acceleration = start.sample(time)
    second, b = rates[1]

    def values(speed, name, strut):
        motion = one.strut_motion(pose, speed, acceleration)
        return getattr(motion, name)[0, strut]

    slope = np.array(
        [
            [values(rate + unit[None], *which) - values(rate, *which) for unit in np.eye(6)]
            for which in rates
        ]
    )
    # How fast the second rate changes, by two instants after the first has been stopped.
    wanted = np.zeros(2)
    changed = start
    for _ in range(4):
        now = np.array([values(changed.sample(time).rate, *which) for which in rates])
        step = np.linalg.lstsq(slope, wanted - now, rcond=None)[0]
        cos, sin = np.cos(changed.omega * time), np.sin(changed.omega * time)
        mu, nu = changed.mu.copy(), changed.nu.copy()
        mu[:, 0] += step * cos
        nu[:, 0] += step * sin
        changed = FourierTrajectory(changed.omega, changed.lambda0, mu, nu)
        before, after = (
            getattr(one.strut_motion(*changed.sample(time + h)), second)[0, b]
            for h in (-1e-5, 1e-5)
        )
        wanted = np.array([0.0, -gap * (after - before) / 2e-5])
    return changed, time
