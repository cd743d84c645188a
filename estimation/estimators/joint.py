"""The joint normal equations of (p, ξ): what maximum likelihood solves, and its information.

With Σ⁻¹ = SᵀS and Δ⁻¹ = DᵀD the rows are S (q − A(ξ) p) and D (l − l(ξ)), each weighted by how many
samples it is the mean of. The parameters meet the motion of every experiment, the motions do not
meet each other: the matrix is an arrow, and the ξ are eliminated one experiment at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.kinematics.fourier_fit import CHUNK
from estimation.measurement_model import HarmonicMotion, predict_forces, predict_lengths
from expdesign.information.fisher import whitening
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class JointBlock:
    """One experiment's part of the normal equations.

    Attributes
    ----------
    cost : float
        ½(‖D δ‖² + ‖S η‖²) times two.
    pp : (k, k)
    px : (k, x)
    xx : (x, x)
    gp : (k,)
    gx : (x,)
        Gradients: how much the cost falls along p and ξ, halved.
    """

    cost: float
    pp: Array
    px: Array
    xx: Array
    gp: Array
    gx: Array

    def eliminated(self, damping: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Eliminate ξ: return the reduced matrix and gradient of p, and X, x of ξ = x − X p.

        Raises
        ------
        numpy.linalg.LinAlgError
            ξ is not determined.
        """
        diagonal = np.sqrt(np.diag(self.xx))
        scaled = self.xx / np.multiply.outer(diagonal, diagonal)
        scaled = scaled + damping * np.eye(len(diagonal))
        factor = sla.cho_factor(scaled)
        right = np.concatenate([self.px.T, self.gx[:, None]], axis=1) / diagonal[:, None]
        solved = sla.cho_solve(factor, right) / diagonal[:, None]
        slope, offset = solved[:, :-1], solved[:, -1]
        return self.pp - self.px @ slope, self.gp - self.px @ offset, slope, offset


def joint_block(
    robot: Robot,
    experiment: Experiment,
    motion: HarmonicMotion,
    values: Array,
    free: NDArray[np.bool_],
    *,
    signs: Array | None = None,
    free_frequency: bool = False,
) -> JointBlock:
    """Assemble one experiment's normal equations at (p, ξ).

    Parameters
    ----------
    motion : HarmonicMotion
        ξ.
    values : (m,)
        p.
    free : (m,) of bool
        Parameters that are estimated.
    signs : (S, s), optional
        Friction signs; by default the expected ones along `motion`.
    """
    record = experiment.record
    held = experiment.signs(robot, motion) if signs is None else signs
    count = int(np.count_nonzero(free))
    width = motion.table.size + int(free_frequency)
    total = np.zeros((count + width, count + width))
    gradient = np.zeros(count + width)
    cost = 0.0
    white = whitening(experiment.noise.force_covariance)
    for first in range(0, record.samples, CHUNK):
        part = slice(first, first + CHUNK)
        forces = predict_forces(
            robot,
            motion,
            record.force_times[part],
            held[part],
            values,
            free_frequency=free_frequency,
        )
        weight = np.sqrt(record.force_counts[part])
        rest = record.forces[part] - forces.regressors @ values
        residual = (rest @ white.T * weight[:, None]).ravel()
        rows = np.concatenate([forces.regressors[:, :, free], forces.slope], axis=2)
        rows = (np.matmul(white, rows) * weight[:, None, None]).reshape(len(residual), -1)
        cost += float(residual @ residual)
        total += rows.T @ rows
        gradient += rows.T @ residual
    white = whitening(experiment.noise.length_covariance)
    for first in range(0, record.samples, CHUNK):
        part = slice(first, first + CHUNK)
        lengths = predict_lengths(
            robot, motion, record.length_times[part], free_frequency=free_frequency
        )
        weight = np.sqrt(record.length_counts[part])
        residual = ((record.lengths[part] - lengths.lengths) @ white.T * weight[:, None]).ravel()
        rows = (np.matmul(white, lengths.slope) * weight[:, None, None]).reshape(len(residual), -1)
        cost += float(residual @ residual)
        total[count:, count:] += rows.T @ rows
        gradient[count:] += rows.T @ residual
    return JointBlock(
        cost=cost,
        pp=total[:count, :count],
        px=total[:count, count:],
        xx=total[count:, count:],
        gp=gradient[:count],
        gx=gradient[count:],
    )


def reduced_information(blocks: Sequence[JointBlock]) -> Array:
    """Return F_p = F_pp − F_pξ F_ξξ⁻¹ F_ξp over all experiments, (k, k)."""
    return np.asarray(sum(block.eliminated()[0] for block in blocks))
