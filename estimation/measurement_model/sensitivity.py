"""Predicted lengths and forces along a motion, with their derivatives to ξ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model.kernels import force_kernel
from estimation.measurement_model.motion import HarmonicMotion, MotionBasis
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import Robot
from expdesign.robot.kernels import length_kernel


@dataclass(frozen=True, eq=False)
class LengthPrediction:
    """Strut lengths along a motion.

    Attributes
    ----------
    lengths : (S, 6)
        m.
    slope : (S, 6, x)
        ∂lengths/∂ξ.
    """

    lengths: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class ForcePrediction:
    """Actuator forces along a motion, linear in the parameters.

    Attributes
    ----------
    regressors : (S, 6, m)
        A with the friction signs given.
    slope : (S, 6, x)
        ∂(A p)/∂ξ at the parameters given, signs held.
    """

    regressors: Array
    slope: Array


def predict_lengths(
    robot: Robot, motion: HarmonicMotion, times: Array, *, free_frequency: bool = False
) -> LengthPrediction:
    """Return lengths at the times given, s, and their slope to ξ."""
    basis = motion.basis(times)
    state = basis.state(motion.table)
    lengths, jacobian = length_kernel()(state[:, :COORDINATES], robot.geometry_vector)
    full = np.zeros((len(times), COORDINATES, 3 * COORDINATES))
    full[:, :, :COORDINATES] = jacobian
    return LengthPrediction(lengths, chain(full, basis, motion, orders=1, free=free_frequency))


def predict_forces(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    signs: Array,
    parameters: Array,
    *,
    free_frequency: bool = False,
) -> ForcePrediction:
    """Return A at the times given, s, and the slope of A p to ξ.

    Parameters
    ----------
    signs : (S, s)
        Friction signs of the rates that the terms use, at the same instants.
    parameters : (m,)
        SI.
    """
    basis = motion.basis(times)
    state = basis.state(motion.table)
    kernel = force_kernel(robot.terms)
    regressors, slope = kernel(state, signs, robot.machine, parameters)
    return ForcePrediction(regressors, chain(slope, basis, motion, orders=3, free=free_frequency))


def chain(
    slope: Array, basis: MotionBasis, motion: HarmonicMotion, *, orders: int, free: bool
) -> Array:
    """Carry slopes to the state, (S, r, 18), over to ξ: (S, r, x).

    Parameters
    ----------
    orders : int
        How many of pose, rate and acceleration the slope depends on.
    free : bool
        Append the column of ω.
    """
    count, rows, _ = slope.shape
    width = motion.table.size
    result = np.empty((count, rows, width + int(free)))
    coefficients = result[:, :, :width].reshape(count, rows, COORDINATES, -1)
    coefficients[...] = 0.0
    for order in range(orders):
        part = slope[:, :, COORDINATES * order : COORDINATES * (order + 1)]
        coefficients += part[:, :, :, None] * basis.derivatives[order][:, None, None, :]
    result[:, :, :width] = coefficients.reshape(count, rows, width)
    if free:
        result[:, :, width] = np.einsum("sri,si->sr", slope, basis.frequency_slope(motion.table))
    return result
