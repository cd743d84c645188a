"""All diagnostics of an estimate, and what they come to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.attribution import Attribution, attribute
from estimation.diagnostics.channel_test import LACK_OF_FIT, NOISE
from estimation.diagnostics.chi_square import ChiSquare, chi_square
from estimation.diagnostics.joint_system import JointSystem, joint_systems
from estimation.diagnostics.lack_of_fit import LackOfFit, lack_of_fit
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.noise_tests import NoiseTests, Whiteness, noise_tests, whiteness
from estimation.diagnostics.residual_law import (
    ResidualLaw,
    held_out_law,
    joint_law,
    length_law,
    linear_laws,
)
from estimation.diagnostics.residuals import (
    Dependence,
    Residuals,
    VarianceComparison,
    dependence,
    residuals,
    variance_comparison,
)
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False, kw_only=True)
class ExperimentDiagnosis(NoiseTests):
    """Diagnostics of one experiment.

    Attributes
    ----------
    held_out : bool
        The parameters were not estimated from it.
    pointwise : bool
        Its motion was differentiated sample by sample: its error is in the residuals.
    force_chi_square, force_chi_square_left : ChiSquare
        Of the estimate's residuals, and with the effects found taken as known.
    length_chi_square : ChiSquare or None
        None after pointwise kinematics, as all of the lengths' residuals.
    force_whiteness : Whiteness
        Of the mean residuals, with the effects found taken as known.
    lack_of_fit, lack_of_fit_left : LackOfFit
        Of the estimate's residuals, and with the effects found taken as known.
    """

    held_out: bool
    pointwise: bool
    residuals: Residuals
    force_chi_square: ChiSquare
    force_chi_square_left: ChiSquare
    length_chi_square: ChiSquare | None
    force_whiteness: Whiteness
    length_whiteness: Whiteness | None
    lack_of_fit: LackOfFit
    lack_of_fit_left: LackOfFit
    attribution: Attribution
    variances: VarianceComparison
    dependence: Dependence


def diagnose_experiments(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    estimate: ParameterEstimate,
    *,
    held_out: bool = False,
) -> tuple[ExperimentDiagnosis, ...]:
    """Diagnose every experiment; each gets its share of the levels.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those of the estimate, or others when `held_out`.
    knowledge : Knowledge
        Of the estimate.
    held_out : bool
        The estimate is used to predict these experiments, of which it has not seen any.
    """
    free = knowledge.free & (np.diag(estimate.covariance) > 0) if held_out else knowledge.free
    own_motion = estimate.estimator == "ml" and not held_out
    motions = [
        estimate.motions[i] if own_motion else (None if e.fit is None else e.fit.motion)
        for i, e in enumerate(experiments)
    ]
    parts = [
        linearise(robot, experiment, estimate.values, free, motion)
        for experiment, motion in zip(experiments, motions, strict=True)
    ]
    systems = joint_systems(
        parts,
        [experiment.noise for experiment in experiments],
        _known(estimate, knowledge, free, held_out=held_out),
        held_out=held_out,
    )
    if held_out:
        laws = [held_out_law(p, e, estimate) for p, e in zip(parts, experiments, strict=True)]
    elif own_motion:
        laws = [
            joint_law(part, experiment, system.solved())
            for part, experiment, system in zip(parts, experiments, systems, strict=True)
        ]
    else:
        laws = linear_laws(parts, experiments, estimate, knowledge)
    return tuple(
        _diagnosed(
            _Case(experiment, part, system, law, held_out, own_motion, len(parts)), knowledge.names
        )
        for experiment, part, system, law in zip(experiments, parts, systems, laws, strict=True)
    )


def _known(
    estimate: ParameterEstimate, knowledge: Knowledge, free: NDArray[np.bool_], *, held_out: bool
) -> tuple[Array, Array]:
    """Return information on the free parameters from outside of the experiments, and gradient."""
    if not held_out:
        off = (knowledge.prior_mean - estimate.values)[free]
        return knowledge.precision, knowledge.precision @ off
    covariance = estimate.covariance[np.ix_(free, free)]
    scales = np.sqrt(np.diag(covariance))
    correlation = covariance / np.multiply.outer(scales, scales)
    inverse = np.linalg.inv(correlation) / np.multiply.outer(scales, scales)
    return (inverse + inverse.T) / 2, np.zeros(len(scales))


@dataclass(frozen=True, eq=False)
class _Case:
    experiment: Experiment
    part: Linearisation
    system: JointSystem
    law: ResidualLaw
    held_out: bool
    own_motion: bool
    shares: int


def _diagnosed(case: _Case, names: tuple[str, ...]) -> ExperimentDiagnosis:
    experiment, part, record = case.experiment, case.part, case.experiment.record
    noise, level = experiment.noise, NOISE / case.shares
    rest = residuals(experiment, part)
    attribution = attribute(
        case.system,
        part,
        names,
        record.step,
        held_out=case.held_out,
        experiments=case.shares,
    )
    left_law = joint_law(part, experiment, attribution.solved)
    left = attribution.solved.force_residuals()
    both = ((case.law, part.forces), (left_law, left))
    lack = [
        lack_of_fit(
            part,
            law,
            residuals=values,
            level=LACK_OF_FIT / case.shares,
            includes_model_error=noise.forces_include_model_error,
        )
        for law, values in both
    ]
    sizes = [
        chi_square(
            values,
            part.counts,
            law,
            noise.force_freedom,
            includes_model_error=noise.forces_include_model_error,
        )
        for law, values in both
    ]
    length_size, length_whiteness = _length_tests(case, level)
    weighted = left * np.sqrt(part.counts)[:, None]
    return ExperimentDiagnosis(
        **vars(noise_tests(record, noise, part.force_rows, part.length_rows, level)),
        held_out=case.held_out,
        pointwise=experiment.fit is None,
        residuals=rest,
        force_chi_square=sizes[0],
        force_chi_square_left=sizes[1],
        length_chi_square=length_size,
        force_whiteness=whiteness(weighted[None], left_law.lagged, level),
        length_whiteness=length_whiteness,
        lack_of_fit=lack[0],
        lack_of_fit_left=lack[1],
        attribution=attribution,
        variances=variance_comparison(rest, part.force_rows, noise),
        dependence=dependence(rest),
    )


def _length_tests(case: _Case, level: float) -> tuple[ChiSquare | None, Whiteness | None]:
    experiment, part = case.experiment, case.part
    if part.lengths is None or experiment.fit is None:
        return None, None
    covariance = experiment.fit.covariance
    if case.own_motion:
        k = int(np.count_nonzero(part.free))
        covariance = case.system.solved().inverse[k:, k:]
    law = length_law(part, experiment, covariance)
    test = chi_square(
        part.lengths,
        part.length_counts,
        law,
        experiment.noise.length_freedom,
        includes_model_error=experiment.noise.lengths_include_model_error,
    )
    scaled = part.lengths * np.sqrt(part.length_counts)[:, None]
    return test, whiteness(scaled[None], law.lagged, level)
