"""Forward kinematics: the pose that belongs to measured strut lengths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from constraints.arrays import Array

LengthsAndJacobian = Callable[[Array], tuple[Array, Array]]

TOLERANCE = 1e-12
"""Largest residual of a solved pose, relative to the strut length."""

_NEWTON_STEPS = 40
_WALK = np.linspace(0, 1, 11)[1:]
_WALK_TOLERANCE = 1e-8
_HALVINGS = 30


class ForwardKinematicsError(ArithmeticError):
    """No pose was found that has the strut lengths asked for, in the rows `samples`."""

    def __init__(self, samples: tuple[int, ...], residual: float) -> None:
        self.samples = samples
        shown = ", ".join(str(k) for k in samples[:5]) + (" …" if len(samples) > 5 else "")  # noqa: PLR2004
        super().__init__(
            f"forward kinematics did not converge for sample(s) {shown}: the strut lengths are "
            f"missed by up to {residual:.3g} m; are they out of reach or in another unit?"
        )


def solve_pose(function: LengthsAndJacobian, lengths: Array, guess: Array) -> Array:
    """Return the poses (N, 6) of the lengths (N, 6) on the guess's assembly branch.

    Damped Newton from the guess; the rows that do not converge are taken again along the
    straight line from the guess's lengths to theirs, in small steps, which keeps to the branch
    of the guess.

    Parameters
    ----------
    function : callable
        Poses (N, 6) → lengths (N, 6) and their Jacobian to the pose (N, 6, 6); m, rad.

    Raises
    ------
    ForwardKinematicsError
        Some rows have no solution that can be reached.
    """
    poses, residual = _newton(function, lengths, guess)
    bound = TOLERANCE * np.max(np.abs(lengths), axis=1)
    # Newton may also jump to another way to assemble the machine: far from the guess, it is
    # checked by walking there.
    far = np.max(np.abs(poses[:, 3:] - guess[:, 3:]), axis=1) > np.pi / 4
    again = np.flatnonzero((residual > bound) | far)
    if again.size:
        poses[again], residual[again] = _follow(function, lengths[again], guess[again])
    failed = np.flatnonzero(~(residual <= bound))
    if failed.size:
        raise ForwardKinematicsError(tuple(int(k) for k in failed), float(np.max(residual[failed])))
    return poses


def _newton(
    function: LengthsAndJacobian, lengths: Array, guess: Array, tolerance: float = TOLERANCE
) -> tuple[Array, Array]:
    poses = guess.copy()
    bound = tolerance * np.max(np.abs(lengths), axis=1)
    values, jacobian = function(poses)
    residual = np.max(np.abs(values - lengths), axis=1)
    for _ in range(_NEWTON_STEPS):
        reached = residual <= bound
        step = _newton_step(jacobian, lengths - values)
        factor = np.ones(len(poses))
        trial = poses + step
        for _ in range(_HALVINGS):
            new_values, new_jacobian = function(trial)
            new_residual = np.max(np.abs(new_values - lengths), axis=1)
            worse = ~(new_residual <= residual)
            if not np.any(worse):
                break
            factor = np.where(worse, factor / 2, factor)
            trial = np.where(worse[:, None], poses + factor[:, None] * step, trial)
        better = new_residual <= residual
        poses = np.where(better[:, None], trial, poses)
        values = np.where(better[:, None], new_values, values)
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
        residual = np.where(better, new_residual, residual)
        # One step beyond the tolerance: convergence is quadratic, and it costs no more.
        if np.all(reached | ~better):
            break
    return poses, residual


def _newton_step(jacobian: Array, mismatch: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(jacobian, mismatch[:, :, None])[:, :, 0], np.float64)
    except np.linalg.LinAlgError:
        pairs = zip(jacobian, mismatch, strict=True)
        steps = [np.linalg.lstsq(j, r, rcond=1e-12)[0] for j, r in pairs]
        return np.array(steps, dtype=np.float64)


def _follow(function: LengthsAndJacobian, lengths: Array, guess: Array) -> tuple[Array, Array]:
    start, _ = function(guess)
    poses = guess.copy()
    residual = np.full(len(poses), np.inf)
    for share in _WALK:
        tolerance = TOLERANCE if share == 1 else _WALK_TOLERANCE
        poses, residual = _newton(function, start + share * (lengths - start), poses, tolerance)
    return poses, residual
