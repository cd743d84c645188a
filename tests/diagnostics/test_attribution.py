from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.attribution import attribute
from estimation.diagnostics.column_test import causes, column_test
from estimation.diagnostics.diagnosis import diagnose
from tests.diagnostics.conftest import Laboratory

DRAWS = 150


def _known(twin):
    inverse = np.linalg.inv(twin.estimates["gm"].covariance)
    return (inverse + inverse.T) / 2, np.zeros(len(inverse))


@pytest.mark.parametrize("held_out", [False, True])
def test_level_of_columns_and_delay(twin, held_out):
    rng = np.random.default_rng(1)
    names = twin.lab.knowledge.names
    columns, delay = causes(twin.part, names, held_out=held_out)
    columns = replace(columns, level=0.05)
    known = _known(twin) if held_out else None
    rejected, statistics, delays = 0, [], []
    for _ in range(DRAWS):
        drawn = twin.draw(rng, "held out" if held_out else "gm")
        solved = twin.system(drawn, known=known, held_out=held_out).solved
        test = column_test(solved, columns)
        rejected += any(column.failed for column in test.columns)
        statistics.append([column.t for column in test.columns])
        delays.append(column_test(solved, delay).columns[0].t)
    assert stats.binom.sf(rejected - 1, DRAWS, 0.05) > 0.001
    spread = np.nanstd(np.array(statistics), axis=0)
    np.testing.assert_allclose(spread, 1, atol=0.2)
    assert np.nanmean(spread) == pytest.approx(1, abs=0.06)
    assert np.std(delays) == pytest.approx(1, abs=0.15)


def test_columns_that_are_tested(twin):
    names = twin.lab.knowledge.names
    fitted, _ = causes(twin.part, names, held_out=False)
    assert ("p10", 3) in fitted.labels
    assert not any(name in ("r3", "v6") for name, _ in fitted.labels)
    assert len(fitted.labels) == 72
    held, _ = causes(twin.part, names, held_out=True)
    assert held.labels == tuple((name, None) for name in names)
    fixed = replace(twin.part, free=np.array([name != "r3" for name in names]))
    assert ("r3", None) in causes(fixed, names, held_out=False)[0].labels


def test_nothing_is_attributed_to_noise(twin):
    """All families together, 1 % + 1 % + 0.1 %: at most 6 of 100 (P = 1 %)."""
    rng = np.random.default_rng(2)
    step = twin.experiment.record.step
    names = twin.lab.knowledge.names
    found = [
        attribute(twin.system(drawn), drawn, names, step, held_out=False).effects
        for drawn in (twin.draw(rng, "ml") for _ in range(100))
    ]
    assert sum(bool(effects) for effects in found) <= 6


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
    effects = result.experiments[0].attribution.effects
    assert [(e.kind, e.parameter) for e in effects] == [("column", name)]
    change = estimate.values[k] - values[k]
    assert effects[0].value == pytest.approx(change, abs=4.5 * effects[0].std)
    assert result.verdict.status.value == "doubtful"
    sentences = [f.sentence for f in result.verdict.failed if "parameters" in f.assumption]
    assert len(sentences) == 1
    assert name in sentences[0]


@pytest.mark.parametrize("estimator", ["ls", "ml"])
def test_cogging_in_the_identification_data_is_named(estimator):
    lab = Laboratory(samples=600, periods=4)
    amplitude = [0, 0, 12, 12, 0, 0]
    data = lab.measure(3, cogging=(amplitude, 0.030, [0, 0, 0.3, 1.1, 0, 0]))
    experiment = lab.experiment(data)
    estimate = lab.estimate([experiment], estimator)
    result = diagnose(lab.robot, [experiment], lab.knowledge, estimate)
    diagnosis = result.experiments[0]
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
    first = result.experiments[0].attribution.effects[0]
    assert first.kind == "delay"
    assert result.experiments[0].tests.delay.failed
    assert first.value == pytest.approx(0.012, abs=4 * first.std)
    assert any("lag behind" in f.sentence for f in result.verdict.failed)
