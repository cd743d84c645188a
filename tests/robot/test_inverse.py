"""The inverse that the graph is made with."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from expdesign.mechanism.graph import inverse


def _function(size):
    matrix = ca.SX.sym("matrix", size, size)
    return ca.Function("inverse", [matrix], [inverse(matrix)], {"cse": True})


FUNCTIONS = {size: _function(size) for size in (1, 2, 3, 6)}


@given(st.sampled_from([1, 2, 3, 6]), st.floats(0, 8), st.integers(0, 2**32 - 1))
def test_it_is_as_accurate_as_the_condition_allows(size, decades, seed):
    rng = np.random.default_rng(seed)
    left, _, right = np.linalg.svd(rng.normal(size=(size, size)))
    values = np.logspace(0, -decades, size)
    found = np.array(FUNCTIONS[size](left @ np.diag(values) @ right))
    expected = right.T @ np.diag(1 / values) @ left.T
    # Relative errors of the inverse grow with the condition: half of the digits at 1e8.
    allowed = 1e-15 * size**2 / values[-1] ** 2
    np.testing.assert_allclose(found, expected, rtol=0, atol=allowed)


@pytest.mark.parametrize("size", [3, 6])
def test_it_divides_once_for_every_column(size):
    function = FUNCTIONS[size]
    made = [function.instruction_id(k) for k in range(function.n_instructions())]
    assert sum(made.count(one) for one in (ca.OP_DIV, ca.OP_INV)) == size
