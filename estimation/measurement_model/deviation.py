"""Columns of what is not known exactly along an estimated motion: ∂(measured)/∂θ.

The entries of θ are those of `expdesign.robot.deviation`:

    chosen = tolerated(robot)  # those with a tolerance; or any of deviations(robot)
    z_forces = deviation_forces(robot, motion, times, signs, values, chosen)
    z_lengths = deviation_lengths(robot, motion, times, chosen)

A machine that deviates by θ at the same motion ξ and parameters p measures z_forces θ more force
and z_lengths θ more length, to first order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model.motion import HarmonicMotion
from estimation.measurement_model.prediction import chunks
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation
from expdesign.robot.deviation_slope import deviating_forces, length_deviation_columns


def deviation_forces(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    signs: Array,
    values: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> Array:
    """Return Z_f, (S, 6, t), in N per SI unit of each entry.

    Parameters
    ----------
    times : (S,)
        Of the forces, s.
    signs : (S, s)
        Of friction, as of `Experiment.signs`: held.
    values : (m,)
        Parameters, SI.
    chosen : sequence of Deviation
        The columns wanted.
    own_clock : bool
        ω was taken from the recording itself, not from a design (`deviating_forces`).
    """
    parts = [np.empty((0, ACTUATORS, len(chosen)))]
    for part in chunks(len(times)):
        state = _state(motion, times[part])
        found = deviating_forces(
            robot, state, times[part], signs[part], values, chosen, own_clock=own_clock
        )
        parts.append(found.columns)
    return np.concatenate(parts)


def predict_deviating_forces(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    signs: Array,
    values: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> tuple[Array, Array, Array]:
    """Return A, (S, 6, m), ∂(A p)/∂ξ, (S, 6, x), and Z_f, (S, 6, t), all at once."""
    found = deviating_forces(
        robot, _state(motion, times), times, signs, values, chosen, own_clock=own_clock
    )
    return found.regressors, motion.at(times).chain(found.state_slope), found.columns


def deviation_lengths(
    robot: Robot,
    motion: HarmonicMotion,
    times: Array,
    chosen: Sequence[Deviation],
    *,
    own_clock: bool = False,
) -> Array:
    """Return Z_l, (S, 6, t), in m per SI unit of each entry; `times` are those of the lengths."""
    parts = [np.empty((0, ACTUATORS, len(chosen)))]
    for part in chunks(len(times)):
        state = _state(motion, times[part])
        parts.append(
            length_deviation_columns(robot, state, times[part], chosen, own_clock=own_clock)
        )
    return np.concatenate(parts)


def _state(motion: HarmonicMotion, times: Array) -> Array:
    """Return λ and its first three derivatives, (S, 24)."""
    sampled = motion.at(times)
    return np.concatenate([sampled.state(), sampled.state(first=1)[:, 2 * COORDINATES :]], axis=1)
