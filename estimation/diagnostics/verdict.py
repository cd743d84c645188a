"""Verdict on an estimate, and the findings of every experiment, assumption by assumption."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.attribution import (
    doubts_in_words,
    effect_nouns,
    effect_strengths,
    hypothesis_finding,
    position_periodic_finding,
)
from estimation.diagnostics.diagnosis_result import AttributedDiagnosis, RecordingTests
from estimation.diagnostics.finding import (
    Assumption,
    DiagnosisVerdict,
    Finding,
    FindingOutcome,
    Status,
    join_words,
    name_channels,
)
from estimation.diagnostics.hypothesis import PERIODIC
from estimation.diagnostics.noise_tests import NoiseTests, Whiteness
from estimation.diagnostics.plausibility import FORCE_SCALE
from estimation.diagnostics.residuals import ChiSquare, HarmonicLackOfFit
from estimation.diagnostics.significance import CHI_SQUARE
from estimation.estimators.experiment import Experiment
from estimation.estimators.result import ParameterEstimate

_OfNoise = NoiseTests | RecordingTests
"""Types with tests of the noise."""

_EXPLAINED = Assumption(
    "the model explains the forces",
    "the model does not explain the forces",
    "look for unmodelled effects in the residuals over the state of the struts "
    "(`tables/residual_dependence.csv`, a figure of the report)",
)
_UNLISTED = replace(
    _EXPLAINED, contradiction="something that is not in the list acts on the forces"
)
_JITTER = (
    "the noise of the lengths depends on the speed: look for jitter of the sampling, which also "
    "smooths the jumps of dry friction"
)
_MOSTLY = 0.3
"""Share of the unexplained forces from which an actuator, or a state of the struts, is named."""
_STATES_SHOWN = 2
_RESIDUALS_WHITE = Assumption(
    "the residuals of the forces are white",
    "the mean force residuals are correlated in time",
    "the model lacks a slow effect: look at the residuals over time (`tables/residuals.csv`, a "
    "figure of the report)",
)
_NOISE_LEVEL = Assumption(
    "the forces are as noisy as assumed",
    "the force residuals do not have the size of the noise",
    "if no other test contradicts the model, the stated noise is too small: use the covariance "
    "from `expdesign noise`",
)
_MOTION = Assumption(
    "the fitted motion explains the lengths",
    "the fitted motion does not explain the lengths",
    "allow more harmonics of a motion with a period (`estimate.harmonics`), or look for drift and "
    "slipping sensors",
)
_LENGTHS_WHITE = Assumption(
    "the residuals of the lengths are white",
    "the length residuals are correlated in time",
    _MOTION.advice,
)
_WHOLE_MOTION = Assumption(
    "the lengths show the whole motion",
    "the forces show more of the motion than the lengths",
    "estimate with ML, which uses both; LS and GM neglect the additional motion",
)
_SETTLED = Assumption(
    "motion and noise of a recording without a period agree",
    "motion and noise of a recording without a period were not found together",
    "measure the lengths more precisely, or state the noise of the forces (`estimate.noise: "
    "given`)",
)
_NOISE_WHITE = Assumption(
    "the noise is white",
    "the noise is correlated in time",
    "check for a filter in the measurement, and remove it or sample more slowly: with correlated "
    "noise the standard deviations are too small",
)
_NOISE_WHITE_OR_COUNTED = replace(
    _NOISE_WHITE, advice="no action needed: the standard deviations account for it", serious=False
)
_NO_OUTLIERS = Assumption(
    "no outliers",
    "there are outliers",
    "inspect them; in a motion with a period the robust loss (`estimate.loss: huber`) reduces "
    "their weight. Without a period a jerk that the spline does not follow has the same effect: "
    "leave it out (`data.start`, `data.end`)",
)
_OUTLIERS_COUNT_LESS = replace(
    _NO_OUTLIERS,
    contradiction="there are outliers, and the robust loss reduces their weight",
    advice="find their source; the estimate is hardly affected",
    serious=False,
)
_SAME_SIZE = Assumption(
    "the noise has the same size throughout a period",
    "the size of the noise depends on the motion",
    "estimate with the noise of the recording (`estimate.noise: estimated`, `spectrum: auto`), "
    "whose weights account for its size: the standard deviations do not",
)
_SIZE_WEIGHTED = replace(
    _SAME_SIZE,
    advice="no action needed: weights and standard deviations account for it",
    serious=False,
)
_NORMAL = Assumption(
    "the noise is normal",
    "the noise is not normal",
    "estimates remain unbiased, and intervals are valid for many samples; ML is no longer the "
    "most efficient estimator",
    serious=False,
)
_ALIKE = Assumption(
    "all periods are alike",
    "the periods differ from each other",
    "let the machine warm up, or leave out the first periods: drift counts as noise",
)
_GAINS_STAY = Assumption(
    "the gains of the forces stay the same",
    "the gain of a force drifts during the recording",
    "let the drives warm up (a motor constant falls with the temperature), or shorten the "
    "recording; state the uncertainty of the mean gain as `tolerances.force_constant`",
)

_NOTICEABLE_RATIO = 1.2
"""Smallest relevant ratio of a standard deviation to that under white noise."""

_MOVING = Assumption(
    "the recording begins with the motion",
    "the recording begins at rest",
    "leave the rows before the motion out",
)


_CONVERGED = Assumption(
    "the estimator converged",
    "the estimator did not converge",
    "do not use its values and intervals. Correct the other findings and compare units, order, "
    "signs and zeros of the channels with the robot file; without any finding, fix the parameters "
    "that the data hardly determine",
)

_MOST_TOGETHER = 2
"""Largest number of causes that are named together as the first."""
_COMPARABLE = 0.1
"""Strength of an effect, relative to the strongest, from which both are needed."""
_EFFECT, _OF_THE_ESTIMATE = 3, 6
"""Ranks of unmodelled effects, and of findings on the estimate without a rank below."""
_RANKS = {
    assumption.text: rank
    for rank, assumptions in {
        1: (_MOVING,),
        2: (FORCE_SCALE,),
        4: (_GAINS_STAY, _ALIKE, _NO_OUTLIERS, _SAME_SIZE, _MOTION, _WHOLE_MOTION),
        5: (_EXPLAINED,),
        7: (_CONVERGED,),
        8: (_NOISE_LEVEL, _RESIDUALS_WHITE, _LENGTHS_WHITE, _NOISE_WHITE),
    }.items()
    for assumption in assumptions
}
"""Causes have lower ranks than their consequences, by the text of the assumption."""


def verdict(
    experiments: Sequence[AttributedDiagnosis],
    *of_the_estimate: Finding,
    channels: Sequence[Finding] = (),
    undetected: str = "",
) -> DiagnosisVerdict:
    """Judge an estimate by its own findings and by those of its experiments.

    `channels` are findings of wrong channels, which explain other failures; `undetected` continues
    the summary of an accepted estimate with the changes by effects that no test would find. Serious
    failures come first, causes before their consequences.
    """
    of_the_forces = tuple(
        finding.name_experiment(number, len(experiments))
        for number, experiment in enumerate(experiments, 1)
        for finding in experiment_findings(
            experiment, wrong_channels=bool(channels), shares=len(experiments)
        )
    )
    findings = (*channels, *of_the_estimate, *of_the_forces)
    serious = _order_causes(channels, of_the_estimate, of_the_forces)
    if serious:
        rest = [
            replace(finding, first=False)
            for finding in findings
            if not (finding.failed and finding.serious)
        ]
        summary = f"doubtful: {'; '.join(finding.contradiction for finding in serious)}"
        return DiagnosisVerdict(Status.DOUBTFUL, summary, (*serious, *rest))
    summary = "accepted: no test contradicts the model"
    if any(experiment.tests.held_out for experiment in experiments):
        summary = (
            "accepted: no test contradicts the prediction, which confirms the forces on motions "
            "like this one, not the single parameters"
        )
    summary += undetected
    untested = dict.fromkeys(
        f.assumption for f in findings if f.outcome is FindingOutcome.NOT_TESTED
    )
    if untested:
        summary += f"; assumed, not tested: {', '.join(untested)}"
    minor = [f.contradiction for f in findings if f.failed]
    if minor:
        summary += f"; minor findings: {'; '.join(minor)}"
    return DiagnosisVerdict(Status.ACCEPTED, summary, findings)


def _order_causes(
    channels: Sequence[Finding],
    of_the_estimate: Sequence[Finding],
    of_the_forces: Sequence[Finding],
) -> list[Finding]:
    """Return the serious failures, causes before consequences, with the first cause marked.

    Experiments mark the effects that are needed together, in case an effect is the first cause.
    """
    effects = dict.fromkeys((finding.assumption for finding in of_the_forces), _EFFECT)
    others = {**effects, **_RANKS}  # effects in all recordings together are effects as well
    ranked = [
        *((_RANKS[_MOVING.text], finding) for finding in channels),
        *((others.get(f.assumption, _OF_THE_ESTIMATE), f) for f in of_the_estimate),
        *((others[f.assumption], f) for f in of_the_forces),
    ]
    ordered = sorted(
        ((rank, finding) for rank, finding in ranked if finding.failed and finding.serious),
        key=lambda each: each[0],
    )
    found = [replace(finding, first=False) for _, finding in ordered]
    count = 1 + (len(found) > 1 and all(finding.first for _, finding in ordered[:2]))
    return [replace(finding, first=True) for finding in found[:count]] + found[count:]


def experiment_findings(
    diagnosis: AttributedDiagnosis, *, wrong_channels: bool = False, shares: int = 1
) -> list[Finding]:
    """Return the findings of one experiment, one per assumption, effects by their strength.

    The levels are divided among the number of experiments, `shares`. The strongest effect, and a
    second one that explains a comparable share, are marked as first.
    """
    tests, white = diagnosis.tests, diagnosis.tests.whiteness.force_residuals
    if white is None:
        raise AssertionError("forces leave residuals")
    left = "given the effects found" if diagnosis.attribution.effects else ""
    effects = {
        PERIODIC.kind: position_periodic_finding(diagnosis.attribution),
        **{
            hypothesis.kind: hypothesis_finding(diagnosis.attribution, hypothesis)
            for hypothesis in diagnosis.attribution.hypotheses
            if not hypothesis.modelled
        },
    }
    strength = effect_strengths(diagnosis.attribution)
    for kind in [kind for kind in strength if kind in effects][:_MOST_TOGETHER]:
        needed = strength[kind] >= _COMPARABLE * max(strength.values())
        effects[kind] = replace(effects[kind], first=needed)
    return [
        _bias(diagnosis, wrong_channels=wrong_channels),
        *sorted(effects.values(), key=lambda finding: not finding.first),
        _gain_drift(tests),
        _white(_RESIDUALS_WHITE, white, "actuator", "mean residual", left),
        _size(_NOISE_LEVEL, tests.chi_square.forces_with_effects, "force", shares, left),
        *_motion(tests, shares, left),
        *noise_findings(tests),
    ]


def noise_findings(tests: _OfNoise) -> tuple[Finding, ...]:
    """Return the findings on the noise."""
    return _noise_white(tests), *_distribution(tests), _periods(tests)


def _bias(diagnosis: AttributedDiagnosis, *, wrong_channels: bool) -> Finding:
    """Report a bias, the effects that explain it, and the states on which the rest depends."""
    tests, attribution = diagnosis.tests, diagnosis.attribution
    single, low = tests.lack_of_fit, tests.harmonic_lack_of_fit
    biased = bool(np.any(single.failed)) or low.failed
    if single.refused and not attribution.unlisted:
        return _EXPLAINED.skip(single.refused)
    if not (biased or attribution.unlisted):
        worst = int(np.nanargmin(single.p_values))
        numbers = (
            f"F = 1 is noise; largest F = {single.statistic[worst]:.3f} in actuator {worst + 1}, "
            f"p = {single.p_values[worst]:.2g}{'' if low.refused else f'; {_of_all(low)}'}"
        )
        sentence = f"the force residuals are noise ({numbers})"
        return _EXPLAINED.holds(sentence, _family_p(single.p_values), single.level)
    parts = []
    p, level = float(np.exp(low.log_p)), low.level
    if np.any(single.failed):
        p, level = _family_p(single.p_values), single.level
        values = ", ".join(f"{value:.3f}" for value in single.statistic[single.failed])
        where = name_channels("actuator", single.failed)
        parts.append(f"the force residuals of {where} exceed the noise (F = {values}; 1 is noise)")
    if low.failed:
        parts.append(f"the mean force residuals exceed the noise ({_of_all(low)})")
    where, words = _biased_actuators(tests), effect_nouns(attribution)
    found = join_words(dict.fromkeys(words[effect.kind] for effect in attribution.effects))
    if not attribution.unlisted:
        verb = "explains" if len(attribution.effects) == 1 else "explain"
        rest = tests.harmonic_lack_of_fit_with_effects.failed
        advice = f"{found} {verb} {'most of ' * rest}it" if found else ""
        if diagnosis.pointwise:
            advice = (
                "the residuals contain the noise of pointwise differentiation: use "
                "`differentiation: fourier` first"
            )
        return _EXPLAINED.fails("; ".join(parts), p, level, where, advice)
    if found:
        doubts = doubts_in_words(attribution.effects)
        parts.append(f"the residuals resemble {found}, but {doubts}")
    if wrong_channels:
        return _EXPLAINED.fails("; ".join(parts), p, level, where, "correct the channels first")
    where = ", ".join(filter(None, [where, *_name_states(low.shares)]))
    added = join_words(each.noun for each in attribution.hypotheses if each.modelled)
    advice = _UNLISTED.advice
    if added:
        advice += f"; {added} in the model may only imitate one"
    lengths = tests.normality.lengths
    if lengths is not None and lengths.size_over == "speed":
        advice += f"; {_JITTER}"
    finding = _UNLISTED.fails("; ".join(parts), p, level, where, advice)
    return finding if biased else replace(finding, p=None, level=None)


def _of_all(test: HarmonicLackOfFit) -> str:
    return (
        f"all actuators together, up to line {test.lines} of the period: χ² / degrees of freedom "
        f"= {test.statistic / max(test.freedom, 1):.3f}, p = {np.exp(test.log_p):.2g}"
    )


def _biased_actuators(tests: RecordingTests) -> str:
    """Name the actuators with the largest bias."""
    low, struts = tests.harmonic_lack_of_fit, np.asarray(tests.lack_of_fit.failed)
    if low.failed:
        # Parameters spread a bias over all actuators.
        struts = low.ratios - 1 > _MOSTLY * (np.nanmax(low.ratios) - 1)
    if not np.any(struts):
        places = {effect.strut for effect in tests.effects}
        struts = np.array([j in places for j in range(len(struts))])
    if low.failed and np.all(struts):
        return "all actuators together"
    return name_channels("actuator", struts)


def _name_states(shares: Mapping[str, float]) -> Iterator[str]:
    """Name the states of the struts on which unexplained forces depend most."""
    shown = sorted(shares.items(), key=lambda each: -each[1])
    # Every force is a function of time: it counts if no state explains as much.
    if shown and shown[0][0] != "time":
        shown = [each for each in shown if each[0] != "time"]
    for name, share in shown[:_STATES_SHOWN]:
        if share > _MOSTLY:
            yield f"{100 * share:.0f} % depend on the {name}"


def _gain_drift(tests: RecordingTests) -> Finding:
    """Report gains that drift from period to period."""
    test = tests.gain_drift
    if test.refused:
        return _GAINS_STAY.skip(test.refused)
    p = float(np.exp(test.log_p))
    where = [
        "all actuators" if each.actuator is None else f"actuator {each.actuator + 1}"
        for each in test.found
    ]
    changes = [
        f"{place} by {100 * each.change:+.2g} ± {100 * each.std:.1g} %"
        for place, each in zip(where, test.found, strict=True)
    ]
    return _GAINS_STAY.decide(
        ", ".join(where),
        f"no gain drifts (p = {p:.2g})",
        f"gains drift from the first period to the last: {'; '.join(changes)}",
        p,
        test.level,
    )


def _motion(tests: RecordingTests, shares: int, left: str) -> list[Finding]:
    """Report whether the estimated motion explains the lengths."""
    test, white = tests.chi_square.lengths, tests.whiteness.length_residuals
    if test is None or white is None:
        reason = (
            "pointwise differentiation and splines have no model of the motion; its error is in "
            "the regressor"
        )
        skipped = _MOTION.skip(reason, "use `differentiation: fourier` for a motion that repeats")
        if tests.settled:
            return [skipped]
        sentence = "motion and noise still changed when the iteration ended"
        return [skipped, _SETTLED.fails(sentence)]
    findings = [_size(_MOTION, test, "length", shares, left)]
    if tests.harmonics_left_out:
        sentence = (
            f"the forces show {tests.harmonics_left_out} harmonics of the motion that the lengths "
            "do not show"
        )
        findings.append(_WHOLE_MOTION.fails(sentence))
    return [
        *findings,
        _white(_LENGTHS_WHITE, white, "strut", "length residuals", left),
    ]


def _size(
    assumption: Assumption, test: ChiSquare, kind: str, shares: int, left: str = ""
) -> Finding:
    """Report whether residuals have the size of the noise, at 1/`shares` of the level."""
    if test.refused:
        return assumption.skip(test.refused)
    p, level = min(1.0, 4 * min(test.p_value, test.p_smaller)), CHI_SQUARE / shares
    ratio = f"(χ² / degrees of freedom = {test.ratio:.3f}{' ' * bool(left)}{left})"
    if p >= level:
        sentence = f"the {kind} residuals have the size of the noise {ratio}"
        return assumption.holds(sentence, p, level)
    small = test.p_smaller < test.p_value
    sentence = f"the {kind} residuals are too {'small' if small else 'large'} {ratio}"
    advice = f"the stated noise of the {kind}s is too large: intervals are too wide"
    return assumption.fails(sentence, p, level, advice=advice if small else "")


def _white(
    assumption: Assumption, test: Whiteness, kind: str, what: str, left: str = ""
) -> Finding:
    """Report whether residuals are correlated in time."""
    p = _family_p(test.p_values)
    verb = "are" if what.endswith("s") else "is"
    known = " " * bool(left) + left
    worst = float(np.max(np.abs(test.autocorrelation)))
    where = name_channels(kind, test.failed)
    return assumption.decide(
        where,
        f"the {what} {verb} not relevantly correlated in time{known} (largest autocorrelation "
        f"{worst:.3f})",
        f"the {what} {verb} correlated in time{known} in {where}",
        p,
        test.level,
    )


def _noise_white(tests: _OfNoise) -> Finding:
    white = tests.whiteness
    kinds = {"forces of actuator": white.force_noise, "lengths of strut": white.length_noise}
    done = {kind: test for kind, test in kinds.items() if test is not None}
    if not done:
        if white.counted:
            return _NOISE_WHITE_OR_COUNTED.skip(white.refused)
        return _NOISE_WHITE.skip(f"{white.refused}: standard deviations assume white noise")
    p = min(_family_p(test.p_values) for test in done.values())
    level = next(iter(done.values())).level
    largest = max(float(np.max(np.abs(test.autocorrelation))) for test in done.values())
    where = join_words([name_channels(kind, test.failed) for kind, test in done.items()])
    absent = f"largest autocorrelation between periods {largest:.3f}"
    seen = where or "over many samples, hardly between neighbours"
    present = f"the noise is correlated in time ({seen}; up to {largest:.2f})"
    if not white.counted:
        return _NOISE_WHITE.decide(where, absent, present, p, level)
    # Only the effect of the correlation on the parameters matters.
    ratio = f"standard deviations are up to {white.std_ratio:.2g} times those under white noise"
    ratio += f" ({white.std_ratio_of})"
    if white.std_ratio_p < level and white.std_ratio > _NOTICEABLE_RATIO:
        where = where or white.std_ratio_of
        p = min(p, white.std_ratio_p)
    if white.std_ratio_of:
        absent, present = f"{absent}, {ratio}", f"{present}, {ratio}"
    return _NOISE_WHITE_OR_COUNTED.decide(where, absent, present, p, level)


def _distribution(tests: _OfNoise) -> Iterator[Finding]:
    """Report outliers, and whether the noise is normal."""
    kinds = {"force": tests.normality.forces, "length": tests.normality.lengths}
    done = {kind: test for kind, test in kinds.items() if test is not None}
    level = tests.normality.forces.level
    p = min(_family_p(test.outlier_p_values) for test in done.values())
    outliers = {
        f"{kind} {j + 1}": f"{test.outliers[j]}"
        for kind, test in done.items()
        for j in np.flatnonzero(test.with_outliers)
    }
    counts = ", ".join(f"{channel}: {count}" for channel, count in outliers.items())
    changes = [
        f"{kind}s over the {test.size_over} by up to a factor of {np.max(test.size_ratio):.2g}"
        for kind, test in done.items()
        if test.size_over
    ]
    if changes:
        counted = all(test.size_weighted for test in done.values() if test.size_over)
        size = _SIZE_WEIGHTED if counted else _SAME_SIZE
        yield size.fails(f"the size of the noise changes: {join_words(changes)}")
    absent = "no more outlying samples than in normal noise"
    present = f"more outlying samples than in normal noise ({counts})"
    assumption, taken = _NO_OUTLIERS, tests.normality.taken
    if taken is not None:
        assumption = _OUTLIERS_COUNT_LESS
        present += f"; the robust loss removed the weight of {taken:.3g} samples"
    yield assumption.decide(", ".join(outliers), absent, present, p, level)
    p = min(_family_p(test.p_values) for test in done.values())
    shapes = {
        f"{kind} {j + 1}": f"skewness {test.skewness[j]:.2f}, excess kurtosis "
        f"{test.kurtosis[j]:.2f}"
        for kind, test in done.items()
        for j in np.flatnonzero(test.failed)
    }
    numbers = "; ".join(f"{channel} ({shape})" for channel, shape in shapes.items())
    absent = "skewness and kurtosis are those of normal noise"
    present = f"the noise is not normal: {numbers}"
    yield _NORMAL.decide(", ".join(shapes), absent, present, p, level)


def _periods(tests: _OfNoise) -> Finding:
    """Report whether the means of the periods differ."""
    force = tests.drift.forces
    if force.refused:
        return _ALIKE.skip(force.refused)
    changes, p = {}, 1.0
    for kind, test, factor, unit in (
        ("lengths of strut", tests.drift.lengths, 1e3, "mm"),
        ("forces of actuator", force, 1.0, "N"),
    ):
        if test is None or test.refused:
            continue
        p = min(p, _family_p(test.p_values))
        for j in np.flatnonzero(test.failed):
            changes[f"{kind} {j + 1}"] = f"by {factor * test.extent[j]:.2g} {unit}"
    all_changes = ", ".join(f"{channel} {change}" for channel, change in changes.items())
    absent = "the means of the periods do not differ"
    present = f"the means of periods change: {all_changes}"
    return _ALIKE.decide(", ".join(changes), absent, present, p, force.level)


def _family_p(p_values: Array) -> float:
    """Return the smallest p of a family, corrected for its size."""
    return float(min(1.0, len(p_values) * np.nanmin(p_values)))


def check_convergence(estimate: ParameterEstimate) -> tuple[Finding, ...]:
    """Return a finding on an estimator that did not converge; empty if it did."""
    if estimate.converged:
        return ()
    return (_CONVERGED.fails(f"the estimator ended early: {estimate.status}"),)


def check_motion_onset(experiments: Sequence[Experiment]) -> tuple[Finding, ...]:
    """Return a finding for every experiment whose recording begins before the motion."""
    return tuple(
        _MOVING.fails(
            f"the struts do not move before {begin:.4g} s",
            advice=f"leave the rows before the motion out: `data.start: {begin:.4g} s`",
        ).name_experiment(number, len(experiments))
        for number, experiment in enumerate(experiments, 1)
        if (begin := experiment.recording.motion_onset) is not None
    )
