"""Matrices of Taylor models against the same in many digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.enclosure.matrices import TaylorMatrix, condition_bound
from expdesign.enclosure.taylor_model import TERMS
from tests.enclosure.exact import assert_holds

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(autouse=True)
def overflowing():
    """What is not known is infinite: no warning is needed of it."""
    with np.errstate(all="ignore"):
        yield


def drawn(rng, spread, size=4, scales=(1.0, 1.0), first=None):
    """Return a matrix in time over two cells, with what its functions add to the polynomials."""
    c = (
        rng.standard_normal((TERMS, 2, size, size))
        * spread ** np.arange(TERMS)[:, None, None, None]
    )
    c[0] = rng.standard_normal((2, size, size)) if first is None else first
    c = c * np.geomspace(*scales, size)[:, None]
    radius = np.abs(rng.standard_normal((2, size, size))) * rng.choice([0.0, 1e-12, 1e-4 * spread])
    return TaylorMatrix(c, radius), radius * rng.choice([-1.0, 0.0, 1.0], (2, size, size))


def at(matrix, off, cell, time):
    """Return a function's value of a matrix at τ in a cell, in many digits."""
    c = matrix.coefficients[:, cell]
    total = mpmath.matrix(off[cell].tolist())
    for k in range(TERMS):
        total += mpmath.matrix(c[k].tolist()) * mpmath.mpf(time) ** k
    return total


def assert_each_holds(found, cell, time, value):
    for row in range(found.radius.shape[1]):
        for column in range(found.radius.shape[2]):
            assert_holds(found[row, column], cell, time, value[row, column])


@given(seed=SEEDS, spread=st.sampled_from([0.0, 1e-6, 1e-2, 0.3]))
@settings(max_examples=50)
def test_products_and_inverses_hold(seed, spread):
    rng = np.random.default_rng(seed)
    (a, off_a), (b, off_b) = drawn(rng, spread), drawn(rng, spread)
    product, inverse = a @ b, a.inverse()
    for cell, time in ((0, 1.0), (1, float(rng.uniform(-1, 1)))):
        x, y = at(a, off_a, cell, time), at(b, off_b, cell, time)
        assert_each_holds(product, cell, time, x * y)
        assert_each_holds(inverse, cell, time, x**-1)
    assert_each_holds(a.transposed, 0, -1.0, at(a, off_a, 0, -1.0).T)


def test_the_inverse_of_a_matrix_that_hardly_moves_is_narrow():
    matrix, _ = drawn(np.random.default_rng(4), 1e-3)
    close = TaylorMatrix(matrix.coefficients, np.zeros_like(matrix.radius))

    assert np.all(close.inverse().radius < 1e-8)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_where_a_matrix_may_be_singular_nothing_is_known_of_its_inverse(value):
    matrix, _ = drawn(np.random.default_rng(5), 1e-3)
    matrix.coefficients[:, 0] = value

    found = matrix.inverse()

    assert np.all(np.isinf(found.radius[0]))
    assert np.all(np.isfinite(found.radius[1]))


def test_a_matrix_that_is_singular_between_the_middle_and_the_end_has_no_inverse():
    c = np.zeros((TERMS, 2, 2, 2))
    c[0], c[1, :, 0, 0] = np.eye(2), [1.5, 0.5]

    found = TaylorMatrix(c, np.zeros((2, 2, 2))).inverse()

    assert np.all(np.isinf(found.radius[0]))
    assert np.all(np.isfinite(found.radius[1]))


def condition(value):
    singular = mpmath.svd_r(value, compute_uv=False)
    return max(singular) / min(singular)


def repeated(rng, size):
    """Return matrices, (2, n, n), whose singular values are 1 or 2, each several times."""
    turns = [np.linalg.qr(rng.standard_normal((size, size)))[0] for _ in range(4)]
    values = np.where(np.arange(size) < size // 2, 1.0, 2.0)
    return np.stack([turns[0] * values @ turns[1], turns[2] * values @ turns[3]])


@given(
    seed=SEEDS,
    spread=st.sampled_from([0.0, 1e-9, 1e-4, 1e-2, 0.1]),
    scale=st.sampled_from([1.0, 0.1, 1e-3, 1e-5]),
    same=st.booleans(),
)
@settings(max_examples=80)
def test_no_condition_number_is_above_its_bound(seed, spread, scale, same):
    rng = np.random.default_rng(seed)
    matrix, off = drawn(
        rng, spread, size=6, scales=(1.0, scale), first=repeated(rng, 6) if same else None
    )

    _, high = condition_bound(matrix).bounds()

    for cell, time in ((0, -1.0), (1, float(rng.uniform(-1, 1)))):
        assert not float(condition(at(matrix, off, cell, time))) > high[cell]


def test_the_bound_of_a_condition_number_is_close_where_singular_values_stand_alone():
    rng = np.random.default_rng(8)
    matrix, _ = drawn(rng, 1e-4, size=6)
    matrix = TaylorMatrix(matrix.coefficients, np.zeros_like(matrix.radius))
    times = np.linspace(-1, 1, 41)
    powers = times[:, None] ** np.arange(TERMS)
    largest = [
        np.max(np.linalg.cond(np.tensordot(powers, matrix.coefficients[:, cell], 1)))
        for cell in range(2)
    ]

    _, high = condition_bound(matrix).bounds()

    assert high == pytest.approx(largest, rel=1e-6)


def test_the_bound_of_a_condition_number_holds_for_any_vectors_that_it_turns_to(monkeypatch):
    rng = np.random.default_rng(9)
    matrix, off = drawn(rng, 1e-4, size=6)
    true = np.linalg.svd

    def wrong(a, **options):
        u, s, rows = true(a, **options)
        return u, s, rows * np.array([0.98, 1, 1, 1, 1, 1.02])[:, None]

    monkeypatch.setattr(np.linalg, "svd", wrong)
    _, high = condition_bound(matrix).bounds()

    for cell in range(2):
        assert not float(condition(at(matrix, off, cell, 0.0))) > high[cell]


def test_the_bound_of_a_condition_number_counts_gaps_that_close_within_a_cell():
    c = np.zeros((TERMS, 1, 2, 2))
    c[0, 0], c[1, 0] = np.diag([2.0, 1.0]), [[-0.2, 0.2], [0.2, 0.0]]

    bound = condition_bound(TaylorMatrix(c, np.zeros((1, 2, 2))))

    for time in (-1.0, 1.0):
        true = np.linalg.cond(c[0, 0] + time * c[1, 0])
        assert true <= bound.at(np.array([time]))[0] + bound.radius[0] < 1.1 * true


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_matrix_that_may_be_singular_has_no_bound_of_its_condition_number(value):
    matrix, _ = drawn(np.random.default_rng(10), 1e-4, size=6)
    matrix.coefficients[:, 0, :, 0] = value
    matrix.radius[0] = 0.0

    _, high = condition_bound(matrix).bounds()

    assert not high[0] < np.inf
    assert np.isfinite(high[1])
