"""An experiment linearised at an estimate: residuals, and the columns along which they can move.

Near the estimate the residuals are e = ε − A δp − G δξ of the forces, G = ∂(A p)/∂ξ, and
r = ε_l − L δξ of the lengths, L = ∂l/∂ξ. Every diagnostic works on these, so that the errors of the
parameters and of the motion are counted in each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.cells import PhaseCells
from estimation.estimators.experiment import Experiment
from estimation.kinematics.fourier_fit import CHUNK, length_residuals
from estimation.measurement_model import HarmonicMotion, predict_forces, predict_lengths
from estimation.measurement_model.kernels import force_kernel
from estimation.processing import NoiseEstimate
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals and columns of one experiment, one row per phase.

    Attributes
    ----------
    times : (R,)
        Of the rows, s.
    counts : (R,)
        Samples that each row is the mean of.
    forces : (R, 6)
        Measured minus predicted, N: means over the periods.
    regressors : (R, 6, m)
        A, all parameters.
    motion_columns : (R, 6, x)
        G; x = 0 after pointwise kinematics.
    delay_column : (R, 6) or None
        Change of the predicted force per second that the force channel lags, N/s.
    free : (m,) of bool
        Parameters that were estimated.
    sign_variance : (R, 6)
        Variance of the predicted force that the unknown signs of dry friction make, N².
    length_times : (R',)
        s.
    lengths : (R', 6) or None
        Measured minus predicted, m; None after pointwise kinematics.
    length_counts : (R',)
    length_columns : (R', 6, x)
        L.
    force_scatter : NoiseEstimate or None
        Of one sample about the means, from repetition alone.
    position, speed : (R, 6)
        Strut lengths and rates along the motion, m and m/s.
    force_rows : (T, 6)
        Residuals of the record's single rows, N.
    length_rows : (T, 6) or None
        Likewise, m.
    """

    times: Array
    counts: Array
    forces: Array
    regressors: Array
    motion_columns: Array
    delay_column: Array | None
    free: NDArray[np.bool_]
    sign_variance: Array
    length_times: Array
    lengths: Array | None
    length_counts: Array
    length_columns: Array
    force_scatter: NoiseEstimate | None
    position: Array
    speed: Array
    force_rows: Array
    length_rows: Array | None

    @property
    def columns(self) -> Array:
        """(R, 6, k + x) columns of the free parameters and of the motion."""
        return np.concatenate([self.regressors[:, :, self.free], self.motion_columns], axis=2)


def linearise(
    robot: Robot,
    experiment: Experiment,
    values: Array,
    free: NDArray[np.bool_],
    motion: HarmonicMotion | None,
) -> Linearisation:
    """Linearise an experiment at parameters and a motion.

    Parameters
    ----------
    values : (m,)
        Parameters, SI.
    free : (m,) of bool
        Those that were estimated.
    motion : HarmonicMotion or None
        None: the pointwise motion of the experiment.
    """
    if motion is None:
        return _pointwise(robot, experiment, values, free)
    record = experiment.record
    cells = _cells(experiment, record.force_times, record.force_counts)
    signs = experiment.signs(robot, motion)
    free_frequency = experiment.fit is not None and experiment.fit.free_frequency
    basis = motion.basis(record.force_times)
    state = basis.state(motion.table)
    change = np.concatenate([part @ motion.table.T for part in basis.derivatives[1:]], axis=1)
    residuals, regressors, slopes, delays, doubts = [], [], [], [], []
    unsure = 1 - signs**2
    for first in range(0, record.samples, CHUNK):
        part = slice(first, first + CHUNK)
        predicted = predict_forces(
            robot,
            motion,
            record.force_times[part],
            signs[part],
            values,
            free_frequency=free_frequency,
        )
        _, to_state = force_kernel(robot.terms)(state[part], signs[part], robot.machine, values)
        residuals.append(record.forces[part] - predicted.regressors @ values)
        regressors.append(predicted.regressors)
        slopes.append(predicted.slope)
        delays.append(-np.einsum("sji,si->sj", to_state, change[part]))
        doubts.append(_sign_variance(robot, state[part], signs[part], unsure[part], values))
    rows = np.concatenate(residuals)
    struts = robot.strut_motion(state[:, :6], state[:, 6:12], state[:, 12:])
    lengths, length_cells, length_columns = _lengths(
        robot, experiment, motion, free_frequency=free_frequency
    )
    return Linearisation(
        times=_phase_times(experiment, cells, record.force_times),
        counts=cells.totals,
        forces=cells.mean(rows),
        regressors=cells.mean(np.concatenate(regressors)),
        motion_columns=cells.mean(np.concatenate(slopes)),
        delay_column=cells.mean(np.concatenate(delays)),
        free=free,
        sign_variance=cells.mean(np.concatenate(doubts)),
        length_times=_phase_times(experiment, length_cells, record.length_times),
        lengths=length_cells.mean(lengths),
        length_counts=length_cells.totals,
        length_columns=length_columns,
        force_scatter=record.force_scatter if cells.index is None else cells.scatter(rows),
        position=cells.mean(struts.length),
        speed=cells.mean(struts.length_rate),
        force_rows=rows,
        length_rows=lengths,
    )


def _cells(experiment: Experiment, times: Array, counts: Array) -> PhaseCells:
    record = experiment.record
    if record.averaged:
        return PhaseCells.rows(counts)
    return PhaseCells.of(times, counts, record.period, record.step)


def _phase_times(experiment: Experiment, cells: PhaseCells, times: Array) -> Array:
    return times if cells.index is None else cells.mean(np.mod(times, experiment.record.period))


def _sign_variance(robot: Robot, state: Array, signs: Array, unsure: Array, values: Array) -> Array:
    """Return Σ_i (∂Q/∂sign_i)² Var(sign_i), (S, 6); nearly all samples have no doubtful sign."""
    result = np.zeros((len(state), ACTUATORS))
    kernel = force_kernel(robot.terms)
    for column in range(signs.shape[1]):
        rows = np.flatnonzero(unsure[:, column] > 1e-3)  # noqa: PLR2004 - below it nothing is seen
        if not len(rows):
            continue
        ends = []
        for end in (-1.0, 1.0):
            changed = signs[rows].copy()
            changed[:, column] = end
            regressors, _ = kernel(state[rows], changed, robot.machine, values)
            ends.append(regressors @ values)
        result[rows] += ((ends[1] - ends[0]) / 2) ** 2 * unsure[rows, column][:, None]
    return result


def _lengths(
    robot: Robot, experiment: Experiment, motion: HarmonicMotion, *, free_frequency: bool
) -> tuple[Array, PhaseCells, Array]:
    record = experiment.record
    cells = _cells(experiment, record.length_times, record.length_counts)
    columns = [
        predict_lengths(
            robot,
            motion,
            record.length_times[first : first + CHUNK],
            free_frequency=free_frequency,
        ).slope
        for first in range(0, record.samples, CHUNK)
    ]
    return length_residuals(robot, record, motion), cells, cells.mean(np.concatenate(columns))


def _pointwise(
    robot: Robot, experiment: Experiment, values: Array, free: NDArray[np.bool_]
) -> Linearisation:
    pointwise = experiment.pointwise
    if pointwise is None:
        raise ValueError("an experiment has a fitted or a pointwise motion")
    record, state = experiment.record, pointwise.state
    cells = _cells(experiment, experiment.times, experiment.counts)
    regressors = experiment.regressors(robot)
    rows = experiment.forces - regressors @ values
    struts = robot.strut_motion(state[:, :6], state[:, 6:12], state[:, 12:])
    none = np.zeros((0, ACTUATORS, 0))
    return Linearisation(
        times=_phase_times(experiment, cells, experiment.times),
        counts=cells.totals,
        forces=cells.mean(rows),
        regressors=cells.mean(regressors),
        motion_columns=np.zeros((len(cells.totals), ACTUATORS, 0)),
        delay_column=None,
        free=free,
        sign_variance=np.zeros((len(cells.totals), ACTUATORS)),
        length_times=np.zeros(0),
        lengths=None,
        length_counts=np.zeros(0),
        length_columns=none,
        force_scatter=record.force_scatter if cells.index is None else cells.scatter(rows),
        position=cells.mean(struts.length),
        speed=cells.mean(struts.length_rate),
        force_rows=rows,
        length_rows=None,
    )
