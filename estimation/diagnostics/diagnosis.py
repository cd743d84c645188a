"""All diagnostics of an estimate, or of its prediction of held-out data, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.attribution import attribute
from estimation.diagnostics.channel_test import LACK_OF_FIT, NOISE
from estimation.diagnostics.finding import Outcome, Status, Verdict, of_experiment
from estimation.diagnostics.findings import experiment_findings
from estimation.diagnostics.joint_system import JointSystem, joint_systems
from estimation.diagnostics.lack_of_fit import ChiSquare, chi_square, lack_of_fit
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.noise_record import NoisePictures
from estimation.diagnostics.noise_tests import Whiteness, noise_tests, whiteness
from estimation.diagnostics.record import (
    ChiSquares,
    ColumnResults,
    Diagnosis,
    ExperimentDiagnosis,
    ExperimentTests,
    PitchResult,
    PitchRow,
)
from estimation.diagnostics.residual_law import (
    ResidualLaw,
    held_out_law,
    joint_law,
    length_law,
    linear_laws,
)
from estimation.diagnostics.residuals import dependence, force_residuals, variance_comparison
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from expdesign.robot import Robot


def verdict(experiments: Sequence[ExperimentDiagnosis]) -> Verdict:
    """Judge an estimate by the diagnostics of its experiments."""
    findings = tuple(
        of_experiment(finding, number) if len(experiments) > 1 else finding
        for number, experiment in enumerate(experiments, 1)
        for finding in experiment_findings(experiment)
    )
    serious = [f.contradiction for f in findings if f.failed and f.serious]
    if serious:
        return Verdict(Status.DOUBTFUL, f"doubtful: {'; '.join(serious)}", findings)
    summary = "accepted: nothing speaks against the model"
    untested = dict.fromkeys(f.assumption for f in findings if f.outcome is Outcome.NOT_TESTED)
    if untested:
        summary += f"; not tested: {', '.join(untested)}"
    minor = [f.contradiction for f in findings if f.failed]
    if minor:
        summary += f"; of little consequence: {'; '.join(minor)}"
    return Verdict(Status.ACCEPTED, summary, findings)


def diagnose(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    estimate: ParameterEstimate,
    *,
    held_out: bool = False,
) -> Diagnosis:
    """Diagnose an estimate, or its prediction of held-out data.

    Each of several experiments gets its share of the levels.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those that the estimate was made from, in the same order; or others, with motions of their
        own, when `held_out`.
    knowledge : Knowledge
        What the estimate knew besides the data.
    estimate : ParameterEstimate
        Of any estimator.
    held_out : bool
        The forces of the experiments were not used for the estimate: Cov(p̂) is part of what the
        residuals may be.
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
            joint_law(part, experiment, system.solved)
            for part, experiment, system in zip(parts, experiments, systems, strict=True)
        ]
    else:
        laws = linear_laws(parts, experiments, estimate, knowledge)
    results = tuple(
        _diagnosed(
            _Case(experiment, part, system, law, held_out, own_motion, len(parts)), knowledge.names
        )
        for experiment, part, system, law in zip(experiments, parts, systems, laws, strict=True)
    )
    return Diagnosis(estimate.estimator, results, verdict(results))


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
            includes_model_error=noise.forces.includes_model_error,
        )
        for law, values in both
    ]
    sizes = [
        chi_square(
            values,
            part.counts,
            law,
            noise.forces.freedom,
            includes_model_error=noise.forces.includes_model_error,
        )
        for law, values in both
    ]
    length_size, length_whiteness = _length_tests(case, level)
    weighted = left * np.sqrt(part.counts)[:, None]
    noises = noise_tests(record, part.force_rows, part.length_rows, level)
    scans = tuple(zip(attribution.scans, attribution.last_scans, strict=True))
    tests = ExperimentTests(
        held_out=case.held_out,
        chi_square=ChiSquares(sizes[0], sizes[1], length_size),
        lack_of_fit=lack[0],
        lack_of_fit_with_effects=lack[1],
        variance_comparison=variance_comparison(experiment, part),
        effects=attribution.effects,
        position_periodic=tuple(
            PitchResult(
                first.strut, len(first.pitches), first.log_p, last.log_p, best, first.critical
            )
            for (first, last), best in zip(scans, attribution.best_forces, strict=True)
        ),
        columns=ColumnResults.of(attribution.columns),
        columns_with_effects=ColumnResults.of(attribution.last_columns),
        delay=attribution.delay,
        delay_with_effects=attribution.last_delay,
        whiteness=replace(
            noises.whiteness,
            force_residuals=whiteness(weighted[None], left_law.lagged, level),
            length_residuals=length_whiteness,
        ),
        normality=noises.normality,
        drift=noises.drift,
    )
    return ExperimentDiagnosis(
        tests=tests,
        residuals=force_residuals(experiment, part),
        dependence=tuple(dependence(experiment, part)),
        pitches=tuple(
            PitchRow(first.strut + 1, *numbers)
            for first, last in scans
            for numbers in np.stack([first.pitches, first.statistic, last.statistic], 1).tolist()
        ),
        **NoisePictures.parts(noise, noises),
        pointwise=experiment.fit is None,
        attribution=attribution,
    )


def _length_tests(case: _Case, level: float) -> tuple[ChiSquare | None, Whiteness | None]:
    experiment, part = case.experiment, case.part
    if part.lengths is None or experiment.fit is None:
        return None, None
    covariance = experiment.fit.covariance
    if case.own_motion:
        k = int(np.count_nonzero(part.free))
        covariance = case.system.solved.inverse[k:, k:]
    law = length_law(part, experiment, covariance)
    test = chi_square(
        part.lengths,
        part.length_counts,
        law,
        experiment.noise.lengths.freedom,
        includes_model_error=experiment.noise.lengths.includes_model_error,
    )
    scaled = part.lengths * np.sqrt(part.length_counts)[:, None]
    return test, whiteness(scaled[None], law.lagged, level)
