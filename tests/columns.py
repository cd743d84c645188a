"""Predicted forces and lengths along a motion with their columns, from the kernels."""

import numpy as np

from estimation.measurement_model.prediction import (
    force_kernel,
    length_columns,
    state_with_jerk,
)
from expdesign.robot.deviation import deviating_forces, length_deviation_columns


def predict_lengths(robot, motion, times):
    """Return strut lengths, (S, 6), and their slope to ξ, (S, 6, x)."""
    lengths, columns = length_columns(robot, motion.at(times))
    return lengths, columns.dense()


def predict_forces(robot, motion, times, signs, parameters):
    """Return the regressors, (S, 6, m), and the slope of the forces to ξ, (S, 6, x)."""
    sampled = motion.at(times)
    kernel = force_kernel(robot.terms)
    regressors, slope = kernel(sampled.state(), signs, robot.machine, parameters)
    return regressors, sampled.chain(slope)


def deviation_forces(robot, motion, times, signs, values, chosen, *, own_clock=False):
    """Return the columns of deviations in the forces, (S, 6, t)."""
    state = state_with_jerk(motion.at(times))
    return deviating_forces(
        robot, state, times, signs, np.array(values), chosen, own_clock=own_clock
    ).columns


def deviation_lengths(robot, motion, times, chosen, *, own_clock=False):
    """Return the columns of deviations in the lengths, (S, 6, t)."""
    state = state_with_jerk(motion.at(times))
    return length_deviation_columns(robot, state, times, chosen, own_clock=own_clock)
