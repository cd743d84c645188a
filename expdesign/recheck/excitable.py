"""Identifiability of a machine's parameters by any motion within its limits, before a design.

*Structure*: parameters that regroup for many random states within the limits are confounded in
every motion, whatever the noise. *Noise*: for any v an experiment of N samples satisfies

    std(p_k) ≥ |v_k| / (√N max ‖S⁻¹ A v‖),

with the maximum over all admissible states: by Cauchy and Schwarz, var(p_k) ≥ v_k² / vᵀ F v. With
v = F⁻¹ e_k of the random states the bound is the standard deviation of an experiment on these
states, if all were as informative as the best.
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
from expdesign.robot.robot import solve_rows

STATES = 250
_FEWEST = 100
"""Smallest number of states for a statement: some limits admit hardly any state."""
_ZERO = 0.25
"""Weight of parameters with nominal value zero in the choice of base parameters: a candidate term
regroups into the established terms."""


@dataclass(frozen=True, eq=False)
class Excitable:
    """Base parameters by the states within a machine's limits, with their best precision."""

    base: BaseParameters
    """Base parameters of the structure."""
    best_std: Array
    """(b,) smallest standard deviation of each base parameter from one sample of the six forces,
    SI; for N samples divide by √N. Zero: unknown."""

    def beyond_noise(self, robot: Robot, samples: float) -> dict[str, float]:
        """Return the base parameters that no experiment with so many samples identifies.

        The values are the smallest standard deviations as shares of the scale. Other states may
        be more informative: only parameters beyond twice the threshold are returned.
        """
        scales = dict(zip(robot.parameter_names, robot.scales.tolist(), strict=True))
        best = self.best_std / np.sqrt(samples)
        shares = {name: std / scales[name] for name, std in zip(self.base.base, best, strict=True)}
        return {name: float(share) for name, share in shares.items() if share > 2 * IDENTIFIABLE}


@lru_cache(maxsize=8)
def excitable(robot: Robot, names: tuple[str, ...] | None = None) -> Excitable:
    """Return the identifiability of a machine's parameters by random states within its limits.

    Results for the last few robots are cached: a study needs them for every estimate.

    Parameters
    ----------
    robot : Robot
    names : tuple of str, optional
        Unknown parameters, in the order of the regressor; by default all.
    """
    every = robot.parameter_names
    names = every if names is None else names
    columns = [every.index(name) for name in names]
    noise = robot.description.noise
    given = None if noise is None else noise.force_covariance
    whiten = np.eye(6) if given is None else whitening(given)
    white = np.matmul(whiten, robot.regressor(*random_states(robot, STATES))[:, :, columns])
    if len(white) < _FEWEST:
        return Excitable(BaseParameters.each(names), np.zeros(len(names)))
    keep = np.where(robot.parameters[columns] == 0, _ZERO, 1.0)
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
    # Columns of F⁻¹, and the effect of each on the forces in every state.
    inverse = sla.cho_solve((root, False), np.eye(len(root)))
    moved = np.linalg.norm(np.matmul(white / scales, inverse), axis=1)
    return np.diag(inverse) / (np.max(moved, axis=0) * scales)


_DRAWS = 8
"""Largest number of batches; some states of a batch are always within the limits."""
_BISECTIONS = 6


def random_states(robot: Robot, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return poses, rates and accelerations, (count, 6) each, m, rad, s, that keep every limit.

    Each coordinate is drawn from its reach, then the pose moves back towards home, the rates and
    the accelerations towards zero, until the limits of robot and run are kept. The range of
    unlimited speeds and accelerations is the struts' lengths per s and s². Fewer states are
    returned if the limits admit hardly any; the state at rest at home is always among them.
    """
    model, rng = LimitModel.of(robot), np.random.default_rng(seed)
    ranges = np.array([[-one.back.travel, one.ahead.travel] for one in reach(robot)])
    states = np.concatenate([robot.home, np.zeros(2 * COORDINATES)])[None, :]
    for _ in range(_DRAWS):
        states = np.concatenate([_draw(model, ranges, count, rng), states])
        if len(states) > count:
            break
    pose, rate, acceleration = np.split(states[:count], 3, axis=1)
    return pose, rate, acceleration


def _draw(model: LimitModel, ranges: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw states and return those that keep the limits, (≤ count, 18)."""
    robot = model.robot
    home = robot.home[None, :]
    side = side_of(robot, home)[0]

    def kept(states: Array) -> Mask:
        within = np.all(model.violations(states) <= 0, axis=1)
        return within & (side_of(robot, states[:, :COORDINATES]) == side)

    def move(states: Array, part: int, change: Array) -> Array:
        """Change pose, rate or acceleration by a random share of the largest admissible change."""
        whole = np.zeros_like(states)
        whole[:, part * COORDINATES : (part + 1) * COORDINATES] = change
        share = _largest_shares(lambda shares: kept(states + shares[:, None] * whole), count)
        return states + (share * np.sqrt(rng.uniform(size=count)))[:, None] * whole

    offset = rng.uniform(ranges[:, 0], ranges[:, 1], (count, COORDINATES))
    states = move(states_at_rest(np.repeat(home, count, axis=0)), 0, offset)
    _, jacobian = robot.lengths_and_jacobian(states[:, :COORDINATES])
    for part, key in enumerate(("strut_speed", "strut_acceleration"), start=1):
        struts = _pace(robot, key) * rng.uniform(-1, 1, (count, COORDINATES))
        states = move(states, part, solve_rows(jacobian, struts))
    return states[kept(states)]


def _pace(robot: Robot, key: str) -> Array:
    """Return the largest drawn rate of the struts, (6,): the limit or the length at home per s."""
    limit, free = robot.limit(key), robot.inverse_kinematics(robot.home)
    return free if limit is None else np.where(np.isfinite(limit.upper), limit.upper, free)


def _largest_shares(kept: Callable[[Array], Mask], count: int) -> Array:
    """Return by bisection the largest admissible shares, (count,), up to 1."""
    low, high = np.zeros(count), np.ones(count)
    whole = kept(high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        fits = kept(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(whole, 1.0, low)
