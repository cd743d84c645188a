"""The Cramér–Rao bound of the parameters with noise in forces and lengths.

F_p = F_pp − F_pξ F_ξξ⁻¹ F_ξp, the inverse of which no unbiased estimator's covariance falls below:
the motion is not known either, and what the lengths leave open of it costs information on p.
"""

from __future__ import annotations

from collections.abc import Sequence

from constraints.arrays import Array
from estimation.estimators import Experiment, Knowledge
from estimation.estimators.joint import joint_block, reduced_information
from estimation.measurement_model import HarmonicMotion
from expdesign.robot import Robot


def cramer_rao_covariance(
    robot: Robot,
    experiments: Sequence[Experiment],
    motions: Sequence[HarmonicMotion],
    knowledge: Knowledge,
    values: Array,
) -> Array:
    """Return the bound at (p, ξ) as a covariance, (m, m); zero for fixed parameters.

    Priors count as data. The friction signs are the plain ones at `motions` when the experiments
    have no spread of their rates (`Experiment.spread` zero), else the expected ones.
    """
    blocks = [
        joint_block(
            robot,
            experiment,
            motion,
            values,
            knowledge.free,
            free_frequency=experiment.fit is not None and experiment.fit.free_frequency,
        )
        for experiment, motion in zip(experiments, motions, strict=True)
    ]
    information = reduced_information(blocks) + knowledge.precision
    return knowledge.full(knowledge.inverse(information))
