"""What some motion of a machine can tell of its parameters, before any motion is designed.

Two questions. Of the *structure*: the base parameters of many random states within the limits; what
regroups there, no motion tells apart, whatever the noise. Of the *noise*: for any v the best that
an experiment of N samples can do is

    std(p_k) ≥ |v_k| / (√N max ‖S⁻¹ A v‖),

with the maximum over all states that the motion may be in: by Cauchy and Schwarz,
var(p_k) ≥ v_k² / vᵀ F v. The v that is taken is F⁻¹ e_k of the random states, which makes the bound
the standard deviation of an experiment on them, where all tell as much as the best.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array, Mask
from expdesign.information.fisher import whitening
from expdesign.information.identifiable import IDENTIFIABLE, BaseParameters
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck.reach import reach, side_of
from expdesign.robot import LimitModel, Robot
from expdesign.robot.limit_model import states_at_rest

STATES = 250
_FEWEST = 100
"""States that tell something: of a machine whose limits hardly any state keeps nothing is said."""
_UNSAID = 0.25
"""Weight in the choice of base parameters of those whose nominal value is zero: a term that is
there to be tried regroups into what the machine is known to have, and not the other way round."""


@dataclass(frozen=True, eq=False)
class Excitable:
    """What the states within the limits of a machine tell."""

    base: BaseParameters
    """Of its structure."""
    best_std: Array
    """(b,) standard deviation of each base parameter that one sample of the six forces leaves at
    best, SI: N samples leave 1/√N of it. Nothing is said where it is zero."""

    def beyond_noise(self, robot: Robot, samples: float) -> dict[str, float]:
        """Return the base parameters that so many samples do not identify, however they are taken.

        With the standard deviation at best, as a share of the scale. The states are not all there
        are, and others may tell more: told are only those that are off by twice of what counts.
        """
        scales = dict(zip(robot.parameter_names, robot.scales.tolist(), strict=True))
        best = self.best_std / np.sqrt(samples)
        shares = {name: std / scales[name] for name, std in zip(self.base.base, best, strict=True)}
        return {name: float(share) for name, share in shares.items() if share > 2 * IDENTIFIABLE}


@lru_cache(maxsize=8)
def excitable(robot: Robot, names: tuple[str, ...] | None = None, seed: int = 0) -> Excitable:
    """Return what random states within the limits of the machine tell of its parameters.

    It is kept for the robots that were asked for last: a study asks for each of its estimates.

    Parameters
    ----------
    robot : Robot
    names : tuple of str, optional
        The parameters that are asked for, in the order of the regressor; the others are known. By
        default all.
    seed : int
        Of the states.
    """
    every = robot.parameter_names
    names = every if names is None else names
    columns = [every.index(name) for name in names]
    noise = robot.description.noise
    given = None if noise is None else noise.force_covariance
    whiten = np.eye(6) if given is None else whitening(given)
    white = np.matmul(whiten, robot.regressor(*random_states(robot, STATES, seed))[:, :, columns])
    if len(white) < _FEWEST:
        return Excitable(BaseParameters.each(names), np.zeros(len(names)))
    keep = np.where(robot.parameters[columns] == 0, _UNSAID, 1.0)
    base = BaseParameters.of(white.reshape(-1, len(columns)), names, keep=keep)
    chosen = [names.index(name) for name in base.base]
    return Excitable(base, best_std(white[:, :, chosen]))


def structural_base(robot: Robot, names: tuple[str, ...] | None = None) -> BaseParameters:
    """Return the base parameters of a machine's structure; arguments as of `excitable`."""
    return excitable(robot, names).base


def best_std(white: Array) -> Array:
    """Return the bound for one sample, (b,), of whitened regressors with full rank, (N, 6, b)."""
    rows = white.reshape(-1, white.shape[2])
    scales = np.linalg.norm(rows, axis=0)
    root = np.linalg.qr(rows / scales, mode="r")
    # Columns of F⁻¹, and what each of them moves the forces by in every state.
    inverse = sla.cho_solve((root, False), np.eye(len(root)))
    moved = np.linalg.norm(np.matmul(white / scales, inverse), axis=1)
    return np.diag(inverse) / (np.max(moved, axis=0) * scales)


_DRAWS = 8
"""Batches that are drawn at most: of a batch some states are always within the limits."""
_BISECTIONS = 6


def random_states(robot: Robot, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return poses, rates and accelerations, (count, 6) each, m, rad, s, that keep every limit.

    Each coordinate is drawn from its reach, then the pose is drawn back towards home, the rates and
    the accelerations towards zero, until the limits of robot and run are kept. Speeds and
    accelerations that nothing limits are drawn as lengths of the struts per s and s². Of a machine
    hardly any of whose states keep the limits, as many as were found are returned, at least that
    at rest at home.
    """
    model, rng = LimitModel.of(robot), np.random.default_rng(seed)
    ways = np.array([[-one.back.way, one.ahead.way] for one in reach(robot)])
    states = np.concatenate([robot.home, np.zeros(2 * COORDINATES)])[None, :]
    for _ in range(_DRAWS):
        states = np.concatenate([_drawn(model, ways, count, rng), states])
        if len(states) > count:
            break
    pose, rate, acceleration = np.split(states[:count], 3, axis=1)
    return pose, rate, acceleration


def _drawn(model: LimitModel, ways: Array, count: int, rng: np.random.Generator) -> Array:
    """Return states, (≤ count, 18), as many of those drawn as keep the limits."""
    robot = model.robot
    home = robot.home[None, :]
    side = side_of(robot, home)[0]

    def kept(states: Array) -> Mask:
        within = np.all(model.violations(states) <= 0, axis=1)
        return within & (side_of(robot, states[:, :COORDINATES]) == side)

    def moved(states: Array, part: int, change: Array) -> Array:
        """Move pose, rate or acceleration as far as is kept; not only states at a limit count."""
        whole = np.zeros_like(states)
        whole[:, part * COORDINATES : (part + 1) * COORDINATES] = change
        share = _largest_shares(lambda shares: kept(states + shares[:, None] * whole), count)
        return states + (share * np.sqrt(rng.uniform(size=count)))[:, None] * whole

    offset = rng.uniform(ways[:, 0], ways[:, 1], (count, COORDINATES))
    states = moved(states_at_rest(np.repeat(home, count, axis=0)), 0, offset)
    _, jacobian = robot.lengths_and_jacobian(states[:, :COORDINATES])
    for part, key in enumerate(("strut_speed", "strut_acceleration"), start=1):
        struts = _pace(robot, key) * rng.uniform(-1, 1, (count, COORDINATES))
        change = np.linalg.solve(jacobian, struts[:, :, None])[:, :, 0]
        states = moved(states, part, np.asarray(change, dtype=np.float64))
    return states[kept(states)]


def _pace(robot: Robot, key: str) -> Array:
    """Return how fast the struts are drawn at most, (6,): the limit where there is one.

    Where there is none it is their lengths at home per s and s².
    """
    limit, free = robot.limit(key), robot.inverse_kinematics(robot.home)
    return free if limit is None else np.where(np.isfinite(limit.upper), limit.upper, free)


def _largest_shares(kept: Callable[[Array], Mask], count: int) -> Array:
    """Return by bisection the largest shares, (count,) up to 1, that are kept."""
    low, high = np.zeros(count), np.ones(count)
    whole = kept(high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        fits = kept(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(whole, 1.0, low)
