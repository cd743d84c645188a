"""Information and criterion of a trajectory by the exact model: the reported values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.information import fisher
from expdesign.information.criteria import Criterion
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory


@dataclass(frozen=True)
class Evaluator:
    """Evaluation of a robot's trajectories: Σ, criterion, scaling, parameters and prior."""

    robot: Robot
    covariance: Array
    """(6, 6), full Σ of the force noise, N²."""
    criterion: Criterion
    scaling: Array
    """(m,), scale of every parameter (1 for SI)."""
    names: tuple[str, ...]
    memory: fisher.PeriodicNoise | None = None
    """Coloured noise, which replaces Σ; None: white."""
    prior: fisher.PriorMachine | None = None
    """Prior knowledge: the judged parameters are then those that have changed."""

    def information(self, trajectory: FourierTrajectory, samples: int) -> Array:
        """Return F of the judged parameters over one period of `samples` samples, SI, (k, k).

        With a prior it is S, the information of the change.
        """
        return self.judged(self.whole_information(trajectory, samples), samples)

    def whole_information(self, trajectory: FourierTrajectory, samples: int) -> Array:
        """Return F of one period for `judged`: with a prior that of all parameters."""
        motion = trajectory.sample(trajectory.sample_times(samples))
        return self.of_regressors(self.robot.regressor(*motion), trajectory.omega)

    def of_regressors(self, regressors: Array, omega: float) -> Array:
        """Return F of A at the samples of one period, (N, 6, m); see `whole_information`."""
        chosen = regressors if self.prior is not None else regressors[:, :, self.columns]
        if self.memory is not None:
            return self.memory.information(chosen, omega)
        return fisher.information_matrix(chosen, self.covariance)

    def judged(self, information: Array, samples: float) -> Array:
        """Return the information of the judged parameters, (k, k), from F over so many samples.

        A prior counts in proportion to the samples of its experiment.
        """
        return information if self.prior is None else self.prior.information(information, samples)

    @property
    def columns(self) -> NDArray[np.intp]:
        """Columns of the judged parameters in A."""
        every = self.robot.parameter_names
        return np.array([every.index(name) for name in self.names], dtype=np.intp)

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
