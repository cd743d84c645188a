"""Figures of diagnostics, drawn from a small simulated experiment with cogging."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.diagnosis import diagnose
from results.figures.drawing import save_figures
from results.figures.noise import NOISE_FIGURES
from results.figures.residuals import DIAGNOSTIC_FIGURES
from results.style import PAGE_WIDTH, RESOLUTION, house_style
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
    return diagnose(lab.robot, [experiment], lab.knowledge, estimate).experiments[0]


@pytest.fixture(scope="module")
def figures(diagnosis):
    return drawn(diagnosis)


def _texts(axes):
    return " ".join(text.get_text() for text in axes.texts)


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
    assert len(figures["residual_dependence"].axes) == 12


def test_given_noise_and_pointwise_kinematics_can_be_drawn():
    lab = Laboratory(samples=120, periods=2)
    experiment = replace(lab.pointwise(lab.measure(1)), noise=lab.noise)
    estimate = lab.estimate([experiment])
    result = diagnose(lab.robot, [experiment], lab.knowledge, estimate).experiments[0]
    for key, figure in drawn(result).items():
        assert figure.axes, key
