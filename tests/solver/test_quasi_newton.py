"""The damped update of a Hessian: what it learns, and what it keeps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from expdesign.solver.interior_point import update_hessian

SIZES = st.integers(2, 8)
SEEDS = st.integers(0, 2**32 - 1)


def semidefinite(rng, size, rank):
    root = rng.normal(size=(size, rank))
    return root @ root.T


@given(SIZES, SEEDS)
def test_where_there_is_curvature_enough_it_explains_the_change(size, seed):
    rng = np.random.default_rng(seed)
    hessian, true = (semidefinite(rng, size, size) + np.eye(size) for _ in range(2))
    step = rng.normal(size=size)
    change = true @ step
    found = update_hessian(hessian, step, change)
    np.testing.assert_allclose(found, found.T, atol=1e-9)
    if step @ change >= 0.2 * step @ hessian @ step:
        np.testing.assert_allclose(found @ step, change, rtol=1e-7, atol=1e-9)


@given(SIZES, SEEDS, st.floats(-10, 10))
def test_it_stays_positive_semidefinite_whatever_the_change(size, seed, curvature):
    rng = np.random.default_rng(seed)
    hessian = semidefinite(rng, size, int(rng.integers(1, size + 1)))
    step = rng.normal(size=size)
    change = curvature * step + rng.normal(size=size)
    found = update_hessian(hessian, step, change)
    smallest = np.linalg.eigvalsh(found)[0]
    assert smallest >= -1e-9 * np.linalg.norm(found)
    # A fifth of the curvature along the step is left at least.
    rounding = 1e-14 * np.linalg.norm(found) * step @ step
    assert step @ found @ step >= 0.2 * step @ hessian @ step * (1 - 1e-9) - rounding


@given(SIZES, SEEDS)
def test_n_steps_find_the_hessian_of_a_quadratic_function(size, seed):
    """Exactly, where the steps are conjugate (Nocedal, Wright 2006, theorem 6.4)."""
    rng = np.random.default_rng(seed)
    true = semidefinite(rng, size, size) + np.eye(size)
    _, conjugate = np.linalg.eigh(true)
    # With less curvature than the true one nothing is damped.
    found = 0.5 * np.eye(size)
    for step in conjugate.T:
        found = update_hessian(found, step, true @ step)
    np.testing.assert_allclose(found, true, rtol=1e-6, atol=1e-8)


def test_a_step_without_curvature_or_a_change_without_a_number_tells_nothing():
    hessian = np.diag([1.0, 0.0])
    for step, change in (
        (np.array([0.0, 1.0]), np.array([1.0, 1.0])),
        (np.zeros(2), np.zeros(2)),
        (np.array([1.0, 0.0]), np.array([np.nan, 0.0])),
    ):
        assert update_hessian(hessian, step, change) is hessian
