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
