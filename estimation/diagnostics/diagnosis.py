"""All diagnostics of an estimate, and what they come to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.attribution import Attribution, attribute
from estimation.diagnostics.chi_square import ChiSquare, chi_square
from estimation.diagnostics.dependence import Dependence, dependence
from estimation.diagnostics.drift import Drift, drift
from estimation.diagnostics.joint_system import JointSystem, joint_systems
from estimation.diagnostics.lack_of_fit import LackOfFit, lack_of_fit
from estimation.diagnostics.levels import LACK_OF_FIT, NOISE
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.noise_samples import ChannelNoise, channel_noise
from estimation.diagnostics.normality import Normality, normality
from estimation.diagnostics.residual_law import (
    ResidualLaw,
    held_out_law,
    joint_law,
    length_law,
    linear_laws,
)
from estimation.diagnostics.residuals import (
    Residuals,
    VarianceComparison,
    residuals,
    variance_comparison,
)
from estimation.diagnostics.whiteness import Whiteness, whiteness
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from estimation.processing import NoiseModel, Record
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class ExperimentDiagnosis:
    """Diagnostics of one experiment.

    Attributes
    ----------
    held_out : bool
        The parameters were not estimated from it.
    pointwise : bool
        Its motion was differentiated sample by sample: its error is in the residuals.
    noise : NoiseModel
    residuals : Residuals
    samples : ChannelNoise
        The noise itself, where periods can be compared.
    force_chi_square, force_chi_square_left : ChiSquare
        Of the estimate's residuals, and with the effects found taken as known.
    length_chi_square : ChiSquare or None
        None after pointwise kinematics, as all of the lengths' residuals.
    force_noise_whiteness, length_noise_whiteness : Whiteness or None
        Of the scatter between periods; None where there is none.
    force_whiteness : Whiteness
        Of the mean residuals, with the effects found taken as known.
    length_whiteness : Whiteness or None
    force_normality, length_normality : Normality or None
    lack_of_fit : LackOfFit
        Of the estimate's residuals.
    lack_of_fit_left : LackOfFit
        With the effects found taken as known.
    attribution : Attribution
    variances : VarianceComparison
    dependence : Dependence
    force_drift, length_drift : Drift or None
    """

    held_out: bool
    pointwise: bool
    noise: NoiseModel
    residuals: Residuals
    samples: ChannelNoise
    force_chi_square: ChiSquare
    force_chi_square_left: ChiSquare
    length_chi_square: ChiSquare | None
    force_noise_whiteness: Whiteness | None
    length_noise_whiteness: Whiteness | None
    force_whiteness: Whiteness
    length_whiteness: Whiteness | None
    force_normality: Normality
    length_normality: Normality | None
    lack_of_fit: LackOfFit
    lack_of_fit_left: LackOfFit
    attribution: Attribution
    variances: VarianceComparison
    dependence: Dependence
    force_drift: Drift
    length_drift: Drift | None


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
    noise = experiment.noise
    rest = residuals(experiment, part)
    samples = channel_noise(record, part.force_rows, part.length_rows)
    attribution = attribute(
        case.system,
        part,
        names,
        record.step,
        held_out=case.held_out,
        experiments=case.shares,
    )
    left = attribution.solved
    left_law = joint_law(part, experiment, left)
    left_residuals = left.force_residuals()
    weight = np.sqrt(part.counts)[:, None]
    both = ((case.law, part.forces), (left_law, left_residuals))
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
    level = NOISE / case.shares
    lengths = _length_tests(case, level)
    length_samples = None if samples.lengths is None else samples.lengths
    return ExperimentDiagnosis(
        held_out=case.held_out,
        pointwise=experiment.fit is None,
        noise=noise,
        residuals=rest,
        samples=samples,
        force_chi_square=sizes[0],
        force_chi_square_left=sizes[1],
        length_chi_square=lengths[0],
        force_noise_whiteness=whiteness(samples.forces.values, level=level)
        if samples.forces.source == "periods"
        else None,
        length_noise_whiteness=whiteness(length_samples.values, level=level)
        if length_samples is not None and length_samples.source == "periods"
        else None,
        force_whiteness=whiteness((left_residuals * weight)[None], left_law.lagged, level),
        length_whiteness=lengths[1],
        force_normality=normality(samples.forces.values, level),
        length_normality=None
        if length_samples is None
        else normality(length_samples.values, level),
        lack_of_fit=lack[0],
        lack_of_fit_left=lack[1],
        attribution=attribution,
        variances=variance_comparison(rest, part.force_rows, noise),
        dependence=dependence(rest),
        force_drift=_drift(record, record.force_periods, part.force_rows, level),
        length_drift=None
        if record.length_periods is None and part.length_rows is None
        else _drift(record, record.length_periods, part.length_rows, level),
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


def _drift(record: Record, periods: Array | None, rows: Array | None, level: float) -> Drift:
    """Test for change between periods."""
    if periods is not None:
        count, phases, _ = periods.shape
        values = (periods - periods.mean(axis=0)).reshape(-1, periods.shape[2])
        return drift(values, np.repeat(np.arange(count), phases), phases, level)
    if rows is None:
        raise AssertionError("single rows have residuals")
    block = np.arange(len(rows)) * max(1, round(record.periods)) // len(rows)
    return drift(rows, block, 0, level)
