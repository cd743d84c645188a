"""Inverse of banded equations against that of the dense matrix."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from estimation.measurement_model import SplineMotion
from estimation.measurement_model.banded import BandedInverse
from estimation.measurement_model.motion import MotionColumns, NormalEquations


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    size=st.integers(36, 130),
    band=st.integers(0, 50),
    rank=st.integers(0, 3),
    step=st.integers(1, 7),
)
def test_the_inverse_is_that_of_the_dense_matrix(seed, size, band, rank, step):
    rng, width = np.random.default_rng(seed), 36
    lower = np.tril(np.triu(rng.normal(size=(size, size)), -band))
    matrix = lower @ lower.T + np.eye(size)
    root, right = rng.normal(size=(size, rank)), rng.normal(size=(size, 4))
    found = replace(BandedInverse.of(sparse.csr_array(matrix)), root=root)
    inverse = np.linalg.inv(matrix)
    expected = inverse + root @ root.T
    np.testing.assert_allclose(np.asarray(found), expected, atol=1e-10)
    np.testing.assert_allclose(found @ right, expected @ right, atol=1e-9)
    np.testing.assert_allclose(found @ right[:, 0], expected @ right[:, 0], atol=1e-9)
    coloured = found.colour(np.eye(size))
    np.testing.assert_allclose(coloured @ coloured.T, inverse, atol=1e-10)
    blocks = found.blocks(width, step)
    assert len(blocks) == (size - width) // step + 1
    for k, block in enumerate(blocks):
        own = slice(k * step, k * step + width)
        np.testing.assert_allclose(block, expected[own, own], atol=1e-10)


def test_a_matrix_that_is_not_positive_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        BandedInverse.of(sparse.csr_array(np.diag([1.0, -1.0])))


def spline_equations(others):
    """Return equations of a spline and of other unknowns, and its columns, (6 S, k + x)."""
    rng, times = np.random.default_rng(2), np.linspace(0, 2, 160)
    motion = SplineMotion.over(times, 12)
    slope, own = rng.normal(size=(160, 6, 18)), rng.normal(size=(160, 6, others))
    columns = MotionColumns(own, slope, motion.at(times))
    rows = rng.normal(size=(160, 6)), columns, np.ones(160)
    return NormalEquations.of([rows], np.eye(6)), columns


def test_standard_deviations_along_a_spline_are_those_of_the_whole_covariance():
    equations, columns = spline_equations(0)
    covariance = BandedInverse.of(equations.matrix)
    factor = columns.sampled.motion.factor(covariance)
    whole, inverse = columns.dense(), np.linalg.inv(equations.matrix.toarray())
    expected = np.sqrt(np.einsum("srx,xy,sry->sr", whole, inverse, whole))
    np.testing.assert_allclose(columns.sampled.spread(columns.slope, factor), expected, rtol=1e-8)
    with pytest.raises(TypeError, match="banded"):
        columns.sampled.motion.factor(inverse)


@pytest.mark.parametrize("damping", [0.0, 1e-2])
def test_a_spline_is_eliminated_as_from_dense_equations(damping):
    kept = 4
    equations, _ = spline_equations(kept)
    prior = NormalEquations(1.0, 2.0 * np.eye(kept), np.arange(kept))
    equations = equations + prior
    dense = replace(equations, matrix=equations.matrix.toarray())
    found, expected = (each.eliminate(kept, damping) for each in (equations, dense))
    for name in ("matrix", "gradient", "slope", "offset"):
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max(), rtol=0)
