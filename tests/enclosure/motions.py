"""Motions drawn at random about a robot's home, as large as its limits admit or larger."""

import numpy as np

from expdesign.recheck.judge import states_at
from expdesign.trajectory import FourierTrajectory


def drawn(limits, rng, harmonics=5, frequency=None):
    """Return a small motion about home, of the same speed for every harmonic."""
    robot = limits.robot
    omega = 2 * np.pi * (rng.uniform(0.1, 0.6) if frequency is None else frequency)
    sizes = np.where(np.arange(6) < 3, 1.0, 3.0)[:, None] * 0.02
    mu, nu = (omega * sizes * rng.standard_normal((6, harmonics)) for _ in range(2))
    return FourierTrajectory(omega, robot.home, mu, nu)


def worst(limits, trajectory, points):
    """Return the largest excess of each limit on a grid of points, (L,)."""
    return excess_at(limits, trajectory, trajectory.sample_times(points))


def excess_at(limits, trajectory, times):
    """Return the largest excess of each limit at times, (L,)."""
    found = limits.violations(states(limits, trajectory, times))
    return np.array([np.max(found[:, columns]) for columns in limits.columns])


def states(limits, trajectory, times):
    """Return the states at times, (N, 18), or (N, 24) with the jerk that some limits ask for."""
    found = states_at(trajectory, times)
    if not np.any(limits.of_jerk):
        return found
    phases = np.multiply.outer(times, trajectory.omega * np.arange(1, trajectory.harmonics + 1))
    squares = (trajectory.omega * np.arange(1, trajectory.harmonics + 1)) ** 2
    jerk = (
        -np.cos(phases) @ (trajectory.mu * squares).T - np.sin(phases) @ (trajectory.nu * squares).T
    )
    return np.concatenate([found, jerk], axis=1)
