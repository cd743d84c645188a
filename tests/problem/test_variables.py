"""The variables of the series: more harmonics, and series that start at rest."""

import dataclasses

import numpy as np
import pytest

from expdesign.problem.program import LinearRows, RowIndex
from expdesign.problem.variables import DesignVariables
from expdesign.trajectory import PhaseBasis


@pytest.mark.parametrize(("few", "many"), [(1, 1), (1, 4), (3, 12)])
def test_a_longer_series_holds_the_same_motion(few, many):
    rng = np.random.default_rng(few + many)
    scale, center = rng.uniform(0.1, 1, 6), rng.normal(size=6)

    def variables(harmonics):
        return DesignVariables(harmonics, scale, center, (0.5, 4.0), 4.0)

    short = rng.normal(size=12 * few + 7)
    long = variables(few).extend(short, many)
    assert long.shape == (12 * many + 7,)
    phases = np.linspace(0, 2 * np.pi, 17)
    before = variables(few).states(short, PhaseBasis.at(phases, few))
    after = variables(many).states(long, PhaseBasis.at(phases, many))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12)


def test_one_unit_of_each_harmonic_has_the_same_speed():
    n, scale = 6, np.array([0.1, 0.2, 0.3, 1.0, 0.5, 0.7])
    variables = DesignVariables(n, scale, np.zeros(6), (0.5, 4.0), 4.0)
    for i in range(6):
        for k in range(1, n + 1):
            for column in (k, n + k):
                x = np.zeros(variables.size)
                x[i * variables.per_coordinate + column], x[-1] = 1.0, 0.5
                motion = variables.states(x, PhaseBasis.at(np.linspace(0, 2 * np.pi, 241), n))
                assert np.max(np.abs(motion[:, i])) == pytest.approx(scale[i] / k)
                assert np.max(np.abs(motion[:, 6 + i])) == pytest.approx(2.0 * scale[i])
    packed = variables.pack(variables.trajectory(x))
    np.testing.assert_allclose(packed, x, atol=1e-14)


@pytest.fixture(params=[2, 5, 12])
def at_rest(request):
    rng = np.random.default_rng(request.param)
    scale, center = rng.uniform(0.1, 1, 6), rng.normal(size=6)
    return DesignVariables(request.param, scale, center, (0.5, 4.0), 4.0, rest=True)


@pytest.fixture
def point(at_rest):
    return np.append(np.random.default_rng(0).normal(size=at_rest.size - 1), 0.7)


def test_a_series_at_rest_starts_at_rest_whatever_its_variables(at_rest, point):
    assert point.size == 12 * at_rest.harmonics - 5
    trajectory = at_rest.trajectory(point)
    start = trajectory.sample(0.0)
    np.testing.assert_allclose(start.rate, 0, atol=1e-10)
    np.testing.assert_allclose(start.acceleration, 0, atol=1e-9)
    assert np.min(np.ptp(trajectory.sample(trajectory.sample_times(50)).pose, axis=0)) > 0.01
    states = at_rest.states(point, PhaseBasis.at(np.zeros(1), at_rest.harmonics))
    np.testing.assert_allclose(states[0, 6:], 0, atol=1e-9)


def test_variables_at_rest_are_as_many_as_there_are_such_series(at_rest, point):
    """Packing is the inverse, so that no two points are the same motion."""
    np.testing.assert_allclose(at_rest.pack(at_rest.trajectory(point)), point, atol=1e-12)
    assert at_rest.orders.size == at_rest.per_coordinate


def test_a_longer_series_at_rest_holds_the_same_motion(at_rest, point):
    longer = dataclasses.replace(at_rest, harmonics=at_rest.harmonics + 3)
    phases = np.linspace(0, 2 * np.pi, 17)
    before = at_rest.states(point, PhaseBasis.at(phases, at_rest.harmonics))
    extended = at_rest.extend(point, longer.harmonics)
    after = longer.states(extended, PhaseBasis.at(phases, longer.harmonics))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-10)


def test_sensitivities_at_rest_against_differences(at_rest, point):
    basis = PhaseBasis.at(np.array([0.3, 2.0]), at_rest.harmonics)
    unit = np.tile(np.eye(18), (2, 1, 1))
    slope = at_rest.slope(point, basis)
    rows = RowIndex.of(np.ones((2, 18), dtype=bool), np.ones(18))
    slopes = LinearRows(np.zeros(36), slope, unit, rows).jacobian().reshape(2, 18, point.size)
    h = 1e-6
    for k in range(point.size):
        step = np.zeros_like(point)
        step[k] = h
        ahead, behind = (at_rest.states(point + s * step, basis) for s in (1, -1))
        difference = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(
            slopes[:, :, k], difference, atol=1e-7 * max(1.0, np.max(np.abs(difference)))
        )
    summed = slope.transposed_products(unit.transpose(0, 2, 1)).T
    np.testing.assert_allclose(summed, slopes.sum(axis=0), rtol=1e-9, atol=1e-9)
