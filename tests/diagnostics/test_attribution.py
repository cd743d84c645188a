from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from benchmarks.attribution import cases, configuration, diagnosed, named
from estimation.diagnostics.attribution import attribute
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.hypotheses import parameter_hypothesis
from estimation.diagnostics.hypothesis import evaluate_hypothesis
from estimation.diagnostics.search import Search
from estimation.measurement_model.motion import NormalEquations
from tests.diagnostics.conftest import Laboratory

DRAWS = 150


def _known(twin):
    inverse = np.linalg.inv(twin.estimates["gm"].covariance)
    return NormalEquations(0.0, (inverse + inverse.T) / 2, np.zeros(len(inverse)))


def _tests(system, families):
    """Return the test of every family, nothing being known."""
    solved = system.solution
    projections = [solved.project(hypothesis.columns).conditional_on(()) for hypothesis in families]
    return [evaluate_hypothesis(*pair, 0) for pair in zip(projections, families, strict=True)]


@pytest.mark.parametrize("held_out", [False, True])
def test_level_of_every_family(twin, held_out):
    """Statistics have the size, and columns the level, that they are said to have."""
    rng = np.random.default_rng(1)
    families = twin.families(held_out=held_out)
    families = tuple(replace(hypothesis, level=0.05) for hypothesis in families)
    known = _known(twin) if held_out else None
    rejected = dict.fromkeys((hypothesis.kind for hypothesis in families), 0)
    ratios = {kind: [] for kind in rejected}
    for _ in range(DRAWS):
        drawn = twin.draw(rng, "held out" if held_out else "gm")
        system = twin.system(drawn, known=known, held_out=held_out)
        for test in _tests(system, families):
            rejected[test.hypothesis.kind] += bool(np.any(test.log_p < test.limits))
            ratio = [fit.statistic / fit.rank if fit.rank else np.nan for fit in test.fits]
            ratios[test.hypothesis.kind].append(ratio)
    for kind, count in rejected.items():
        assert stats.binom.sf(count - 1, DRAWS, 0.05) > 0.001, kind
        means = np.nanmean(ratios[kind], axis=0)
        # Of one degree of freedom at least: the mean of the draws is within 5 standard errors.
        np.testing.assert_allclose(means, 1, atol=5 * np.sqrt(2 / DRAWS), err_msg=kind)


def test_levels_of_all_candidates_add_to_that_of_the_family(twin):
    drawn = twin.draw(np.random.default_rng(1), "gm")
    tests = _tests(twin.system(drawn), twin.families(held_out=False))
    shares = {}
    for test in tests:
        tested, levels = np.isfinite(test.log_p), np.exp(test.limits)
        assert np.sum(levels[tested]) == pytest.approx(test.hypothesis.level)
        alike = [strut is None for _, strut in test.hypothesis.labels]
        shares[test.hypothesis.kind] = np.sum(levels[tested & alike]) / test.hypothesis.level
    assert [shares["drive_inertia"], shares["stribeck"]] == pytest.approx([0.5, 0.5])
    assert shares["gain"] == 0
    assert shares["gravity"] == pytest.approx(1)


def test_candidates(twin):
    names = twin.lab.knowledge.names
    fitted = parameter_hypothesis(twin.part, names, held_out=False)
    assert ("p10", 3) in fitted.labels
    assert not any(name in ("r3", "v6") for name, _ in fitted.labels)
    assert len(fitted.labels) == 72
    held = parameter_hypothesis(twin.part, names, held_out=True)
    assert held.labels == tuple((name, None) for name in names)
    fixed = replace(twin.part, free=np.array([name != "r3" for name in names]))
    assert ("r3", None) in parameter_hypothesis(fixed, names, held_out=False).labels


def test_nothing_is_attributed_to_noise(twin):
    """All families together at ten times their level, 20 % + 0.1 %: at most 17 of 50 (P = 1 %)."""
    rng = np.random.default_rng(2)
    step = twin.experiment.recording.step
    families = twin.families(held_out=False)
    families = tuple(replace(hypothesis, level=10 * hypothesis.level) for hypothesis in families)
    found = [
        attribute(twin.system(drawn), drawn, families, step).effects
        for drawn in (twin.draw(rng, "ml") for _ in range(50))
    ]
    assert 0 < sum(bool(effects) for effects in found) <= 17


@pytest.mark.parametrize(("name", "factor"), [("p10", 1.2), ("r3", 0.5), ("v1", 0.0)])
def test_a_wrong_parameter_is_named_on_held_out_data(laboratory, sound, name, factor):
    _, estimate = sound
    held = laboratory.experiment(laboratory.measure(50))
    k = laboratory.knowledge.names.index(name)
    values = estimate.values.copy()
    values[k] *= factor
    result = diagnose(
        laboratory.robot,
        [held],
        laboratory.knowledge,
        replace(estimate, values=values),
        held_out=True,
    )
    effects = result.recordings[0].attribution.effects
    assert [(e.kind, e.parameter) for e in effects] == [("column", name)]
    change = estimate.values[k] - values[k]
    assert effects[0].value == pytest.approx(change, abs=4.5 * effects[0].std)
    assert result.verdict.status.value == "doubtful"
    sentences = [f.sentence for f in result.verdict.failed if "parameters" in f.assumption]
    assert len(sentences) == 1
    assert name in sentences[0]


def test_the_search_goes_on_if_an_exchange_leaves_few_causes(laboratory, sound, monkeypatch):
    """Two causes are found where one is believed, and one of them is left after the exchange."""
    exchange, rounds = Search.exchange_for_rivals, []

    def leave_one_at_first(self, found):
        rounds.append({item.parameter for item in found})
        found, rivals = exchange(self, found)
        return (found[:1], rivals[:1]) if len(rounds) == 1 else (found, rivals)

    monkeypatch.setattr(Search, "exchange_for_rivals", leave_one_at_first)
    monkeypatch.setattr("estimation.diagnostics.attribution._MOST_CAUSES", 1)
    _, estimate = sound
    held = laboratory.experiment(laboratory.measure(50))
    names, values = laboratory.knowledge.names, estimate.values.copy()
    values[names.index("p10")] *= 1.2
    values[names.index("r3")] *= 0.5
    result = diagnose(
        laboratory.robot,
        [held],
        laboratory.knowledge,
        replace(estimate, values=values),
        held_out=True,
    )
    assert rounds == [{"p10", "r3"}] * 2
    found = {effect.parameter for effect in result.recordings[0].attribution.effects}
    assert found == {"p10", "r3"}


@pytest.mark.parametrize("estimator", ["ls", "ml"])
def test_cogging_in_the_identification_data_is_named(estimator):
    lab = Laboratory(samples=600, periods=4)
    amplitude = [0, 0, 12, 12, 0, 0]
    data = lab.measure(3, cogging=(amplitude, 0.030, [0, 0, 0.3, 1.1, 0, 0]))
    experiment = lab.experiment(data)
    estimate = lab.estimate([experiment], estimator)
    result = diagnose(lab.robot, [experiment], lab.knowledge, estimate)
    diagnosis = result.recordings[0]
    effects = diagnosis.attribution.effects
    assert sorted((e.kind, e.strut) for e in effects) == [
        ("position-periodic", 2),
        ("position-periodic", 3),
    ]
    for effect, phase in zip(sorted(effects, key=lambda e: e.strut), (0.3, 1.1), strict=True):
        force = effect.force
        assert force.amplitude == pytest.approx(12, abs=4 * force.amplitude_std)
        assert force.pitch == pytest.approx(0.030, abs=4 * force.pitch_std)
        assert abs(np.angle(np.exp(1j * (force.phase - phase)))) < 4 * force.phase_std
    assert not np.any(diagnosis.tests.lack_of_fit_with_effects.failed)
    failed = [f for f in result.verdict.failed if "position-periodic" in f.sentence]
    assert len(failed) == 1
    assert "in struts 3 and 4:" in failed[0].sentence
    assert result.verdict.status.value == "doubtful"
    best = diagnosis.attribution.best_forces
    assert best[2] is not None
    assert best[2].amplitude == effects[[e.strut for e in effects].index(2)].force.amplitude
    assert all(
        force is None or force.amplitude < 4 for j, force in enumerate(best) if j not in (2, 3)
    )


def test_a_delay_is_found_and_has_its_sign(laboratory):
    experiment = laboratory.experiment(laboratory.measure(4, delay=0.012))
    estimate = laboratory.estimate([experiment], "ml")
    result = diagnose(laboratory.robot, [experiment], laboratory.knowledge, estimate)
    first = result.recordings[0].attribution.effects[0]
    assert first.kind == "delay"
    (delays,) = (each for each in result.recordings[0].tests.causes if each.kind == "delay")
    assert any(each.failed for each in delays.candidates)
    assert first.value == pytest.approx(0.012, abs=4 * first.std)
    failed = [f.assumption for f in result.verdict.failed]
    assert "forces and lengths are sampled at the same time" in failed


def test_a_constant_force_is_no_spring():
    """In this noise a spring has a smaller p, but no significant stiffness; springs have one."""
    for name, number, effect in (
        ("force offset, one strut", 60, ("force_offset", 2, "")),
        ("cable, one strut", 3, ("cable", 3, "")),
    ):
        case = cases()[name]
        diagnosis = diagnosed(case.measured(case.size), number, configuration())
        assert [found for found, _ in named(diagnosis)] == [effect]
