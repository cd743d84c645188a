from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.hypothesis import (
    critical_value,
    log_exceedance,
    periodic_columns,
    periodic_force,
    scan_pitches,
)
from estimation.diagnostics.joint_system import JointSystem
from estimation.diagnostics.linearisation import Signature
from estimation.diagnostics.whitened_rows import RowWhitening

SAMPLES = 240


def _length(kind):
    time = np.arange(SAMPLES) / SAMPLES
    if kind == "sine":
        return 0.7 + 0.15 * np.sin(2 * np.pi * time)
    return 0.7 + 0.1 * np.sin(2 * np.pi * time) + 0.06 * np.cos(6 * np.pi * time + 1)


def _whitened_statistics(length, frequencies, noise):
    """Return the statistic of every draw, (draws, P), by plain least squares."""
    angle = 2 * np.pi * np.multiply.outer(frequencies, length - length.mean())
    result = np.empty((len(noise), len(frequencies)))
    for k, row in enumerate(angle):
        basis, _ = np.linalg.qr(np.column_stack([np.sin(row), np.cos(row)]))
        result[:, k] = np.sum((noise @ basis) ** 2, axis=1)
    return result


@pytest.mark.parametrize("kind", ["sine", "mixed"])
def test_level_over_all_pitches(kind):
    """Davies' bound holds in the tail and is not wasteful: 20 000 draws, finely scanned."""
    length = _length(kind)
    stroke = np.ptp(length)
    frequencies = np.arange(1.0, 20.0, 0.125) / stroke
    rng = np.random.default_rng(1)
    largest = np.concatenate(
        [
            _whitened_statistics(length, frequencies, rng.standard_normal((2000, SAMPLES))).max(1)
            for _ in range(10)
        ]
    )
    reach = 2 * np.pi * np.std(length) * np.ptp(frequencies)
    for level in (0.05, 0.01, 0.001):
        share = np.mean(largest > critical_value(level, reach, np.inf))
        assert share < level + 3 * np.sqrt(level / len(largest))
        assert share > 0.5 * level - 3 * np.sqrt(level / len(largest))


def test_critical_value_is_the_inverse():
    for freedom in (np.inf, 600.0):
        value = critical_value(1e-3 / 6, 40.0, freedom)
        assert log_exceedance(value, 40.0, freedom) == pytest.approx(np.log(1e-3 / 6), rel=1e-9)
    assert critical_value(1e-3, 40.0, 100.0) > critical_value(1e-3, 40.0, np.inf)
    # The plain χ² quantile would be far too small.
    assert critical_value(1e-3, 40.0, np.inf) > stats.chi2.isf(1e-3, 2) + 8


def _system(part, forces):
    rows, sigma = len(part.forces), 3.0
    whitening = (
        RowWhitening(np.eye(6) / sigma, np.full(rows, 4.0), None),
        RowWhitening(np.eye(6), np.zeros(0), None),
    )
    whitened = (forces / sigma * 2.0).ravel(), np.ones((6 * rows, 1))
    return JointSystem.of_rows(whitening, *whitened, np.zeros(1), np.inf)


def test_scan_is_plain_least_squares_with_the_models_columns_projected_out(twin):
    rng = np.random.default_rng(2)
    drawn = replace(twin.part, forces=3.0 / 2.0 * rng.standard_normal(twin.part.forces.shape))
    solved = _system(drawn, drawn.forces).solution
    scan = scan_pitches(solved, drawn, 4, 1e-3)
    k = len(scan.pitches) // 3
    columns = periodic_columns(drawn, 4, scan.pitches[k], (0.0, 0.0))[:, :, :2]
    flat = columns.reshape(-1, 2)
    flat = flat - flat.mean(axis=0)
    observed = drawn.forces.ravel() - drawn.forces.mean()
    fitted = flat @ np.linalg.lstsq(flat, observed, rcond=None)[0]
    assert scan.statistic[k] == pytest.approx(np.sum(fitted**2) / (3.0 / 2.0) ** 2, rel=1e-8)
    assert scan.best >= scan.statistic.max()


def test_amplitude_pitch_and_phase_come_back_within_their_errors(twin):
    part = replace(twin.part, length_counts=np.zeros(0))
    rng = np.random.default_rng(3)
    length = part.position[:, 1]
    centre_phase = 2 * np.pi * length.mean() / 0.031 + 0.4
    wave = 2.5 * np.sin(2 * np.pi * length / 0.031 + 0.4)
    errors = []
    for _ in range(150):
        forces = 3.0 / 2.0 * rng.standard_normal(part.forces.shape)
        forces[:, 1] += wave
        solved = _system(part, forces).solution
        pitch = scan_pitches(solved, part, 1, 1e-3).best_pitch
        waves = periodic_columns(part, 1, pitch, (0.0, 0.0))[:, :, :2]
        a, b = solved.fit(Signature.of_forces(part, waves)).values
        waves = periodic_columns(part, 1, pitch, (a, b))
        fit = solved.fit(Signature.of_forces(part, waves))
        found = periodic_force(part, 1, pitch, fit.values, fit.covariance)
        turned = np.angle(np.exp(1j * (found.phase - 0.4)))
        centred = np.angle(np.exp(1j * (found.centre_phase - centre_phase)))
        errors.append(
            [
                (found.amplitude - 2.5) / found.amplitude_std,
                (found.pitch - 0.031) / found.pitch_std,
                turned / found.phase_std,
                centred / found.centre_phase_std,
            ]
        )
    errors = np.array(errors)
    np.testing.assert_allclose(errors.std(axis=0), 1, atol=0.25)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=0.35)


def test_no_pitch_is_negative(twin):
    """A correction of the pitch beyond its linear range makes it longer than the stroke."""
    stroke = np.ptp(twin.part.position[:, 1])
    found = periodic_force(twin.part, 1, stroke / 3, np.array([1.0, 2.0, -4 / stroke]), np.eye(3))
    assert found.pitch > stroke


def test_a_strut_that_is_too_fast_is_not_scanned(twin):
    solved = _system(twin.part, np.zeros_like(twin.part.forces)).solution
    scan = scan_pitches(solved, twin.part, 0, 10.0)
    assert not len(scan.pitches)
    assert scan.log_p == 0
