import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.information.criteria import criteria, log_sum_exp, spectral_cost

KEYS = ("a", "condition", "d", "e")
EXACT = ("d", "a")


@pytest.fixture(params=KEYS)
def criterion(request):
    return criteria()[request.param]


@pytest.fixture
def levels_and_logs(criterion):
    rng = np.random.default_rng(1)
    return [
        (level, np.sort(rng.normal(size=8) * spread))
        for level in criterion.levels
        for spread in (0.3, 2.0, 6.0)
    ]


def _spd(rng, m, spread=3.0):
    basis = np.linalg.qr(rng.normal(size=(m, m)))[0]
    return (basis * np.exp(spread * rng.normal(size=m))) @ basis.T


def _symmetric(rng, m):
    change = rng.normal(size=(m, m))
    return change + change.T


# --- the catalogue --------------------------------------------------------------------------------


def test_protocol(criterion):
    assert criteria()[criterion.key] is criterion
    assert criterion.title
    assert isinstance(criterion.larger_is_better, bool)
    assert isinstance(criterion.invariant, bool)
    assert isinstance(criterion.flat, bool)
    assert criterion.levels
    assert list(criterion.levels) == sorted(criterion.levels)
    logs = np.linspace(-1, 1, 5)
    for level in criterion.levels:
        value, gradient, hessian = criterion.cost(logs, level)
        assert isinstance(value, float)
        assert gradient.shape == (5,)
        assert hessian.shape == (5, 5)
    assert isinstance(criterion.value(np.exp(logs)), float)
    assert isinstance(criterion.from_cost(0.1, 5, 20, 0.0), float)


# --- the reported number --------------------------------------------------------------------------


def test_values_are_those_of_the_matrix():
    F = _spd(np.random.default_rng(0), 6, spread=1.0)
    eigenvalues = np.linalg.eigvalsh(F)
    for key, expected in (
        ("d", np.linalg.slogdet(F)[1]),
        ("a", np.trace(np.linalg.inv(F))),
        ("e", 1 / np.linalg.norm(np.linalg.inv(F), 2)),
        ("condition", np.linalg.cond(F)),
    ):
        assert criteria()[key].value(eigenvalues) == pytest.approx(expected, rel=1e-10), key


def test_direction(criterion):
    eigenvalues = np.array([0.1, 1.0, 3.0])
    better = np.array([0.2, 1.0, 3.0])
    gain = criterion.value(better) - criterion.value(eigenvalues)
    assert (gain > 0) is criterion.larger_is_better


def test_a_lower_cost_is_a_better_value(criterion):
    eigenvalues, better = np.array([0.1, 1.0, 3.0]), np.array([0.2, 1.0, 3.0])
    for level in criterion.levels:
        costs = [criterion.cost(np.log(k), level)[0] for k in (eigenvalues, better)]
        assert costs[1] < costs[0]


def test_rescaling_only_shifts_the_cost_of_an_invariant_criterion():
    # log det (D F D) = log det F + 2 Σ log D; for no other criterion.
    rng = np.random.default_rng(2)
    scale = np.exp(rng.normal(size=6))
    shifts = {key: [] for key in KEYS}
    for _ in range(3):
        F = _spd(rng, 6, spread=1.0)
        for key in KEYS:
            cost = criteria()[key].cost
            level = criteria()[key].levels[0]
            values = [
                cost(np.log(np.linalg.eigvalsh(k)), level)[0]
                for k in (F, F * np.multiply.outer(scale, scale))
            ]
            shifts[key].append(values[1] - values[0])
    for key, values in shifts.items():
        assert bool(np.ptp(values) < 1e-10) is criteria()[key].invariant, key
    assert shifts["d"][0] == pytest.approx(-2 * np.sum(np.log(scale)) / 6)


# --- from cost to number --------------------------------------------------------------------------


@pytest.mark.parametrize("key", EXACT)
def test_an_exact_cost_gives_the_number_back(key):
    criterion = criteria()[key]
    rng = np.random.default_rng(3)
    eigenvalues, samples = np.exp(rng.normal(size=7)), 150
    cost = criterion.cost(np.log(eigenvalues / samples), criterion.levels[-1])[0]
    number = criterion.from_cost(cost, 7, samples, 0.0)
    assert number == pytest.approx(criterion.value(eigenvalues), rel=1e-12)


def test_d_is_told_in_si():
    criterion = criteria()["d"]
    rng = np.random.default_rng(4)
    F, scale, samples = _spd(rng, 5), np.exp(rng.normal(size=5)), 40
    scaled = F * np.multiply.outer(scale, scale) / samples
    cost = criterion.cost(np.log(np.linalg.eigvalsh(scaled)), 0.0)[0]
    number = criterion.from_cost(cost, 5, samples, float(np.sum(np.log(scale))))
    assert number == pytest.approx(np.linalg.slogdet(F)[1], rel=1e-10)


@pytest.mark.parametrize("key", ["e", "condition"])
def test_a_surrogate_gives_the_number_within_its_bluntness(key):
    criterion = criteria()[key]
    rng = np.random.default_rng(5)
    m, samples = 24, 100
    for _ in range(20):
        eigenvalues = np.exp(4 * rng.normal(size=m))
        for level in criterion.levels:
            cost = criterion.cost(np.log(eigenvalues / samples), level)[0]
            number = criterion.from_cost(cost, m, samples, 0.0)
            ratio = number / criterion.value(eigenvalues)
            # The power norm of m values is between the largest and m^(1/p) of it.
            bluntness = m ** (1 / level)
            if key == "e":
                assert 1 / bluntness - 1e-9 <= ratio <= 1 + 1e-9
            else:
                assert 1 - 1e-9 <= ratio <= bluntness**2 + 1e-9


# --- derivatives to the logarithms ----------------------------------------------------------------


def test_gradient_and_hessian_to_the_logarithms(criterion, levels_and_logs):
    h = 1e-5
    for level, logs in levels_and_logs:
        _, gradient, hessian = criterion.cost(logs, level)
        for k in range(logs.size):
            step = h * np.eye(logs.size)[k]
            above, below = criterion.cost(logs + step, level), criterion.cost(logs - step, level)
            slope = (above[0] - below[0]) / (2 * h)
            assert slope == pytest.approx(gradient[k], rel=1e-6, abs=1e-8)
            np.testing.assert_allclose(
                (above[1] - below[1]) / (2 * h), hessian[k], rtol=1e-5, atol=1e-6
            )


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-700, 700), min_size=1, max_size=24), st.sampled_from([1, 4, 16]))
def test_log_sum_exp_is_finite_and_close_to_the_extreme(logs, power):
    logs = np.array(logs)
    high, slope, curvature = log_sum_exp(logs, power)
    low, opposite, _ = log_sum_exp(logs, -power)
    slack = np.log(logs.size) / power + 1e-9
    assert np.max(logs) - 1e-9 <= high <= np.max(logs) + slack
    assert -np.min(logs) - 1e-9 <= low <= -np.min(logs) + slack
    assert np.sum(slope) == pytest.approx(1)
    assert np.sum(opposite) == pytest.approx(-1)
    assert np.min(np.linalg.eigvalsh(curvature)) >= -1e-9


# --- derivatives to F -----------------------------------------------------------------------------


def _cost_of(F, criterion, level):
    return criterion.cost(np.log(np.linalg.eigvalsh(F)), level)[0]


def _first(cost, change):
    E = cost.basis.T @ change @ cost.basis
    return cost.slope @ np.diag(E)


def _second(cost, change):
    E = cost.basis.T @ change @ cost.basis
    diagonal, mixing = cost.curvature()
    return np.diag(E) @ diagonal @ np.diag(E) + np.sum(mixing * E**2)


def _along(function, h):
    """First and second derivative at zero by differences of fourth order."""
    m2, m1, zero, p1, p2 = (function(k * h) for k in (-2, -1, 0, 1, 2))
    first = (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h)
    return first, (-m2 + 16 * m1 - 30 * zero + 16 * p1 - p2) / (12 * h * h)


@pytest.mark.parametrize("seed", range(5))
def test_slope_along_any_change_of_the_information(seed, criterion):
    rng = np.random.default_rng(seed)
    F = _spd(rng, 7, spread=1.0)
    change = _symmetric(rng, 7) * np.min(np.linalg.eigvalsh(F))
    for level in criterion.levels:
        cost = spectral_cost(F, criterion, level)
        assert cost.value == pytest.approx(_cost_of(F, criterion, level), rel=1e-12)
        first, _ = _along(lambda t, p=level: _cost_of(F + t * change, criterion, p), 1e-3)
        assert _first(cost, change) == pytest.approx(first, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("key", [*EXACT, "e"])
def test_curvature_of_convex_criteria_is_the_true_one(seed, key):
    criterion = criteria()[key]
    rng = np.random.default_rng(seed)
    F = _spd(rng, 7, spread=0.8)
    change = _symmetric(rng, 7) * np.min(np.linalg.eigvalsh(F))
    for level in criterion.levels:
        cost = spectral_cost(F, criterion, level)
        _, second = _along(lambda t, p=level: _cost_of(F + t * change, criterion, p), 2e-3)
        assert _second(cost, change) == pytest.approx(second, rel=1e-4, abs=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_curvature_is_never_below_the_true_one(seed, criterion):
    rng = np.random.default_rng(seed)
    F = _spd(rng, 7, spread=0.8)
    for level in criterion.levels:
        cost = spectral_cost(F, criterion, level)
        diagonal, mixing = cost.curvature()
        assert np.min(np.linalg.eigvalsh(diagonal)) >= -1e-9 * np.max(np.abs(diagonal))
        assert np.min(mixing) >= 0
        assert not np.any(np.diag(mixing))
        for _ in range(5):
            change = _symmetric(rng, 7) * np.min(np.linalg.eigvalsh(F))
            _, second = _along(lambda t, c=change, p=level: _cost_of(F + t * c, criterion, p), 2e-3)
            assert _second(cost, change) >= second - 1e-4 * abs(second) - 1e-6
            assert _second(cost, change) >= 0


@pytest.mark.parametrize("key", EXACT)
def test_coinciding_eigenvalues(key):
    criterion = criteria()[key]
    rng = np.random.default_rng(8)
    basis = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    for eigenvalues in ([2.0] * 6, [1, 1, 1, 5, 5, 9], [1, 1 + 1e-11, 2, 3, 4, 5]):
        F = (basis * eigenvalues) @ basis.T
        change = 0.3 * _symmetric(rng, 6)
        for level in criterion.levels:
            cost = spectral_cost(F, criterion, level)
            first, second = _along(
                lambda t, M=F, c=change, p=level: _cost_of(M + t * c, criterion, p), 5e-3
            )
            assert _first(cost, change) == pytest.approx(first, rel=1e-6, abs=1e-8)
            assert _second(cost, change) == pytest.approx(second, rel=1e-4, abs=1e-6)


def test_d_against_its_textbook_derivatives():
    rng = np.random.default_rng(9)
    F, change = _spd(rng, 8), _symmetric(rng, 8)
    cost = spectral_cost(F, criteria()["d"], 0.0)
    step = np.linalg.solve(F, change)
    assert _first(cost, change) == pytest.approx(-np.trace(step) / 8, rel=1e-7)
    assert _second(cost, change) == pytest.approx(np.trace(step @ step) / 8, rel=1e-7)


def test_a_against_its_textbook_derivatives():
    rng = np.random.default_rng(10)
    F, change = _spd(rng, 8, spread=1.0), _symmetric(rng, 8)
    cost = spectral_cost(F, criteria()["a"], 1.0)
    inverse = np.linalg.inv(F)
    total = np.trace(inverse)
    first = -np.trace(inverse @ change @ inverse) / total
    second = 2 * np.trace(inverse @ change @ inverse @ change @ inverse) / total - first**2
    assert _first(cost, change) == pytest.approx(first, rel=1e-8)
    assert _second(cost, change) == pytest.approx(second, rel=1e-8)


def test_nearly_singular_information_stays_finite(criterion):
    # Rounding leaves eigenvalues at either sign.
    rng = np.random.default_rng(11)
    columns = rng.normal(size=(40, 6))
    columns[:, 5] = columns[:, 0]
    F = columns.T @ columns
    for level in criterion.levels:
        cost = spectral_cost(F, criterion, level)
        for part in (cost.value, cost.slope, cost.curvature().diagonal, cost.curvature().mixing):
            assert np.all(np.isfinite(part))
