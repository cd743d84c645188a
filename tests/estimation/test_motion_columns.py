"""Products of columns along a motion, beside those of the columns written down."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import MotionColumns, NormalEquations


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    harmonics=st.integers(1, 12),
    orders=st.integers(1, 3),
    others=st.integers(0, 5),
    free_frequency=st.booleans(),
)
def test_products_are_those_of_the_columns(seed, harmonics, orders, others, free_frequency):
    """At any times, of any number of derivatives, with the frequency or without."""
    rng = np.random.default_rng(seed)
    motion = HarmonicMotion(rng.normal(size=(6, 2 * harmonics + 1)), 3.0, free_frequency)
    columns = MotionColumns(
        rng.normal(size=(50, 6, others)),
        rng.normal(size=(50, 6, 6 * orders)),
        motion.at(rng.uniform(0, 20, 50)),
    )
    steps = rng.normal(size=(others + motion.unknowns, 3))
    moved = columns.dense() @ steps
    np.testing.assert_allclose(columns.times(steps), moved, atol=1e-12 * np.abs(moved).max())
    residuals, weights = rng.normal(size=(50, 6)), rng.normal(size=(6, 6))
    both = np.concatenate([residuals[:, :, None], columns.dense()], axis=2)
    rows = np.matmul(weights, both).reshape(300, -1)
    expected = rows.T @ rows
    scale = np.sqrt(np.diag(expected))
    found = columns.products(residuals, weights)
    # The motion's own columns may be next to nothing beside those of its derivatives.
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-10
    )


@pytest.mark.parametrize("counts", [np.full(60, 7.0), np.linspace(1.0, 9.0, 60)])
def test_equations_of_columns_written_down_or_not(counts):
    """Parts of any size and weight sum up to the same equations."""
    rng = np.random.default_rng(1)
    motion = HarmonicMotion(rng.normal(size=(6, 9)), 2.0)
    times, root = np.linspace(0, 3, 60), rng.normal(size=(6, 6))
    slope, residuals = rng.normal(size=(60, 6, 18)), rng.normal(size=(60, 6))
    others = rng.normal(size=(60, 6, 4))

    def rows(part, written):
        columns = MotionColumns(others[part], slope[part], motion.at(times[part]))
        return residuals[part], columns.dense() if written else columns, counts[part]

    parts = [slice(0, 11), slice(11, 60)]
    dense, short = (
        NormalEquations.of([rows(part, written) for part in parts], root @ root.T)
        for written in (True, False)
    )
    np.testing.assert_allclose(short.cost, dense.cost, rtol=1e-12)
    for one, other in ((short.matrix, dense.matrix), (short.gradient, dense.gradient)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.max(np.abs(other)))
