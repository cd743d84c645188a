"""A band of noise: its share, its width, and its description in a file."""

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.noise import Band, NoiseSpectrum

VARIANCE = np.diag([1.0, 4.0, 9.0, 1.0, 1.0, 1.0]) + 0.3
SAMPLING, SAMPLES = 1000.0, 400.0
BANDS = {"low": (3.0, 2.0), "middle": (30.0, 12.0), "folded": (480.0, 300.0), "above": (990.0, 9.0)}


def at(band, frequencies, sampling=SAMPLING):
    return NoiseSpectrum((band,)).at(frequencies, sampling, SAMPLES)


@pytest.mark.parametrize("place", BANDS.values(), ids=BANDS)
def test_the_mean_over_all_lines_is_its_variance(place):
    lines = np.arange(4000) / 4000 * SAMPLING
    found = at(Band(VARIANCE, *place), lines)
    np.testing.assert_allclose(found.mean(axis=0), VARIANCE, rtol=1e-9)
    np.testing.assert_allclose(found[1:], found[:0:-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_less(-1e-12, np.linalg.eigvalsh(found))


def test_half_of_the_density_is_at_half_of_the_width():
    band = Band(VARIANCE, 100.0, 10.0)
    middle, below, above = at(band, np.array([100.0, 95.0, 105.0]))[:, 0, 0].real
    np.testing.assert_allclose([below, above], middle / 2, rtol=1e-9)
    # Sampled at 300 Hz, a band at 100 + 300 Hz is seen at 100 Hz.
    other = Band(VARIANCE, 400.0, 10.0)
    lines = np.linspace(0, 300, 50)
    np.testing.assert_allclose(at(other, lines, 300.0), at(band, lines, 300.0), rtol=1e-7)


@pytest.mark.parametrize("place", BANDS.values(), ids=BANDS)
def test_derivatives_against_differences(place):
    spectrum = NoiseSpectrum((Band(VARIANCE, *place),))
    frequencies, step = np.array([3.1, 29.0, 77.0, -20.0, 333.3, 989.0]), 1e-5
    found = spectrum.values(frequencies, 900.0, SAMPLES)
    ahead, behind = (spectrum.at(frequencies + d, 900.0, SAMPLES) for d in (step, -step))
    difference = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(found.by_frequency, difference, rtol=1e-6, atol=1e-4)
    assert not np.any(found.by_samples)


def noise(**spectrum):
    """Return the noise of a run whose forces have this spectrum."""
    given = {"force_std": [2.0] * 6, "force_spectrum": spectrum}
    return load_run({"name": "n", "robot": "palida", "noise": given}).robot.noise


def test_it_takes_its_share_from_what_else_there_is():
    band = {"frequency": "3 Hz", "width": "0.5 Hz", "share": "2 %"}
    for more in ({}, {"ar": 0.5}):
        spectrum = noise(band=band, **more).force_spectrum
        first, second = spectrum.parts
        np.testing.assert_allclose(second.covariance, 0.02 * spectrum.covariance)
        np.testing.assert_allclose(first.covariance, 0.98 * spectrum.covariance)
        np.testing.assert_allclose(np.diag(spectrum.covariance), 4.0)
    assert len(noise(band=[band, band | {"frequency": 7}]).force_spectrum.parts) == 3


def test_it_stands_in_the_resolved_run(tmp_path):
    band = {"frequency": "3 Hz", "width": "0.5 Hz", "share": "2 %"}
    spectrum = {"force_std": [2.0] * 6, "force_spectrum": {"band": band}}
    run = load_run({"name": "n", "robot": "palida", "noise": spectrum})
    (tmp_path / "run.yaml").write_text(resolved_yaml(run), encoding="utf-8")
    assert load_run(tmp_path / "run.yaml").run == run.run


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"band": {"frequency": 3, "width": 1, "share": 1}}, "band"),
        ({"band": [{"frequency": 3, "width": 1, "share": 0.5}] * 2}, "band"),
        ({"band": {"frequency": 3, "width": 0, "share": 0.5}}, "band[1].width"),
        ({"band": {"frequency": 3, "width": 1, "share": -0.5}}, "band[1].share"),
        ({"band": {"frequency": 3, "width": 1}}, "band[1].share"),
        ({"file": "x.csv", "band": {"frequency": 3, "width": 1, "share": 0.5}}, "band"),
    ],
)
def test_bad_input(given, key):
    with pytest.raises(InputError) as caught:
        noise(**given)
    assert caught.value.problems[0].key == f"noise.force_spectrum.{key}"
