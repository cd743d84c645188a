"""All diagnostics of an estimate, or of its prediction of held-out data, and the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.attribution import Attribution, attribute
from estimation.diagnostics.candidate_effects import CandidateEffects
from estimation.diagnostics.channel_assignment import assignment_findings
from estimation.diagnostics.diagnosis_result import (
    ChiSquares,
    Diagnosis,
    ExperimentDiagnosis,
    ExperimentTests,
    PitchResult,
    PitchRow,
)
from estimation.diagnostics.finding import DiagnosisVerdict, Status
from estimation.diagnostics.findings import check_motion_onset, verdict
from estimation.diagnostics.gain_drift import gain_drift
from estimation.diagnostics.hypotheses import list_hypotheses
from estimation.diagnostics.hypothesis import DelayTest, HypothesisResult
from estimation.diagnostics.joint_system import SolvedSystem, joint_systems
from estimation.diagnostics.linearisation import Linearisation, linearise
from estimation.diagnostics.noise_result import NoisePictures
from estimation.diagnostics.noise_tests import NoiseTests, Whiteness, noise_tests, whiteness
from estimation.diagnostics.plausibility import plausibility
from estimation.diagnostics.residual_covariance import (
    ResidualCovariance,
    empirical_noise,
    held_out_residual_covariance,
    joint_residual_covariance,
    length_residual_covariance,
    linear_residual_covariances,
    refit_lengths,
    with_empirical_colour,
)
from estimation.diagnostics.residuals import (
    chi_square,
    dependence,
    force_residuals,
    lack_of_fit,
    variance_comparison,
)
from estimation.diagnostics.significance import GAIN_DRIFT, LACK_OF_FIT, NOISE
from estimation.estimators.experiment import Experiment
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from expdesign.progress import report_progress, track
from expdesign.robot import Robot
from expdesign.runfolder import copied

_Residuals = tuple[Array, ResidualCovariance]
"""Of forces, N, or lengths, m, with what they may be."""


def diagnose(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
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
    priors : ParameterPriors
        What the estimate knew besides the data.
    estimate : ParameterEstimate
        Of any estimator.
    held_out : bool
        The forces of the experiments were not used for the estimate: Cov(p̂) is part of what the
        residuals may be.
    """
    weighted, experiments = experiments, [with_empirical_colour(each) for each in experiments]
    free = priors.free & (np.diag(estimate.covariance) > 0) if held_out else priors.free
    own_motion = estimate.estimator == "ml" and not held_out
    motions = [
        estimate.motions[i] if own_motion else (None if e.fit is None else e.fit.motion)
        for i, e in enumerate(experiments)
    ]
    parts = [
        linearise(robot, experiment, estimate.values, free, motion)
        for experiment, motion in track(
            "diagnosis: the model about the estimate",
            tuple(zip(experiments, motions, strict=True)),
        )
    ]
    known = _known(estimate, priors, free, held_out=held_out)
    noises = [experiment.noise for experiment in experiments]
    systems = joint_systems(parts, noises, known, held_out=held_out)
    # Causes are looked for with the noise that the recording shows: a covariance that was given too
    # small has its own test, and is none of them.
    shown = [empirical_noise(experiment) for experiment in experiments]
    changed = any(one is not other for one, other in zip(shown, noises, strict=True))
    searched = joint_systems(parts, shown, known, held_out=held_out) if changed else systems
    # What residuals may be is told behind the filters that make their noise white.
    white = [part.filtered(e.noise) for part, e in zip(parts, experiments, strict=True)]
    if held_out:
        laws = [
            held_out_residual_covariance(p, e, estimate)
            for p, e in zip(white, experiments, strict=True)
        ]
    elif own_motion:
        laws = [
            joint_residual_covariance(part, experiment, system.solved)
            for part, experiment, system in zip(white, experiments, systems, strict=True)
        ]
    else:
        laws = linear_residual_covariances(parts, white, experiments, estimate, priors)
    results = []
    for experiment, as_weighted, motion, part, filtered, system, search, law in zip(
        experiments, weighted, motions, parts, white, systems, searched, laws, strict=True
    ):
        candidate_effects = CandidateEffects(robot, experiment, motion, estimate.values, part)
        families = list_hypotheses(
            candidate_effects, priors.names, held_out=held_out, experiments=len(parts)
        )
        # What may deviate within its tolerance is no cause.
        tolerated = candidate_effects.tolerated()
        attribution = attribute(
            search.with_effects(*tolerated),
            part,
            families,
            experiment.record.step,
            experiments=len(parts),
        )
        tolerant = system.with_effects(*tolerated)
        left = attribution.last.solved
        if search is not system:
            left = tolerant.with_effects(attribution.found).solved
        forces = filtered.forces, law
        anew = experiment is not as_weighted
        if tolerated[0].count or anew:
            # What tolerances explain is no bias, nor what other weights would have made of it.
            solved = tolerant.solved
            forces = (
                solved.force_residuals(),
                joint_residual_covariance(filtered, experiment, solved),
            )
        lengths = None
        if experiment.fit is not None and filtered.lengths is not None:
            k = int(np.count_nonzero(free))
            own = system.solved.inverse[k:, k:] if own_motion else experiment.fit.covariance
            beside = tolerated[1], attribution.found
            lengths = refit_lengths(part, experiment, left, *beside, anew=anew) or (
                filtered.lengths,
                length_residual_covariance(filtered, experiment, own),
            )
        own_noise = noise_tests(
            experiment.record,
            experiment.noise,
            part.force_rows,
            part.length_rows,
            NOISE / len(parts),
        )
        if not held_out:
            k, ratio, p = estimate.largest_colour_ratio()
            colour = replace(
                own_noise.whiteness,
                std_ratio=float(np.sqrt(ratio)),
                std_ratio_p=p,
                std_ratio_of=priors.names[k],
            )
            own_noise = replace(own_noise, whiteness=colour)
        tests = _tests(
            experiment,
            filtered,
            attribution,
            left,
            (forces, lengths),
            own_noise,
            len(parts),
            held_out,
        )
        if not own_motion and not held_out:
            tests = replace(tests, harmonics_left_out=experiment.harmonics_left_out)
        results.append(
            ExperimentDiagnosis(
                tests=tests,
                residuals=force_residuals(experiment, part),
                dependence=tuple(dependence(experiment, part)),
                pitches=tuple(_pitches(attribution)),
                **NoisePictures.parts(experiment.noise, own_noise),
                pointwise=experiment.fit is None,
                attribution=attribution,
            )
        )
    judged = (
        verdict(results)
        if held_out
        else _of_the_estimate(robot, experiments, priors, estimate, results)
    )
    return Diagnosis(estimate.estimator, tuple(results), judged)


def _of_the_estimate(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    estimate: ParameterEstimate,
    results: Sequence[ExperimentDiagnosis],
) -> DiagnosisVerdict:
    """Judge the parameters, too, and the channels where anything fails."""
    own = *check_motion_onset(experiments), plausibility(robot, priors, estimate)
    judged = verdict(results, *own)
    if judged.status is Status.ACCEPTED:
        return judged
    attributions = [result.attribution for result in results]
    channels = assignment_findings(robot, experiments, priors, attributions)
    return verdict(results, *channels, *own)


def _known(
    estimate: ParameterEstimate, priors: ParameterPriors, free: NDArray[np.bool_], *, held_out: bool
) -> tuple[Array, Array]:
    """Return information on the free parameters from outside of the experiments, and gradient."""
    if not held_out:
        off = (priors.prior_mean - estimate.values)[free]
        return priors.precision, priors.precision @ off
    covariance = estimate.covariance[np.ix_(free, free)]
    scales = np.sqrt(np.diag(covariance))
    correlation = covariance / np.multiply.outer(scales, scales)
    inverse = np.linalg.inv(correlation) / np.multiply.outer(scales, scales)
    return (inverse + inverse.T) / 2, np.zeros(len(scales))


def _tests(
    experiment: Experiment,
    part: Linearisation,
    attribution: Attribution,
    solved: SolvedSystem,
    laws: tuple[_Residuals, _Residuals | None],
    noises: NoiseTests,
    shares: int,
    held_out: bool,
) -> ExperimentTests:
    """Test forces and lengths at this share of the levels.

    `solved` is the fit with all effects that were found; `laws` are those of both, with residuals.
    """
    report_progress("diagnosis: tests of what is left")
    (forces, lengths), level = laws, NOISE / shares
    first, last = attribution.first, attribution.last
    left, left_law = solved.force_residuals(), joint_residual_covariance(part, experiment, solved)
    both = (forces, (left, left_law))
    lack = [
        lack_of_fit(part, own, residuals=values, level=LACK_OF_FIT / shares) for values, own in both
    ]
    sizes = [chi_square(values, part.counts, own) for values, own in both]
    length_size, length_whiteness = None, None
    if lengths is not None:
        rest, of_lengths = lengths
        length_size = chi_square(rest, part.length_counts, of_lengths)
        length_whiteness = _whiteness(rest, part.length_counts, of_lengths, level)
    found, left_found = (
        {kind: HypothesisResult.of(test, tests.beside) for kind, test in tests.families.items()}
        for tests in (first, last)
    )
    (delay,) = (hypothesis for hypothesis in attribution.hypotheses if hypothesis.kind == "delay")
    return copied(
        ExperimentTests,
        noises,
        held_out=held_out,
        chi_square=ChiSquares(sizes[0], sizes[1], length_size),
        lack_of_fit=lack[0],
        lack_of_fit_with_effects=lack[1],
        variance_comparison=variance_comparison(experiment, part),
        effects=attribution.effects,
        position_periodic=tuple(
            PitchResult(scan.strut, len(scan.pitches), scan.log_p, again.log_p, best, scan.critical)
            for scan, again, best in zip(
                first.scans, last.scans, attribution.best_forces, strict=True
            )
        ),
        causes=tuple(found.values()),
        causes_with_effects=tuple(left_found.values()),
        gain_drift=gain_drift(experiment, part, GAIN_DRIFT / shares),
        delay=DelayTest.of(found["delay"], delay),
        delay_with_effects=DelayTest.of(left_found["delay"], delay),
        whiteness=replace(
            noises.whiteness,
            force_residuals=_whiteness(left, part.counts, left_law, level),
            length_residuals=length_whiteness,
        ),
    )


def _whiteness(residuals: Array, counts: Array, law: ResidualCovariance, level: float) -> Whiteness:
    return whiteness((residuals * np.sqrt(counts)[:, None])[None], law.lagged, level)


def _pitches(attribution: Attribution) -> Iterator[PitchRow]:
    for first, last in zip(attribution.first.scans, attribution.last.scans, strict=True):
        numbers = np.stack([first.pitches, first.statistic, last.statistic], axis=1)
        for row in numbers.tolist():
            yield PitchRow(first.strut + 1, *row)
