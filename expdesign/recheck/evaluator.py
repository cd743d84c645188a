"""Information and criterion of a trajectory by the exact model: the reported values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.information import fisher
from expdesign.information.criteria import Criterion
from expdesign.information.marginal import Marginal
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation
from expdesign.robot.fixed_lengths import fixed_length_columns
from expdesign.trajectory import FourierTrajectory

_FINEST = 256
"""Samples of one period that resolve the derivatives of a deviating motion."""


@dataclass(frozen=True)
class Evaluator:
    """Evaluation of a robot's trajectories: Σ, criterion, scaling, unknowns and interest."""

    robot: Robot
    covariance: Array
    """(6, 6), full Σ of the force noise, N²."""
    criterion: Criterion
    scaling: Array
    """(m,), scale of every parameter (1 for SI); with `judged_scales` it is not used."""
    names: tuple[str, ...]
    """(k,), the judged quantities: parameters, unless there is a marginal."""
    memory: fisher.PeriodicNoise | None = None
    """Coloured noise, which replaces Σ; None: white."""
    marginal: Marginal | None = None
    """The judged quantities among the unknowns; None: these are all."""
    unknown: tuple[str, ...] | None = None
    """Parameters among the unknowns; None: the judged ones, with a marginal all."""
    deviating: tuple[Deviation, ...] = ()
    """Deviations of the machine among the unknowns, behind the parameters."""
    judged_scales: Array | None = None
    """(k,), scales of the judged quantities; None: those of the parameters."""

    def information(self, trajectory: FourierTrajectory, samples: int) -> Array:
        """Return the information on the judged quantities over `samples` of one period, (k, k).

        In SI. With a marginal it is S, where the other unknowns are nuisances.
        """
        return self.judged(self.whole_information(trajectory, samples), samples)

    def whole_information(self, trajectory: FourierTrajectory, samples: int) -> Array:
        """Return F of all unknowns over one period, (M, M), for `judged`."""
        motion = trajectory.sample(trajectory.sample_times(samples))
        regressors = self.robot.regressor(*motion)
        if not self.deviating:
            return self.of_regressors(regressors, trajectory.omega)
        finer = -(-_FINEST // samples)
        fine = trajectory.sample(trajectory.sample_times(samples * finer))
        columns = fixed_length_columns(self.robot, fine, trajectory.omega, self.deviating)
        chosen = [regressors[:, :, self.columns], columns[::finer]]
        return self._information(np.concatenate(chosen, axis=2), trajectory.omega)

    def of_regressors(self, regressors: Array, omega: float) -> Array:
        """Return F of the parameters from A at the samples of one period, (N, 6, m)."""
        every = self.marginal is not None and self.unknown is None
        return self._information(regressors if every else regressors[:, :, self.columns], omega)

    def _information(self, columns: Array, omega: float) -> Array:
        if self.memory is not None:
            return self.memory.information(columns, omega)
        return fisher.information_matrix(columns, self.covariance)

    def judged(self, information: Array, samples: float | None = None) -> Array:
        """Return the information on the judged quantities, (k, k), from F over so many samples.

        Priors count in proportion to the samples of their experiment, or entirely without a number
        of samples.
        """
        if self.marginal is None:
            return information
        count = self.marginal.samples if samples is None else samples
        return self.marginal.information(information, count)

    @property
    def columns(self) -> NDArray[np.intp]:
        """Columns of the unknown parameters in A; without a marginal, of the judged ones."""
        every = self.robot.parameter_names
        names = self.names if self.unknown is None else self.unknown
        return np.array([every.index(name) for name in names], dtype=np.intp)

    def log_det(self, information: Array) -> float:
        """Return log det F in SI units; raises `SingularInformationError`."""
        return fisher.log_det(information, self.names)

    def value(self, information: Array) -> float:
        """Return the criterion of F in its scaling.

        Raises
        ------
        SingularInformationError
            F is singular to working precision.
        """
        whole = fisher.ScaledInformation.of(information)
        if whole.is_singular():
            raise fisher.SingularInformationError(whole.weak_directions(self.names))
        if self.criterion.invariant:
            # Eigenvalues of a badly scaled F are less accurate than its factor.
            return self.log_det(information)
        scale = self.judged_scales
        if scale is None:
            scale = self.scaling[self.columns]
        scaled = information * np.multiply.outer(scale, scale)
        inverse = fisher.parameter_covariance(information, self.names) / np.multiply.outer(
            scale, scale
        )
        return self.criterion.value(_eigenvalues(scaled, inverse))

    def gain(self, merit: float, best: float) -> float:
        """Return the gain of one merit over another per parameter, as a logarithm."""
        if not np.isfinite(best):
            return np.inf
        if self.criterion.invariant:
            return (merit - best) / len(self.names)
        ratio = merit / best if self.criterion.larger_is_better else best / merit
        return float(np.log(ratio)) if ratio > 0 else -np.inf

    def merit(self, trajectory: FourierTrajectory, samples: int) -> float:
        """Return a number that is larger for better trajectories; −inf for a singular F."""
        try:
            value = self.value(self.information(trajectory, samples))
        except fisher.SingularInformationError:
            return -np.inf
        return value if self.criterion.larger_is_better else -value


def _eigenvalues(matrix: Array, inverse: Array) -> Array:
    """Return the eigenvalues, ascending, the small ones from the inverse for accuracy."""
    large = np.asarray(np.linalg.eigvalsh(matrix), dtype=np.float64)
    small = 1 / np.asarray(np.linalg.eigvalsh(inverse), dtype=np.float64)[::-1]
    middle = np.sqrt(large[-1] * np.abs(small[0]))
    return np.where((small > 0) & (small < middle), small, large)
