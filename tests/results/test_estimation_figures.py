"""Figures of diagnostics, drawn from a small simulated experiment with cogging."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.noise_result import noise_density
from estimation.processing.periodic_recording import Channels
from results.figures.drawing import PAGE_WIDTH, RESOLUTION, house_style, save_figures
from results.figures.noise import NOISE_FIGURES, noise_spectrum_figure
from results.figures.residuals import DIAGNOSTIC_FIGURES
from tests.diagnostics.conftest import Laboratory

KEYS = [definition.key for definition in (*DIAGNOSTIC_FIGURES, *NOISE_FIGURES)]


def drawn(diagnosis):
    """Return every figure of a diagnosis by its name."""
    with house_style():
        return {figure.key: figure.draw(diagnosis) for figure in DIAGNOSTIC_FIGURES} | {
            figure.key: figure.draw(diagnosis) for figure in NOISE_FIGURES
        }


@pytest.fixture(scope="module")
def diagnosis():
    lab = Laboratory(samples=400, periods=4)
    data = lab.measure(1, cogging=([0, 0, 0, 20, 0, 0], 0.03, 0.0))
    experiment = lab.experiment(data)
    estimate = lab.estimate([experiment])
    return diagnose(lab.robot, [experiment], lab.knowledge, estimate).recordings[0]


@pytest.fixture(scope="module")
def figures(diagnosis):
    return drawn(diagnosis)


def _texts(axes):
    return " ".join(text.get_text() for text in axes.texts)


@pytest.mark.slow
def test_files_are_complete(diagnosis, tmp_path):
    paths = save_figures(DIAGNOSTIC_FIGURES, diagnosis, tmp_path)
    paths += save_figures(NOISE_FIGURES, diagnosis, tmp_path)
    assert {p.name for p in paths} == {f"{key}.{end}" for key in KEYS for end in ("png", "svg")}
    for path in paths:
        if path.suffix == ".svg":
            assert ET.parse(path).getroot().tag.endswith("svg")
        else:
            data = path.read_bytes()
            assert data.startswith(b"\x89PNG")
            assert int.from_bytes(data[16:20], "big") == PAGE_WIDTH * RESOLUTION


def test_residuals_are_those_of_the_diagnosis(diagnosis, figures):
    for j, axes in enumerate(figures["residuals"].axes):
        curve = axes.get_lines()[0]
        np.testing.assert_array_equal(curve.get_ydata(), diagnosis.residuals.forces[:, j])
    assert "no bias" not in _texts(figures["residuals"].axes[3])


def test_scan_names_the_strut(diagnosis, figures):
    named = [j for j, a in enumerate(figures["position_periodic"].axes) if "mm" in _texts(a)]
    assert named == [3]
    scan = diagnosis.attribution.first.scans[3]
    assert 1e3 * scan.pitches[np.argmax(scan.statistic)] == pytest.approx(30, abs=1.5)


def test_covariance_shows_every_correlation(diagnosis, figures):
    matrix = figures["noise_covariance"].axes[0].images[0].get_array()
    sigma = diagnosis.noise.force_covariance
    assert matrix[0, 1] == pytest.approx(sigma[0, 1] / np.sqrt(sigma[0, 0] * sigma[1, 1]))
    bars = figures["noise_covariance"].axes[1].patches
    np.testing.assert_allclose([b.get_height() for b in bars], np.sqrt(np.diag(sigma)))


def test_histogram_is_a_density(figures):
    for axes in figures["noise_distribution"].axes:
        area = sum(p.get_width() * p.get_height() for p in axes.patches)
        assert area == pytest.approx(1, rel=1e-9)


def test_dependence_has_a_row_for_each_strut(figures):
    assert len(figures["residual_dependence"].axes) == 24


def test_given_noise_and_pointwise_kinematics_can_be_drawn():
    lab = Laboratory(samples=120, periods=2)
    experiment = replace(lab.pointwise(lab.measure(1)), noise=lab.noise)
    estimate = lab.estimate([experiment])
    result = diagnose(lab.robot, [experiment], lab.knowledge, estimate).recordings[0]
    for key, figure in drawn(result).items():
        assert figure.axes, key


def test_the_band_of_a_spectrum_and_every_hum_can_be_read():
    """A band of few per cent is thinner than a line: its ends stand in words."""
    rng, step, periods, samples = np.random.default_rng(7), 2e-3, 8, 497
    time = step * np.arange(periods * samples)[:, None]
    hums = {50.02: 3.0, 100.05: 2.0}
    noise = rng.normal(size=(periods * samples, 6))
    noise += sum(size * np.sin(2 * np.pi * f * time + np.arange(6.0)) for f, size in hums.items())
    each = noise.reshape(periods, samples, 6)
    channels = Channels(time[:samples, 0], each.mean(axis=0), np.full(samples, 8), None, each)
    density, _ = noise_density(channels, step)
    with house_style():
        figure = noise_spectrum_figure.draw(SimpleNamespace(force_density=density))
    for j, axes in enumerate(figure.axes):
        (words,) = [text.get_text() for text in axes.texts]
        band, *lines = words.splitlines()
        low, high = (float(end) for end in re.findall(r"[+-][\d.]+", band.replace("−", "-")))
        freedom = float(np.median(density.freedom))
        expected = [100 * (freedom / stats.chi2.isf(p, freedom) - 1) for p in (0.025, 0.975)]
        np.testing.assert_allclose((low, high), expected, rtol=0.06)
        found = [[float(number) for number in re.findall(r"[\d.]+", line)] for line in lines]
        np.testing.assert_allclose(found, [*hums.items()], rtol=0.2)
        # They stand above everything that is drawn.
        drawn_to = axes.transData.transform((1.0, np.max(density.density[:, j])))[1]
        box = axes.texts[0].get_window_extent()
        assert box.y0 > drawn_to


def test_the_caption_of_residuals_names_the_actuators_that_fail(diagnosis):
    (residuals,) = (one for one in DIAGNOSTIC_FIGURES if one.key == "residuals")
    failed = np.flatnonzero(diagnosis.tests.lack_of_fit.failed) + 1
    assert 4 in failed  # with the cogging
    largest = np.nanargmax(diagnosis.tests.lack_of_fit.statistic) + 1
    text = residuals.seen(diagnosis)
    assert text.startswith(f"Actuators that fail: {', '.join(map(str, failed))}; the largest F is")
    assert text.endswith(f"of actuator {largest}.")
