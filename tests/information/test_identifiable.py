"""Base parameters of planted dependencies, and combinations that noise leaves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.information.identifiable import (
    BaseParameters,
    identified_base,
    known_combinations,
    root_of,
    root_of_inverse,
)

NAMES = tuple("abcdefgh")


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def _planted(rng, rank, sizes):
    """Return W of a rank, (60, 8), whose columns have the sizes, and its null space."""
    basis = rng.normal(size=(60, rank)) @ rng.normal(size=(rank, 8))
    return basis * sizes


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 8), st.floats(0, 6))
def test_forces_are_those_of_the_combinations_alone(seed, rank, spread):
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-spread, spread, 8)
    W = _planted(rng, rank, sizes)
    found = BaseParameters.of(W, NAMES)
    assert len(found.base) == rank
    at = [NAMES.index(name) for name in found.base]
    left = [k for k in range(8) if k not in at]
    np.testing.assert_array_equal(found.matrix[:, at], np.eye(rank))
    p = rng.normal(size=8) / sizes
    same = np.zeros(8)
    same[at] = found.values(p)
    forces = W @ p
    np.testing.assert_allclose(W @ same, forces, rtol=0, atol=1e-7 * np.max(np.abs(forces)))
    # What is left out may be anything: the others make up for it.
    other = np.zeros(8)
    other[left] = rng.normal(size=len(left)) / sizes[left]
    other[at] = found.values(p) - found.matrix[:, left] @ other[left]
    np.testing.assert_allclose(found.values(other), found.values(p), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(W @ other, forces, rtol=0, atol=1e-6 * np.max(np.abs(forces)))


def test_coefficients_are_those_that_were_planted(rng):
    W = rng.normal(size=(60, 8))
    W[:, 6] = 2.5 * W[:, 1] - 4e3 * W[:, 3]
    W[:, 5] = 0
    found = BaseParameters.of(W, NAMES, keep=np.where(np.array(list(NAMES)) == "g", 0.01, 1.0))
    assert found.regrouped == ("f", "g")
    assert found.into("g") == ("b", "d")
    assert found.into("f") == ()
    assert found.members("b") == pytest.approx({"g": 2.5})
    assert found.members("d") == pytest.approx({"g": -4e3})
    assert found.combined == ("b", "d")
    assert found.text("b") == "b + 2.5 g"
    first, second = found.sentences()
    assert "f" in first
    assert all(part in second for part in ("g", found.text("d")))


def test_of_equal_columns_the_wanted_one_stays(rng):
    W = rng.normal(size=(60, 8))
    W[:, 6] = W[:, 1]
    for away in ("b", "g"):
        keep = np.where(np.array(list(NAMES)) == away, 0.25, 1.0)
        assert BaseParameters.of(W, NAMES, keep=keep).regrouped == (away,)
    # Without a wish the later one goes, whatever rounding says.
    for seed in range(5):
        turned = np.linalg.qr(np.random.default_rng(seed).normal(size=(60, 60)))[0] @ W
        assert BaseParameters.of(turned, NAMES).regrouped == ("g",)


def test_nothing_and_less_rows_than_parameters(rng):
    assert BaseParameters.of(np.zeros((5, 8)), NAMES).base == ()
    assert len(BaseParameters.of(rng.normal(size=(3, 8)), NAMES).base) == 3


def test_roots_of_an_information_of_any_scale(rng):
    scales = 10.0 ** rng.uniform(-6, 6, 8)
    W = rng.normal(size=(60, 8)) * scales
    F = W.T @ W
    covariance = np.linalg.inv(F / np.outer(scales, scales)) / np.outer(scales, scales)
    for root in (root_of(F), root_of_inverse(covariance)):
        np.testing.assert_allclose(
            (root.T @ root) / np.outer(scales, scales), F / np.outer(scales, scales), atol=1e-9 * 60
        )


# --- what noise leaves ----------------------------------------------------------------------------


@pytest.fixture
def weak(rng):
    """Return F with two directions that are hardly seen, and scales of the parameters."""
    scales = 10.0 ** rng.uniform(-2, 2, 8)
    basis = np.linalg.qr(rng.normal(size=(8, 8)))[0]
    # Standard deviations of the directions, in scales.
    std = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.49, 0.51, 30.0])
    F = (basis / std**2) @ basis.T / np.outer(scales, scales)
    return F, scales


def test_as_many_combinations_as_directions_that_count(weak):
    F, scales = weak
    assert len(identified_base(root_of(F), NAMES, scales).base) == 6
    assert len(identified_base(root_of(100 * F), NAMES, scales).base) == 7
    assert identified_base(root_of(1e6 * F), NAMES, scales).base == NAMES
    assert identified_base(root_of(1e-6 * F), NAMES, scales).base == ()


def test_combinations_are_known_as_if_the_others_were(weak):
    F, scales = weak
    base = identified_base(root_of(F), NAMES, scales)
    covariance = np.linalg.inv(F)
    at = [NAMES.index(name) for name in base.base]
    left = [k for k in range(8) if k not in at]
    expected = np.sqrt(np.diag(np.linalg.inv(F[np.ix_(at, at)])))
    spread = base.matrix @ covariance @ base.matrix.T
    np.testing.assert_allclose(np.sqrt(np.diag(spread)), expected, rtol=1e-6)
    # Nothing that is left out moves them.
    apart = base.matrix @ covariance[:, left]
    size = np.outer(expected, np.sqrt(np.diag(covariance)[left]))
    np.testing.assert_allclose(apart / size, 0, atol=1e-6)
    # Any other coefficients are known less well.
    rng = np.random.default_rng(0)
    for _ in range(20):
        other = base.matrix.copy()
        other[:, left] += rng.normal(size=(len(at), len(left))) * np.outer(
            scales[at], 1 / scales[left]
        )
        assert np.all(np.diag(other @ covariance @ other.T) >= expected**2)


@pytest.fixture
def catalogued(monkeypatch):
    monkeypatch.setattr("expdesign.information.identifiable.parameter_unit", lambda name: "kg")


@pytest.mark.usefixtures("catalogued")
def test_rows_of_what_is_known(weak):
    F, scales = weak
    covariance, values = np.linalg.inv(F), np.arange(8.0)
    base = identified_base(root_of(F), NAMES, scales)
    each = BaseParameters.each(NAMES)
    rows = known_combinations(base, each, NAMES, values, covariance, scales)
    assert [row.parameter for row in rows] == list(base.base)
    for row in rows:
        k = NAMES.index(row.parameter)
        members = base.members(row.parameter)
        assert row.regrouped == ", ".join(members)
        assert row.value == pytest.approx(
            values[k] + sum(c * values[NAMES.index(n)] for n, c in members.items())
        )
        assert row.std_alone == pytest.approx(np.sqrt(covariance[k, k]))
        assert row.std <= row.std_alone
        assert row.rel_std_percent == pytest.approx(100 * row.std / scales[k])
        assert row.identified == (row.std < 0.5 * scales[k])


@pytest.mark.usefixtures("catalogued")
def test_noise_over_a_structure(rng):
    """h is g once more; a is hidden by noise."""
    W = rng.normal(size=(200, 8))
    W[:, 7] = -3 * W[:, 6]
    W[:, 0] *= 1e-6
    structure = BaseParameters.of(W, NAMES)
    assert structure.regrouped == ("h",)
    own = W[:, :7]
    base = identified_base(own, structure.base, np.ones(7))
    assert base.regrouped == ("a",)
    covariance = np.zeros((8, 8))
    covariance[:7, :7] = np.linalg.inv(own.T @ own)
    values = rng.normal(size=8)
    rows = known_combinations(base, structure, NAMES, values, covariance, np.ones(8))
    (last,) = [row for row in rows if row.parameter == "g"]
    assert np.isnan(last.std_alone)
    assert last.together
    assert last.value == pytest.approx(
        values[6] - 3 * values[7] + base.members("g")["a"] * values[0]
    )
    assert last.std == pytest.approx(
        np.sqrt(np.linalg.inv(own[:, 1:].T @ own[:, 1:])[-1, -1]), rel=1e-6
    )
    # Another value of what no force tells, and what makes up for it: the same combinations.
    moved = values + np.array([0, 0, 0, 0, 0, 0, 3.0, 1.0])
    again = known_combinations(base, structure, NAMES, moved, covariance, np.ones(8))
    assert [row.value for row in again] == pytest.approx([row.value for row in rows])
