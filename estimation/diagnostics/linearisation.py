"""Linearisation of an experiment at an estimate: residuals and their sensitivities.

Near the estimate the residuals of the forces are e = ε − A δp − G δξ, G = ∂(A p)/∂ξ, those of the
lengths r = ε_l − L δξ, L = ∂l/∂ξ. Every diagnostic uses this linearisation, so that each of them
accounts for the errors of the parameters and of the motion.

Samples of equal phase form one row. Averaged records have the same phases in every period. In other
records a cell contains the samples within one controller step of the phase, near replicates in the
sense of the lack-of-fit test. Residuals and columns of the model are averaged over the same cells
with the same weights; the only approximation is a constant model error within a step.

A `Signature` contains the columns that an effect adds to the forces and lengths.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.kinematics.fourier_fit import length_residuals
from estimation.measurement_model import HarmonicMotion, predict_forces, predict_lengths
from estimation.measurement_model.prediction import chunks, force_kernel
from estimation.processing import NoiseEstimate, NoiseModel
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot

_UNSURE = 1e-3
"""Variance of a friction sign below which its effect on the forces is negligible."""


@dataclass(frozen=True, eq=False)
class PhaseCells:
    """Assignment of rows to cells of equal phase."""

    index: NDArray[np.intp] | None
    """(T,), cell of each row; None: every row is its own cell (averaged records)."""
    weights: Array
    """(T,), number of samples (or weight) of each row."""
    totals: Array
    """(R,), weight of each cell."""

    @classmethod
    def rows(cls, weights: Array) -> PhaseCells:
        """Make every row its own cell."""
        return cls(None, weights, weights)

    @classmethod
    def of(cls, times: Array, weights: Array, period: float, step: float) -> PhaseCells:
        """Sort rows by their phase into cells of one step; times in s."""
        count = max(1, round(period / step))
        cell = np.floor(np.mod(times / period, 1.0) * count).astype(np.intp) % count
        used, index = np.unique(cell, return_inverse=True)
        totals = np.bincount(index, weights, minlength=len(used)).astype(np.float64)
        return cls(index, weights, totals)

    def mean(self, values: Array) -> Array:
        """Return the weighted mean in every cell, (R, …), of values (T, …)."""
        if self.index is None:
            return values
        count = len(values)
        flat = (values.T * self.weights).T.reshape(count, math.prod(values.shape[1:]))
        places = (self.index, np.arange(count))
        gather = sparse.csr_array((np.ones(count), places), (len(self.totals), count))
        return (gather @ flat / self.totals[:, None]).reshape(len(self.totals), *values.shape[1:])

    def scatter(self, values: Array) -> NoiseEstimate | None:
        """Return the covariance of the scatter within cells; None if no cell has two rows."""
        if self.index is None:
            return None
        freedom = float(np.sum(self.weights) - len(self.totals))
        if freedom < 1:
            return None
        rest = (values - self.mean(values)[self.index]) * np.sqrt(self.weights)[:, None]
        return NoiseEstimate(rest.T @ rest / freedom, freedom)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals and sensitivities of one experiment, one row per phase."""

    times: Array
    """(R,), times of the rows, s."""
    counts: Array
    """(R,), number of samples averaged in each row."""
    forces: Array
    """(R, 6), measured minus predicted, N: means over the periods."""
    regressors: Array
    """(R, 6, m), A of all parameters."""
    motion_columns: Array
    """(R, 6, x), G; x = 0 after pointwise kinematics."""
    free: NDArray[np.bool_]
    """(m,), parameters that were estimated."""
    sign_variance: Array
    """(R, 6), variance of the predicted force due to unknown signs of dry friction, N²."""
    lengths: Array | None
    """(R', 6), measured minus predicted, m; None after pointwise kinematics."""
    length_counts: Array
    """(R',), number of samples averaged in each row of the lengths."""
    length_columns: Array
    """(R', 6, x), L."""
    force_scatter: NoiseEstimate | None
    """Covariance of one sample about the means, from repetition alone."""
    position: Array
    speed: Array
    """(R, 6), strut lengths and rates along the motion, m and m/s."""
    force_rows: Array
    """(T, 6), residuals of the record's single rows, N."""
    length_rows: Array | None
    """(T, 6), residual lengths of the single rows, m."""
    cells: PhaseCells
    length_cells: PhaseCells
    """Cells in which forces and lengths were averaged."""

    @property
    def columns(self) -> Array:
        """(R, 6, k + x), columns of the free parameters and of the motion."""
        return np.concatenate([self.regressors[:, :, self.free], self.motion_columns], axis=2)

    def apply_filters(self, noise: NoiseModel) -> Linearisation:
        """Apply the filters that whiten coloured noise."""
        changes: dict[str, Any] = {}
        if noise.forces.filter is not None:
            names = ("forces", "regressors", "motion_columns")
            changes |= {name: noise.forces.filter(getattr(self, name)) for name in names}
        if noise.lengths.filter is not None and self.lengths is not None:
            changes["lengths"] = noise.lengths.filter(self.lengths)
            changes["length_columns"] = noise.lengths.filter(self.length_columns)
        return replace(self, **changes) if changes else self


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
    values, free : (m,)
        Parameters, SI, and flags of those that were estimated.
    motion : HarmonicMotion or None
        None: the pointwise motion of the experiment.
    """
    record, times = experiment.record, experiment.times
    cells = _cells(experiment, times, experiment.counts)
    length_cells = PhaseCells.rows(np.zeros(0))
    lengths, length_columns = None, np.zeros((0, ACTUATORS, 0))
    if motion is None:
        if experiment.pointwise is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        state, regressors = experiment.pointwise.state, experiment.fitted_regressors
        slope = np.zeros((len(times), ACTUATORS, 0))
        sign_variance = np.zeros((len(times), ACTUATORS))
    else:
        state = motion.at(times).state()
        signs = experiment.signs(robot, motion)
        parts = [
            predict_forces(robot, motion, times[part], signs[part], values)
            for part in chunks(len(times))
        ]
        regressors, slope = map(np.concatenate, zip(*parts, strict=True))
        sign_variance = _sign_variance(robot, state, signs, values)
        length_times = record.lengths.times
        length_cells = _cells(experiment, length_times, record.lengths.counts)
        lengths = length_residuals(robot, record, motion)
        slopes = [
            predict_lengths(robot, motion, length_times[part])[1] for part in chunks(record.samples)
        ]
        length_columns = length_cells.mean(np.concatenate(slopes))
    rows = experiment.forces - regressors @ values
    struts = robot.strut_motion(*np.split(state, 3, axis=1))
    return Linearisation(
        times=times if cells.index is None else cells.mean(np.mod(times, record.period)),
        counts=cells.totals,
        forces=cells.mean(rows),
        regressors=cells.mean(regressors),
        motion_columns=cells.mean(slope),
        free=free,
        sign_variance=cells.mean(sign_variance),
        lengths=None if lengths is None else length_cells.mean(lengths),
        length_counts=length_cells.totals,
        length_columns=length_columns,
        force_scatter=record.forces.scatter if cells.index is None else cells.scatter(rows),
        position=cells.mean(struts.length),
        speed=cells.mean(struts.length_rate),
        force_rows=rows,
        length_rows=lengths,
        cells=cells,
        length_cells=length_cells,
    )


def _cells(experiment: Experiment, times: Array, counts: Array) -> PhaseCells:
    record = experiment.record
    if record.averaged:
        return PhaseCells.rows(counts)
    return PhaseCells.of(times, counts, record.period, record.step)


def _sign_variance(robot: Robot, state: Array, signs: Array, values: Array) -> Array:
    """Return Σ_i (∂Q/∂sign_i)² Var(sign_i), (S, 6); only few samples have an uncertain sign."""
    result = np.zeros((len(state), ACTUATORS))
    kernel = force_kernel(robot.terms)
    variance = 1 - signs**2
    for column in range(signs.shape[1]):
        rows = np.flatnonzero(variance[:, column] > _UNSURE)
        if not len(rows):
            continue
        ends = []
        for end in (-1.0, 1.0):
            changed = signs[rows].copy()
            changed[:, column] = end
            regressors, _ = kernel(state[rows], changed, robot.machine, values)
            ends.append(regressors @ values)
        result[rows] += ((ends[1] - ends[0]) / 2) ** 2 * variance[rows, column][:, None]
    return result


@dataclass(frozen=True, eq=False)
class Signature:
    """Columns of q effects in forces and lengths, per unit of each effect."""

    forces: Array
    """(R, 6, q), N."""
    lengths: Array
    """(R', 6, q), m; R' = 0 after pointwise kinematics."""

    @classmethod
    def of_forces(cls, part: Linearisation, columns: Array) -> Self:
        """Build the signature of effects on the forces alone, (R, 6, q)."""
        rows = len(part.length_counts)
        return cls(columns, np.zeros((rows, *columns.shape[1:])))

    @classmethod
    def none(cls, part: Linearisation) -> Self:
        """Build the signature of no effects."""
        return cls.of_forces(part, np.zeros((*part.forces.shape, 0)))

    @classmethod
    def concatenate(cls, parts: Sequence[Signature]) -> Self:
        """Concatenate effects; at least one part."""
        return cls(
            np.concatenate([part.forces for part in parts], axis=2),
            np.concatenate([part.lengths for part in parts], axis=2),
        )

    @property
    def count(self) -> int:
        """Number of effects, q."""
        return self.forces.shape[2]

    def select(self, places: Sequence[int] | NDArray[np.intp]) -> Signature:
        """Return the effects at these indices."""
        chosen = np.asarray(places, dtype=np.intp)
        return Signature(self.forces[:, :, chosen], self.lengths[:, :, chosen])
