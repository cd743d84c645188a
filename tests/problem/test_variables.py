"""More harmonics: the same motion in a longer series."""

import numpy as np
import pytest

from expdesign.problem import DesignVariables
from expdesign.trajectory import PhaseBasis


@pytest.mark.parametrize(("few", "many"), [(1, 1), (1, 4), (3, 12)])
def test_a_longer_series_holds_the_same_motion(few, many):
    rng = np.random.default_rng(few + many)
    scale, center = rng.uniform(0.1, 1, 6), rng.normal(size=6)

    def variables(harmonics):
        return DesignVariables(harmonics, scale, center, (0.5, 4.0), 4.0)

    short = rng.normal(size=12 * few + 7)
    long = variables(few).extended(short, many)
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
