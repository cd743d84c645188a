"""Diagnosis of an estimate, or of its prediction of held-out data, with the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics import diagnosis_result, noise_result, reliability, residual_covariance
from estimation.diagnostics.attribution import Attribution, attribute, doubt_effects
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.gain_drift import gain_drift
from estimation.diagnostics.hypotheses import list_hypotheses
from estimation.diagnostics.hypothesis import HypothesisResult
from estimation.diagnostics.joint_system import JointSystem, SolvedSystem, joint_systems
from estimation.diagnostics.linearisation import (
    CandidateEffects,
    Linearisation,
    Signature,
    linearise,
)
from estimation.diagnostics.noise_tests import NoiseTests, Whiteness, noise_tests, whiteness
from estimation.diagnostics.plausibility import plausibility
from estimation.diagnostics.residuals import (
    HarmonicLackOfFit,
    LackOfFit,
    chi_square,
    dependence,
    force_residuals,
    harmonic_lack_of_fit,
    lack_of_fit,
    variance_comparison,
)
from estimation.diagnostics.significance import GAIN_DRIFT, HARMONIC_LACK_OF_FIT, LACK_OF_FIT, NOISE
from estimation.diagnostics.tolerance_test import tolerance_findings
from estimation.diagnostics.verdict import check_convergence, check_motion_onset, verdict
from estimation.estimators.covariance import Influence
from estimation.estimators.experiment import Experiment
from estimation.estimators.prior_estimate import invert_covariance
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from estimation.measurement_model import Motion, SplineMotion
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import PeriodSource
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.terms import parameter_unit
from expdesign.progress import report_progress, track
from expdesign.robot import Robot
from expdesign.robot.derived import ErrorShares, derived_quantities, known_quantities

_Residuals = tuple[Array, residual_covariance.ResidualCovariance]
"""Residuals of forces, N, or lengths, m, with their covariance under a correct model."""


def diagnose(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    estimate: ParameterEstimate,
    *,
    held_out: bool = False,
    findings: Sequence[Finding] = (),
    channels: Sequence[Finding] = (),
    wanted: Sequence[str] = (),
) -> diagnosis_result.ResidualDiagnosis:
    """Diagnose an estimate, or its prediction of held-out data.

    Several experiments share the significance levels equally.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments of the estimate, in the same order; others if `held_out`.
    priors : ParameterPriors
        Prior information of the estimate.
    estimate : ParameterEstimate
        Result of any estimator.
    held_out : bool
        The forces of the experiments were not used for the estimate: Cov(p̂) contributes to the
        covariance of the residuals.
    findings : sequence of Finding
        Further findings on the estimate.
    channels : sequence of Finding
        Findings of wrong channels, which explain other failures.
    wanted : sequence of str
        Parameters, derived quantities or groups of them whose changes by undetected effects the
        verdict states; by default mass and centre.
    """
    cases = [
        _linearise(robot, experiment, number, priors, estimate, held_out=held_out)
        for number, experiment in enumerate(
            track("diagnosis: linearisation at the estimate", experiments)
        )
    ]
    results = tuple(
        _diagnose_experiment(robot, case, *systems, priors, estimate, shares=len(cases))
        for case, systems in zip(cases, _joint_systems(cases, priors, estimate), strict=True)
    )
    undetected: tuple[reliability.UndetectedEffect, ...] = ()
    if held_out:
        judgement = verdict(results)
    else:
        candidates = reliability.join_recordings([result.reliability for result in results])
        undetected, words = _undetected(robot, priors, estimate, candidates, wanted)
        judgement = verdict(
            results,
            *check_motion_onset([case.experiment for case in cases]),
            *check_convergence(estimate),
            *tolerance_findings(estimate),
            *reliability.common_effect_findings(
                candidates, [result.attribution for result in results]
            ),
            plausibility(robot, priors, estimate),
            *findings,
            channels=channels,
            undetected=words,
        )
    tests = tuple(result.tests for result in results)
    return diagnosis_result.ResidualDiagnosis(
        estimate.estimator, judgement, tests, undetected, results
    )


def _undetected(
    robot: Robot,
    priors: ParameterPriors,
    estimate: ParameterEstimate,
    candidates: Sequence[reliability.CandidateReliability],
    wanted: Sequence[str],
) -> tuple[tuple[reliability.UndetectedEffect, ...], str]:
    """Return the undetected effects, and their changes of wanted quantities in words."""
    names, std = np.array(priors.names)[priors.free].tolist(), estimate.std[priors.free]
    stds = dict(zip(names, std.tolist(), strict=True))
    derived = derived_quantities(robot, estimate.values)
    errors = ErrorShares(estimate.covariance, np.zeros((len(estimate.values), 0)), ())
    known = list(known_quantities(derived, errors, robot.scales, priors.regrouping))
    rows = dict(zip(derived.names, derived.jacobian[:, priors.free], strict=True))
    slopes = {one.quantity: rows[one.quantity] for one in known}
    effects = [reliability.undetected_effect(each, names, std, slopes) for each in candidates]
    found = tuple(sorted(effects, key=lambda effect: -effect.sigmas))
    words = reliability.changes_in_words(
        found,
        stds | {one.quantity: one.std for one in known},
        {name: parameter_unit(name) for name in names} | {one.quantity: one.unit for one in known},
        wanted or ("mass", "centre"),
    )
    return found, words


@dataclass(frozen=True, eq=False)
class _Case:
    """One experiment, linearised at the estimate."""

    experiment: Experiment
    recoloured: bool
    """Whether its noise is coloured, although the estimate weighted it as white."""
    motion: Motion | None
    own_motion: bool
    """Whether the motion was estimated with the parameters."""
    part: Linearisation
    filtered: Linearisation
    """After the whitening filters: covariances of residuals refer to these rows."""
    effects: CandidateEffects
    tolerated: tuple[Signature, Array, Array]
    """Columns of the deviations with tolerances, their 1/std² and means less the estimates:
    deviations within their tolerances are no effects."""
    influence: Influence | None
    """Of the experiment's errors on the estimate; None for held-out data."""

    @property
    def held_out(self) -> bool:
        """Whether the forces were not used for the estimate."""
        return self.influence is None


def _linearise(
    robot: Robot,
    experiment: Experiment,
    number: int,
    priors: ParameterPriors,
    estimate: ParameterEstimate,
    *,
    held_out: bool,
) -> _Case:
    """Linearise an experiment, the one of the estimate with this number, at the estimate."""
    own_motion = estimate.estimator == "ml" and not held_out
    estimated = estimate.motions[number] if own_motion else None
    experiment = experiment.for_estimator("ml") if own_motion else experiment
    motion = None if experiment.fit is None else (estimated or experiment.fit.motion)
    known = experiment
    if isinstance(motion, SplineMotion):
        known, motion = experiment.with_known_motion(robot, motion), None
    coloured = residual_covariance.with_empirical_colour(known)
    free = priors.free & (np.diag(estimate.covariance) > 0) if held_out else priors.free
    part = linearise(robot, coloured, estimate.values, free, motion)
    effects = CandidateEffects(robot, coloured, motion, estimate.values, part)
    in_the_model = {} if held_out or estimate.systematic is None else estimate.systematic.estimates
    return _Case(
        experiment=coloured,
        recoloured=coloured is not known,
        motion=motion,
        own_motion=own_motion,
        part=part,
        filtered=part.apply_filters(coloured.noise),
        effects=effects,
        tolerated=effects.tolerance_columns(in_the_model),
        influence=None if held_out else estimate.influences[number],
    )


def _joint_systems(
    cases: Sequence[_Case], priors: ParameterPriors, estimate: ParameterEstimate
) -> Iterator[tuple[JointSystem, JointSystem]]:
    """Return the system of every experiment with the noise of the estimate, and with the empirical.

    Effects are searched for with the second one: a given covariance that is too small has a test
    for itself and must not appear as an effect. Both are the same object if the noise is.
    """
    parts = [case.part for case in cases]
    prior, held_out = priors.equations(estimate.values), cases[0].held_out
    if held_out:
        free = parts[0].free
        precision = invert_covariance(estimate.covariance[np.ix_(free, free)])
        prior = NormalEquations(0.0, precision, np.zeros(len(precision)))
    build = partial(
        joint_systems,
        parts,
        known=prior,
        deviations=[case.tolerated[0] for case in cases],
        held_out=held_out,
    )
    noises = [case.experiment.noise for case in cases]
    empirical = [residual_covariance.empirical_noise(case.experiment) for case in cases]
    changed = any(one is not other for one, other in zip(empirical, noises, strict=True))
    systems = build(noises=noises)
    return zip(systems, build(noises=empirical) if changed else systems, strict=True)


def _diagnose_experiment(
    robot: Robot,
    case: _Case,
    system: JointSystem,
    search_system: JointSystem,
    priors: ParameterPriors,
    estimate: ParameterEstimate,
    *,
    shares: int,
) -> diagnosis_result.AttributedDiagnosis:
    """Search one experiment for effects and test it, at 1/`shares` of the levels."""
    experiment, part, tolerated = case.experiment, case.part, case.tolerated
    held_out = case.held_out
    # Effects are also tested in all recordings together.
    several = shares + (shares > 1 and not held_out)
    families = list_hypotheses(case.effects, priors.names, held_out=held_out, experiments=several)
    searched = search_system.with_tolerances(*tolerated)
    attribution = attribute(searched, part, families, experiment.recording.step, experiments=shares)
    tolerant, explained = searched, attribution.last.solution
    if search_system is not system:
        tolerant = system.with_tolerances(*tolerated)
        explained = tolerant.solution.with_effects(attribution.columns)
    given = _joint_residuals(experiment, explained)
    if held_out and not tolerated[0].count and not case.recoloured:
        own = residual_covariance.held_out_residual_covariance(case.filtered, experiment, estimate)
        forces = case.filtered.forces, own
    else:
        # Neither effects of tolerances nor those of other weights are a bias.
        solved = tolerant.solution
        forces = given if solved is explained else _joint_residuals(experiment, solved)
    lengths = _length_residuals(case, system, explained, attribution.columns)
    noises = _noise_tests(case, priors, None if held_out else estimate, NOISE / shares)
    tests = _tests(case, attribution, (forces, given, lengths), noises, shares)
    attribution = doubt_effects(
        attribution,
        tests.harmonic_lack_of_fit,
        tests.harmonic_lack_of_fit_with_effects,
        # What differences of neighbours leave is no lack of fit.
        tests.lack_of_fit_with_effects if experiment.fit is not None else LackOfFit(),
    )
    tests = replace(tests, effects=attribution.effects)
    if not case.own_motion and not held_out and experiment.harmonics_left_out:
        tests = replace(tests, harmonics_left_out=experiment.harmonics_left_out)
        # What remains may be the motion that this estimator leaves out.
        attribution = replace(attribution, unlisted=False)
    return diagnosis_result.AttributedDiagnosis(
        tests=tests,
        residuals=force_residuals(experiment, part),
        dependence=tuple(dependence(experiment, part)),
        pitches=tuple(
            diagnosis_result.PitchRow(first.strut + 1, *row)
            for first, last in zip(attribution.first.scans, attribution.last.scans, strict=True)
            for row in np.stack([first.pitches, first.statistic, last.statistic], axis=1).tolist()
        ),
        histogram=noise_result.Histogram.of(noises.samples, noises.normality.forces.std),
        quantiles=noise_result.Quantiles.of(noises.samples),
        noise=noise_result.NoiseCovariances(**noise_result.covariance_fields(experiment.noise)),
        pointwise=experiment.fit is None,
        attribution=attribution,
        reliability=()
        if case.influence is None
        else reliability.candidate_reliability(
            attribution,
            search_system,
            part,
            tolerated[0],
            case.influence,
            known=experiment.pointwise,
            stated=(robot.description.tolerances or RobotTolerances()).stated_terms,
        ),
    )


def _joint_residuals(experiment: Experiment, solved: SolvedSystem) -> _Residuals:
    """Return the force residuals of a joint fit with their covariance."""
    own = residual_covariance.joint_residual_covariance(experiment.noise.forces, solved)
    return solved.force_residuals(), own


def _length_residuals(
    case: _Case, system: JointSystem, explained: SolvedSystem, found: Signature
) -> _Residuals | None:
    """Return the length residuals with their covariance; None after pointwise kinematics."""
    experiment = case.experiment
    if experiment.fit is None or case.filtered.lengths is None:
        return None
    refitted = residual_covariance.refit_lengths(
        case.part, experiment, explained, case.tolerated[1], found, force=case.recoloured
    )
    if refitted is not None:
        return refitted
    if case.own_motion:
        first = int(np.count_nonzero(case.part.free))
        root = system.solution.root[first : first + case.part.motion_columns.shape[2]]
    else:
        root = residual_covariance.root_of_covariance(np.asarray(experiment.fit.covariance))
    columns = case.filtered.length_columns * np.sqrt(case.filtered.length_counts)[:, None, None]
    expected = residual_covariance.ResidualCovariance.of(
        experiment.noise.lengths, columns, root, fitted=True
    )
    return case.filtered.lengths, expected


def _noise_tests(
    case: _Case, priors: ParameterPriors, estimate: ParameterEstimate | None, level: float
) -> NoiseTests:
    """Test the noise, with its effect on the standard deviations of an estimate."""
    recording, noise, part = case.experiment.recording, case.experiment.noise, case.part
    forces, lengths = part.force_rows, part.length_rows
    if recording.source is PeriodSource.NONE:
        forces = case.experiment.noise_rows(forces)
    centred = (
        part.cells.deviations(forces),
        None if lengths is None else part.length_cells.deviations(lengths),
    )
    tests = noise_tests(recording, noise, forces, lengths, level, centred=centred)
    if estimate is None:
        return tests
    k, ratio, p = estimate.largest_colour_ratio()
    colour = replace(
        tests.whiteness,
        std_ratio=float(np.sqrt(ratio)),
        std_ratio_p=p,
        std_ratio_of=priors.names[k],
    )
    return replace(tests, whiteness=colour)


def _tests(
    case: _Case,
    attribution: Attribution,
    residuals: tuple[_Residuals, _Residuals, _Residuals | None],
    noises: NoiseTests,
    shares: int,
) -> diagnosis_result.RecordingTests:
    """Test forces and lengths at 1/`shares` of the levels.

    `residuals` are those of forces, of forces given all effects found, and of lengths.
    """
    report_progress("diagnosis: tests of the residuals")
    experiment, part = case.experiment, case.filtered
    (forces, given, lengths), level = residuals, NOISE / shares
    first, last = attribution.first, attribution.last
    both = (forces,) if forces is given else (forces, given)
    lack = [
        lack_of_fit(part, own, residuals=values, level=LACK_OF_FIT / shares) for values, own in both
    ]
    harmonic = [
        _harmonic_test(case, solved, lack[0].refused, shares)
        for solved in dict.fromkeys((first.solution, last.solution))
    ]
    sizes = [chi_square(values, part.counts, own) for values, own in both]
    length_size, length_whiteness = None, None
    if lengths is not None:
        values, own = lengths
        length_size = chi_square(values, part.length_counts, own)
        length_whiteness = _whiteness(values, part.length_counts, own, level)
    causes, causes_with_effects = (
        tuple(
            HypothesisResult.of(test, tests.conditional.freedom) for test in tests.families.values()
        )
        for tests in (first, last)
    )
    return diagnosis_result.RecordingTests(
        normality=noises.normality,
        drift=noises.drift,
        held_out=case.held_out,
        harmonics_left_out=0,
        settled=experiment.settled,
        chi_square=diagnosis_result.ChiSquares(sizes[0], sizes[-1], length_size),
        lack_of_fit=lack[0],
        lack_of_fit_with_effects=lack[-1],
        harmonic_lack_of_fit=harmonic[0],
        harmonic_lack_of_fit_with_effects=harmonic[-1],
        variance_comparison=variance_comparison(experiment, part),
        effects=attribution.effects,
        position_periodic=tuple(
            diagnosis_result.PitchResult(
                scan.strut, len(scan.pitches), scan.log_p, again.log_p, best, scan.critical
            )
            for scan, again, best in zip(
                first.scans, last.scans, attribution.best_forces, strict=True
            )
        ),
        causes=causes,
        causes_with_effects=causes_with_effects,
        gain_drift=gain_drift(experiment, case.part, GAIN_DRIFT / shares),
        whiteness=replace(
            noises.whiteness,
            force_residuals=_whiteness(given[0], part.counts, given[1], level),
            length_residuals=length_whiteness,
        ),
    )


def _harmonic_test(
    case: _Case, solved: SolvedSystem, refused: str, shares: int
) -> HarmonicLackOfFit:
    """Test the low harmonics; `refused` is the reason against every lack-of-fit test."""
    if case.motion is None:
        refused = refused or "pointwise kinematics have no harmonics of the motion"
    if case.motion is None or refused:
        return HarmonicLackOfFit(refused=refused)
    return harmonic_lack_of_fit(
        case.experiment,
        case.part,
        solved,
        case.motion.harmonics or 0,
        level=HARMONIC_LACK_OF_FIT / shares,
    )


def _whiteness(
    residuals: Array,
    counts: Array,
    covariance: residual_covariance.ResidualCovariance,
    level: float,
) -> Whiteness:
    scaled = (residuals * np.sqrt(counts)[:, None])[None]
    return whiteness(scaled, covariance.lagged_covariance, level)
