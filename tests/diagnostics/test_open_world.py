"""Effects that are in no list: whether they are found, and not taken for others."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from benchmarks.unknowns import CASES, CLEAN, outcome_of
from estimation.data.measurement import Measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Status
from estimation.diagnostics.residuals import harmonic_lack_of_fit
from estimation.diagnostics.verdict import experiment_findings
from tests.diagnostics.conftest import HARMONICS, Laboratory


def _low_harmonics(twin, drawn):
    solved = twin.system(drawn).solution
    return harmonic_lack_of_fit(twin.experiment, drawn, solved, HARMONICS)


@pytest.mark.parametrize("kind", ["ls", "gm", "ml"])
def test_size_of_the_statistic_in_noise(twin, kind):
    """After any estimator χ² and its p have their distribution."""
    rng = np.random.default_rng(1)
    tests = [_low_harmonics(twin, twin.draw(rng, kind)) for _ in range(100)]
    p_values = np.exp([test.log_p for test in tests])
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    ratio = np.mean([test.statistic / test.freedom for test in tests])
    assert ratio == pytest.approx(1, abs=5 * np.sqrt(2 / tests[0].freedom / len(tests)))
    # Six actuators, nine lines and the mean, less the parameters.
    assert 6 * 19 - 24 - 6 <= tests[0].freedom <= 6 * 19
    assert tests[0].lines == 3 * HARMONICS


def test_a_bias_in_low_harmonics_is_not_diluted(twin):
    """It is found where the test of single actuators hardly sees it."""
    rng = np.random.default_rng(2)
    sigma = np.sqrt(np.diag(twin.lab.noise.forces.covariance) / twin.lab.periods)
    phase = 2 * np.pi * twin.part.times / twin.experiment.recording.period
    lines = np.arange(2, 9)
    wave = np.sum(np.cos(np.outer(phase, lines) + 2.0 * lines**2), axis=1)[:, None]
    wave = wave / np.sqrt(np.mean(wave**2)) * np.cos(np.arange(6)) * sigma
    found = []
    for _ in range(20):
        drawn = twin.draw(rng, "ml")
        biased = replace(drawn, forces=drawn.forces + 0.6 * wave)
        found.append(_low_harmonics(twin, biased).failed)
    assert sum(found) >= 18


def _diagnosed(lab, seed, force, pointwise=False):
    """Return the diagnosis of a machine with another force, of the motion at the samples."""
    data = lab.measure(seed)
    motion = lab.trajectory.sample(data.time)
    struts = lab.robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
    data = replace(data, forces=data.forces + force(struts))
    if pointwise:
        experiment = lab.pointwise(data)
    else:
        experiment = lab.experiment(data, lab.noise if lab.periods == 1 else None)
    estimate = lab.estimate([experiment], "gm")
    return diagnose(lab.robot, [experiment], lab.knowledge, estimate)


def _explanation(result):
    (finding,) = (f for f in result.verdict.findings if f.assumption.startswith("the model expl"))
    return finding


def test_an_effect_outside_the_list_is_not_named():
    """Force by the product of length and squared speed: no cause is certain."""
    lab = Laboratory(samples=300, periods=6)
    strength = np.array([0, 0, 900.0, 0, 0, -2700.0])
    result = _diagnosed(lab, 3, lambda s: strength * (s.length - 0.7) * s.length_rate**2)
    assert result.verdict.status is Status.DOUBTFUL
    assert "something that is not in the list" in result.verdict.summary
    finding = _explanation(result)
    assert finding.failed
    assert "actuators 3 and 6" in finding.contradiction
    recording = result.recordings[0]
    assert recording.attribution.unlisted
    assert not any(effect.certain for effect in recording.tests.effects)
    assert all(effect.doubt for effect in recording.tests.effects)
    imitations = [f for f in result.verdict.failed if "may only imitate" in f.sentence]
    assert not any(f.serious for f in imitations)
    assert not any("add `" in f.advice for f in imitations)
    assert "jitter" not in finding.advice
    # Lengths whose noise depends on the speed point to the clock.
    normality = recording.tests.normality
    lengths = replace(normality.lengths, size_over="speed")
    tests = replace(recording.tests, normality=replace(normality, lengths=lengths))
    (finding,) = (
        f
        for f in experiment_findings(replace(recording, tests=tests))
        if f.assumption == finding.assumption
    )
    assert "look for jitter of the sampling" in finding.advice


def test_the_state_of_an_unlisted_force_is_named():
    """A force by speed alone, with steps that no term has."""
    lab = Laboratory(samples=300, periods=6)
    result = _diagnosed(lab, 4, lambda s: 8.0 * np.sign(np.sin(9 * np.abs(s.length_rate))))
    shares = result.recordings[0].tests.harmonic_lack_of_fit.shares
    assert max(shares, key=shares.get) == "speed"
    assert shares["speed"] > 0.5
    assert "depend on the speed" in _explanation(result).contradiction


@pytest.mark.parametrize("periods", [1, 6])
def test_an_impossible_sign_is_no_cause(periods):
    """Friction that falls with the load: found, and not named as friction by load."""
    lab = Laboratory(samples=1800 // periods, periods=periods)

    motion = lab.trajectory.sample(lab.measure(5).time)
    load = lab.robot.actuator_forces(motion.pose, motion.rate, motion.acceleration)
    result = _diagnosed(lab, 5, lambda s: -0.1 * np.abs(load) * np.sign(s.length_rate))
    assert result.verdict.status is Status.DOUBTFUL
    effects = result.recordings[0].tests.effects
    assert not any(e.certain for e in effects if e.kind == "load_friction")
    negative = [e for e in effects if e.kind == "load_friction" and e.value < 0]
    assert all(e.doubt for e in negative)
    assert "friction by load" not in result.verdict.summary


@pytest.mark.parametrize("pointwise", [False, True])
def test_the_search_ends_when_too_many_causes_are_needed(pointwise):
    """Of five listed causes four are named: they are more than are believed."""
    lab = Laboratory(samples=300, periods=6)

    def force(struts):
        rate = struts.length_rate
        shapes = [
            np.full(len(rate), 20.0),
            12 * np.sin(2 * np.pi * struts.length[:, 1] / 0.03),
            80 * np.abs(rate[:, 2]) * rate[:, 2],
            2.0 * struts.length_acceleration[:, 3],
            60 * np.abs(rate[:, 4]),
        ]
        return np.stack([*shapes, np.zeros(len(rate))], axis=1)

    result = _diagnosed(lab, 7, force, pointwise)
    effects = result.recordings[0].tests.effects
    causes = {(e.kind, e.parameter) for e in effects if not e.remainder}
    assert len(causes) == 4
    assert not any(effect.certain for effect in effects)
    impossible = {"its sign or size is impossible"} if pointwise else set()
    assert {e.doubt for e in effects} - impossible == {"more than 3 causes are needed"}
    assert "something that is not in the list" in result.verdict.summary


def test_forces_behind_a_filter_have_one_low_pass():
    """Low-passed forces are no delay, and their low pass is named once."""
    lab = Laboratory(samples=500, periods=4)
    data = lab.measure(2)
    late = signal.lfilter(*signal.butter(1, 0.127), np.vstack([data.forces] * 2), axis=0)
    experiment = lab.experiment(replace(data, forces=late[len(data.forces) :]))
    result = diagnose(lab.robot, [experiment], lab.knowledge, lab.estimate([experiment]))
    kinds = [e.kind for e in result.recordings[0].tests.effects]
    assert (kinds[0], kinds.count("low_pass"), kinds.count("delay")) == ("low_pass", 1, 0)
    assert all(finding.failed and finding.serious for finding in result.verdict.causes)


def test_a_delay_makes_no_outliers_where_samples_are_lost():
    lab = Laboratory(samples=500, periods=5)
    data = lab.measure(3, delay=8e-3)
    kept = np.random.default_rng(1).random(len(data.time)) >= 0.02
    data = Measurement(data.time[kept], data.lengths[kept], data.forces[kept])
    experiment = lab.experiment(data, lab.noise)
    result = diagnose(lab.robot, [experiment], lab.knowledge, lab.estimate([experiment]))
    normality = result.recordings[0].tests.normality
    assert normality.source == "periods"
    assert not np.any(normality.forces.outliers)
    assert not np.any(normality.forces.failed)


def test_a_listed_effect_that_explains_everything_is_certain():
    lab = Laboratory(samples=600, periods=4)
    size = np.array([0, 0, 15.0, 0, 0, 0])
    result = _diagnosed(lab, 6, lambda s: size * np.sin(2 * np.pi * s.length / 0.03))
    (effect,) = result.recordings[0].tests.effects
    assert (effect.kind, effect.strut) == ("position-periodic", 2)
    assert effect.certain
    assert not result.recordings[0].attribution.unlisted
    assert "something that is not in the list" not in result.verdict.summary
    assert len(result.verdict.failed) > 1
    (cause,) = result.verdict.causes
    assert "cogging" in cause.sentence


@pytest.mark.parametrize("number", [1, 6])
def test_forces_behind_a_fast_filter_are_late(number):
    """A tenth of a step: among 300 samples hardly a jump of dry friction is later by it."""
    outcome = outcome_of(CLEAN["palida"], "low_pass", 5e-4, number)
    assert not outcome.accepted
    assert outcome.named_among(CASES["low_pass"].kinds)


@pytest.mark.parametrize(
    ("effect", "size", "number"),
    [
        ("direction_friction", 0.04, 6),
        pytest.param("length_delays", 1.5e-4, 8, marks=pytest.mark.slow),
    ],
)
def test_neither_noise_nor_another_secant_makes_a_wrong_cause_certain(effect, size, number):
    """A tilt by noise that is significant at 1 %; a low pass of a late length."""
    outcome = outcome_of(CLEAN["palida"], effect, size, number)
    assert outcome.named_among(CASES[effect].kinds)
    assert any(kind not in CASES[effect].kinds for kind, *_ in outcome.effects)
    assert any(certain for *_, certain in outcome.effects)
    assert not outcome.wrong_and_sure(CASES[effect].kinds)
