"""What is known of a change, against the joint problem that it is the Schur complement of."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from expdesign.configuration.tolerances import Identification, IdentifiedDeviation
from expdesign.information.criteria import criteria
from expdesign.information.marginal import Marginal, earlier_information

M, CHANGED = 7, np.array([1, 2, 5])


def _matrix(rng, size=M):
    """A covariance or information with correlations and different units."""
    factor = rng.normal(size=(size, 2 * size)) * 10 ** rng.uniform(-1, 1, size)[:, None]
    return factor @ factor.T


def _prior(covariance, changed=CHANGED, samples=1.0, **more):
    known = Identification(
        run="run",
        estimator="gm",
        verdict="accepted",
        parameters=tuple(f"p{k}" for k in range(len(covariance))),
        covariance_random=covariance.tolist(),
        covariance_systematic=np.zeros_like(covariance).tolist(),
        **more,
    )
    return Marginal.of_change(known, changed, samples)


def _joint(information, covariance):
    """F of (π, p), with the columns of what has changed twice and the prior on p alone."""
    chosen = np.eye(M)[:, CHANGED]
    return np.block(
        [
            [chosen.T @ information @ chosen, chosen.T @ information],
            [information @ chosen, information + np.linalg.inv(covariance)],
        ]
    )


@given(st.integers(0, 10_000), st.floats(1e-3, 1e3))
def test_it_is_the_schur_complement_of_the_joint_problem(seed, weight):
    rng = np.random.default_rng(seed)
    information, covariance = weight * _matrix(rng), _matrix(rng)
    joint = _joint(information, covariance)
    expected = np.linalg.inv(np.linalg.inv(joint)[:3, :3])
    found = _prior(covariance).information(information, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.max(expected))
    whole, others = (np.linalg.slogdet(each)[1] for each in (joint, joint[3:, 3:]))
    assert np.linalg.slogdet(found)[1] == pytest.approx(whole - others, abs=1e-5)


def test_what_is_known_exactly_is_no_nuisance():
    rng = np.random.default_rng(1)
    information = _matrix(rng)
    exact = _prior(np.zeros((M, M))).information(information, 1)
    np.testing.assert_allclose(exact, information[np.ix_(CHANGED, CHANGED)], rtol=1e-12)
    # A covariance without rank: the limit of those with it.
    direction = rng.normal(size=(M, 1))
    rankless = direction @ direction.T
    found = _prior(rankless).information(information, 1)
    near = _prior(rankless + 1e-9 * np.eye(M)).information(information, 1)
    np.testing.assert_allclose(found, near, rtol=1e-5, atol=1e-6)


def test_data_that_tell_nothing_tell_nothing_of_the_change():
    rng = np.random.default_rng(2)
    row = rng.normal(size=(1, M))
    found = _prior(_matrix(rng)).information(row.T @ row, 1)
    assert np.linalg.matrix_rank(found, tol=1e-9) == 1


@given(st.integers(0, 10_000))
def test_who_knows_more_before_knows_more_after(seed):
    rng = np.random.default_rng(seed)
    information, covariance = _matrix(rng), _matrix(rng)
    less = _prior(covariance + _matrix(rng)).information(information, 1)
    more = _prior(covariance).information(information, 1)
    gained = np.linalg.eigvalsh(more - less)
    assert gained[0] >= -1e-9 * np.max(np.abs(more))


def test_a_part_of_the_samples_counts_a_part_of_the_prior():
    rng = np.random.default_rng(3)
    information, prior = _matrix(rng), _prior(_matrix(rng), samples=5000.0)
    whole = prior.information(information, 5000)
    np.testing.assert_allclose(prior.information(information / 50, 100) * 50, whole, rtol=1e-9)


def test_scaling_of_the_columns_scales_what_is_found():
    rng = np.random.default_rng(4)
    information, prior = _matrix(rng), _prior(_matrix(rng))
    scale = 10 ** rng.uniform(-2, 2, M)
    found = prior.scaled(scale, scale[CHANGED]).information(
        information * np.multiply.outer(scale, scale), 1
    )
    expected = prior.information(information, 1)
    outer = np.multiply.outer(scale[CHANGED], scale[CHANGED])
    np.testing.assert_allclose(found / outer, expected, rtol=1e-9, atol=1e-9)


def _slopes(prior, information, change, criterion, level):
    """Value, slope and curvature of a criterion along a change of F, as a solver adds them up."""
    cost = prior.cost(information, 1, criterion, level)
    moved = cost.basis.T @ change @ cost.basis
    own = np.diag(moved)
    diagonal, mixing = cost.curvature()
    return cost.value, own @ cost.slope, own @ diagonal @ own + np.sum(mixing * moved**2)


@pytest.mark.parametrize("key", ["d", "a", "e", "condition"])
def test_derivatives_of_the_criteria(key):
    rng = np.random.default_rng(5)
    criterion, prior = criteria()[key], _prior(_matrix(rng))
    information = _matrix(rng)
    root = np.linalg.cholesky(information)
    relative = rng.normal(size=(M, M))
    change = root @ (relative + relative.T) @ root.T
    for level in criterion.levels:

        def value(step, level=level):
            judged = prior.information(information + step * change, 1)
            return criterion.cost(np.log(np.linalg.eigvalsh(judged)), level)[0]

        at, slope, curvature = _slopes(prior, information, change, criterion, level)
        assert at == pytest.approx(value(0.0), rel=1e-10)
        h = 1e-4
        assert slope == pytest.approx((value(h) - value(-h)) / (2 * h), rel=1e-5)
        assert curvature >= 0
        if key == "d":  # convex in F: nothing of its curvature is cut
            second = (value(h) - 2 * value(0.0) + value(-h)) / h**2
            assert curvature == pytest.approx(second, rel=1e-4)


def test_gain_is_that_of_the_joint_estimate():
    rng = np.random.default_rng(6)
    information, covariance = _matrix(rng), _matrix(rng)
    chosen = np.eye(M)[:, CHANGED]
    told = rng.normal(size=M)
    solved = np.linalg.solve(
        _joint(information, covariance), np.concatenate([chosen.T @ told, told])
    )
    found = _prior(covariance).gain(information, 1) @ told
    np.testing.assert_allclose(found, solved[:3], rtol=1e-7)


def test_what_tolerances_have_moved_is_kept_by_their_name():
    one = {"name": "delay", "tolerance": 0.5, "value": 0.0, "std": 0.5}
    response = np.arange(M, dtype=float)[:, None]
    prior = _prior(np.eye(M), deviations=[one], response=response.tolist())
    np.testing.assert_allclose(prior.moved["delay", 0.5], 0.5 * response[:, 0])


@pytest.mark.parametrize("estimated", [True, False])
def test_tolerances_of_a_change_are_those_of_the_joint_problem(estimated):
    """One cause moved the earlier estimate and moves this one; another is new, a third is past."""
    rng = np.random.default_rng(9)
    causes = np.array([[0.5, 0.0, 0.0], [0.0, 2.0, 0.0]])
    before = rng.normal(size=(M, 3)) * [1, 0, 1]
    moved = {("delay", 0.5): before[:, 0], ("clock", 1.0): before[:, 2]}
    prior = dataclasses.replace(_prior(_matrix(rng)), moved=moved)
    keys = [("delay", 0.5), ("gravity", 2.0)]
    found = prior.with_effects(causes[:, :2], keys, estimated=estimated)
    information = _matrix(rng, M + 2)
    own = np.concatenate([np.eye(M)[:, CHANGED], prior.nuisance], axis=1)
    own = np.pad(own, ((0, 2), (0, 0)))
    effects = np.concatenate([-before, causes])
    known = np.diag([0.0] * 3 + [1.0] * (own.shape[1] - 3))
    if estimated:
        own = np.concatenate([own, effects], axis=1)
        known = np.diag([*np.diag(known), *np.ones(3)])
    covariance = np.linalg.inv(own.T @ information @ own + known)
    if not estimated:
        bias = covariance @ own.T @ information @ effects
        covariance = covariance + bias @ bias.T
    expected = np.linalg.inv(covariance[:3, :3])
    judged = found.information(information, 1)
    np.testing.assert_allclose(judged, expected, rtol=1e-6, atol=1e-7 * np.max(expected))


@given(st.integers(0, 10_000))
def test_information_of_an_earlier_estimate(seed):
    """That of parameters and deviations from the covariances of their errors, priors at one."""
    rng = np.random.default_rng(seed)
    names = tuple("abcdefg")
    tolerances = np.array([0.1, 3.0])
    units = np.append(np.ones(M), tolerances)
    alone = _matrix(rng)
    known = Identification(
        run="first",
        estimator="gm",
        verdict="accepted",
        parameters=names,
        covariance_random=np.linalg.inv(alone).tolist(),
        covariance_systematic=np.zeros((M, M)).tolist(),
    )
    np.testing.assert_allclose(earlier_information(known, names, ()), alone, rtol=1e-7)
    rows = rng.normal(size=(40, M + 2)) / units
    information = rows.T @ rows
    prior = np.diag(np.append(np.zeros(M), tolerances**-2))
    total = np.linalg.inv(information + prior)
    response = -total[:M, M:] / tolerances**2
    systematic = (response * tolerances**2) @ response.T
    deviations = [
        {"name": name, "tolerance": tolerance, "value": 0.0, "std": tolerance}
        for name, tolerance in zip("xy", tolerances, strict=True)
    ]
    joint = known.model_copy(
        update={
            "covariance_random": tuple(map(tuple, total[:M, :M] - systematic)),
            "deviations": tuple(IdentifiedDeviation(**one) for one in deviations),
            "response": tuple(map(tuple, response)),
            "covariance_deviations": tuple(map(tuple, total[:, M:])),
        }
    )
    found = earlier_information(joint, names[1:], ("y", "x"))
    at = [*range(1, M), M + 1, M]
    scale = np.sqrt(np.diag(information))[at]
    expected = information[np.ix_(at, at)] / np.multiply.outer(scale, scale)
    np.testing.assert_allclose(found / np.multiply.outer(scale, scale), expected, atol=1e-6)
