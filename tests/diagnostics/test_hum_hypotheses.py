"""A hum that repeats in every period, in the mean residuals."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.hypotheses import hidden_hums
from estimation.processing import PeriodSource, fold_recording
from tests.diagnostics.conftest import Laboratory

AMPLITUDES = np.array([4.0, 0.0, 6.0, 5.0, 4.0, 5.0])


@pytest.fixture(scope="module")
def lab():
    return Laboratory(samples=150, periods=6)  # one period takes 1 s: 50 Hz is its 50th multiple


def _diagnosis(lab, frequency, amplitudes, seed):
    data = lab.measure(seed)
    hum = amplitudes * np.cos(2 * np.pi * frequency * data.time[:, None] + np.arange(6.0))
    experiment = lab.experiment(replace(data, forces=data.forces + hum))
    return diagnose(lab.robot, [experiment], lab.knowledge, lab.estimate([experiment]))


def _effects(diagnosis):
    (experiment,) = diagnosis.recordings
    return experiment.attribution.effects


def test_a_hum_at_a_multiple_is_found_with_its_amplitudes(lab):
    diagnosis = _diagnosis(lab, 50.0, AMPLITUDES, seed=1)
    (effect,) = _effects(diagnosis)
    assert (effect.kind, effect.strut, effect.parameter) == ("hum", None, "of 50 Hz")
    found = np.hypot(effect.values[::2], effect.values[1::2])
    std = float(np.max(effect.stds))
    np.testing.assert_allclose(found, AMPLITUDES, atol=4 * std)
    assert std < 2.5
    assert any(f.failed and "50 Hz" in f.sentence for f in diagnosis.verdict.findings)


def test_without_a_hum_none_is_found(lab):
    for seed in (2, 3):
        assert not _effects(_diagnosis(lab, 50.0, np.zeros(6), seed))


def test_only_what_no_contrast_sees_is_looked_for(lab):
    record = fold_recording(lab.measure(0), lab.trajectory.omega, PeriodSource.DESIGN)
    assert hidden_hums(record) == ((50.0, 50), (60.0, 60))
    # 1/6 Hz is a line of the record: 49.8 and 49.9 Hz are on two sides of it.
    for base, seen in ((0.9957, False), (0.998, True)):
        shifted = replace(record, omega=2 * np.pi * base)
        assert ((50.0, 50) in hidden_hums(shifted)) == seen
    assert hidden_hums(replace(record, periods=1.0)) == ()
