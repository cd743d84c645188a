import pickle

import numpy as np
import pytest
import scipy.linalg as sla

from expdesign.information.criteria import criteria
from expdesign.information.fisher import (
    EXCITABLE,
    ScaledInformation,
    SingularInformationError,
    information_matrix,
    log_det,
    parameter_covariance,
    whitening,
)
from expdesign.recheck.evaluator import Evaluator
from expdesign.robot import load_robot
from expdesign.trajectory import FourierTrajectory

NAMES = tuple("abcdefgh")


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def covariance(rng):
    factor = rng.normal(size=(6, 6))
    return factor @ factor.T + np.diag(rng.uniform(0.1, 10, 6))


@pytest.fixture
def regressors(rng):
    return rng.normal(size=(20, 6, 8))


@pytest.fixture(scope="module")
def palida():
    return load_robot("palida")


@pytest.fixture(scope="module")
def motion(palida):
    """A motion that excites everything."""
    rng = np.random.default_rng(5)
    reach = np.array([0.08, 0.08, 0.06, 0.15, 0.15, 0.5])[:, None]
    return FourierTrajectory.from_displacements(
        2.5, palida.home, *(reach * rng.normal(size=(2, 6, 5)) / 2)
    )


def _judge(robot, criterion="d", scaling=None, names=None):
    m = len(robot.parameter_names)
    return Evaluator(
        robot,
        robot.description.noise.force_covariance,
        criteria()[criterion],
        np.ones(m) if scaling is None else scaling,
        names or robot.parameter_names,
    )


# --- F --------------------------------------------------------------------------------------------


def _by_loops(regressors, covariance):
    """F = Σ_t Aᵀ Σ⁻¹ A, entry by entry."""
    inverse = np.linalg.inv(covariance)
    count, actuators, m = regressors.shape
    F = np.zeros((m, m))
    for t in range(count):
        for i in range(actuators):
            for j in range(actuators):
                F += inverse[i, j] * np.multiply.outer(regressors[t, i], regressors[t, j])
    return F


def test_information_is_the_sum_over_samples_and_actuators(regressors, covariance):
    F = information_matrix(regressors, covariance)
    np.testing.assert_allclose(F, _by_loops(regressors, covariance), rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(F, F.T)


def test_information_of_palida(palida, motion):
    samples = motion.sample(motion.period * np.arange(50) / 50)
    A = np.array(
        [
            palida.regressor(*row)
            for row in zip(samples.pose, samples.rate, samples.acceleration, strict=True)
        ]
    )
    expected = _by_loops(A, palida.description.noise.force_covariance)
    F = _judge(palida).information(motion, 50)
    size = np.sqrt(np.multiply.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(F / size, expected / size, rtol=0, atol=1e-12)


def test_the_full_covariance_counts(regressors, covariance):
    F = information_matrix(regressors, covariance)
    diagonal = information_matrix(regressors, np.diag(np.diag(covariance)))
    assert np.max(np.abs(F - diagonal)) > 0.1 * np.max(np.abs(F))


def test_whitening(covariance):
    factor = whitening(covariance)
    np.testing.assert_allclose(factor @ covariance @ factor.T, np.eye(6), atol=1e-12)
    np.testing.assert_array_equal(factor, np.tril(factor))


def test_information_adds_up(regressors, covariance):
    parts = [information_matrix(part, covariance) for part in (regressors[:7], regressors[7:])]
    np.testing.assert_allclose(
        sum(parts), information_matrix(regressors, covariance), rtol=1e-12, atol=1e-12
    )


def test_more_noise_is_less_information(regressors, covariance):
    F = information_matrix(regressors, covariance)
    np.testing.assert_allclose(information_matrix(regressors, 4 * covariance), F / 4, rtol=1e-12)


# --- log det --------------------------------------------------------------------------------------


def test_log_det_against_slogdet(regressors, covariance):
    F = information_matrix(regressors, covariance)
    sign, expected = np.linalg.slogdet(F)
    assert sign == 1
    assert log_det(F, NAMES) == pytest.approx(expected, rel=1e-12)


def test_log_det_of_badly_scaled_parameters(regressors, covariance):
    scale = 10.0 ** np.array([-9, 7, 0, -4, 3, -7, 8, 1])
    F = information_matrix(regressors, covariance)
    scaled = information_matrix(regressors * scale, covariance)
    expected = log_det(F, NAMES) + 2 * np.sum(np.log(scale))
    assert log_det(scaled, NAMES) == pytest.approx(expected, abs=1e-10)


def test_log_det_of_palida_against_a_qr_factorisation(palida, motion):
    samples = motion.sample(motion.sample_times(200))
    A = palida.regressor(samples.pose, samples.rate, samples.acceleration)
    factor = np.linalg.cholesky(palida.description.noise.force_covariance)
    stacked = np.linalg.solve(factor, A).reshape(-1, 24)
    expected = 2 * np.sum(np.log(np.abs(np.diag(sla.qr(stacked, mode="r")[0]))))
    evaluator = _judge(palida)
    assert evaluator.log_det(evaluator.information(motion, 200)) == pytest.approx(
        expected, abs=1e-8
    )


def test_a_rescaling_of_the_parameters_shifts_log_det_by_a_constant(palida, motion):
    evaluator = _judge(palida)
    scale = np.abs(palida.parameters)
    constant = 2 * np.sum(np.log(scale))
    for trajectory in (motion, motion.shifted(0.21)):
        F = evaluator.information(trajectory, 60)
        rescaled = F * np.multiply.outer(scale, scale)
        names = palida.parameter_names
        assert log_det(rescaled, names) - log_det(F, names) == pytest.approx(constant, abs=1e-9)


def test_scaling_moves_a_and_e_and_condition_but_not_d(palida, motion):
    nominal = np.abs(palida.parameters)
    for key in ("d", "a", "e", "condition"):
        si = _judge(palida, key)
        scaled = _judge(palida, key, nominal)
        F = si.information(motion, 60)
        assert (si.value(F) == scaled.value(F)) is (key == "d")


@pytest.mark.parametrize("criterion", ["d", "a", "e", "condition"])
@pytest.mark.parametrize("samples", [1, 7, 33])
def test_a_shift_by_whole_samples_changes_nothing(criterion, samples, palida, motion):
    evaluator = _judge(palida, criterion, np.abs(palida.parameters))
    shifted = motion.shifted(motion.sample_times(60)[samples])
    F, again = evaluator.information(motion, 60), evaluator.information(shifted, 60)
    size = np.sqrt(np.multiply.outer(np.diag(F), np.diag(F)))
    np.testing.assert_allclose(again / size, F / size, rtol=0, atol=1e-11)
    assert evaluator.value(again) == pytest.approx(evaluator.value(F), rel=1e-7)
    assert evaluator.merit(shifted, 60) == pytest.approx(evaluator.merit(motion, 60), rel=1e-7)


def test_a_period_twice_is_twice_the_information(palida, motion):
    evaluator = _judge(palida)
    twice = FourierTrajectory.from_displacements(
        motion.omega / 2,
        motion.lambda0,
        np.kron(motion.sine, [0, 1]),
        np.kron(motion.cosine, [0, 1]),
    )
    F, again = evaluator.information(motion, 40), evaluator.information(twice, 80)
    size = np.sqrt(np.multiply.outer(np.diag(F), np.diag(F)))
    np.testing.assert_allclose(again / size, 2 * F / size, rtol=0, atol=1e-11)


# --- what it predicts -----------------------------------------------------------------------------


def test_covariance_is_the_inverse(regressors, covariance):
    F = information_matrix(regressors, covariance)
    np.testing.assert_allclose(parameter_covariance(F, NAMES) @ F, np.eye(8), atol=1e-11)


def test_covariance_of_badly_scaled_parameters(regressors, covariance):
    scale = 10.0 ** np.array([-9, 7, 0, -4, 3, -7, 8, 1])
    C = parameter_covariance(information_matrix(regressors, covariance), NAMES)
    scaled = parameter_covariance(information_matrix(regressors * scale, covariance), NAMES)
    np.testing.assert_allclose(scaled * np.multiply.outer(scale, scale), C, rtol=1e-9)


def test_covariance_is_the_scatter_of_the_gauss_markov_estimates(regressors, covariance, rng):
    F = information_matrix(regressors, covariance)
    C = parameter_covariance(F, NAMES)
    noise = rng.multivariate_normal(np.zeros(6), covariance, size=(4000, 20))
    inverse = np.linalg.inv(covariance)
    right = np.einsum("tim,ij,rtj->rm", regressors, inverse, noise, optimize=True)
    estimates = np.linalg.solve(F, right.T).T
    # The spread of a standard deviation from 4000 draws is 1.1 %.
    np.testing.assert_allclose(estimates.std(axis=0), np.sqrt(np.diag(C)), rtol=0.05)


# --- what is not excited --------------------------------------------------------------------------


def test_unit_diagonal(regressors, covariance):
    F = information_matrix(regressors, covariance)
    scaled = ScaledInformation.of(F)
    np.testing.assert_allclose(np.diag(scaled.matrix), 1)
    D = np.diag(scaled.scales)
    np.testing.assert_allclose(D @ scaled.matrix @ D, F, rtol=1e-12)
    assert not scaled.is_singular()
    assert scaled.weak_directions(NAMES) == ()
    np.testing.assert_allclose(
        scaled.eigenvalues(), np.sort(np.linalg.eigvalsh(scaled.matrix)), rtol=1e-12
    )


def _unexcited(F, names=NAMES):
    names_by_function = []
    for function in (log_det, parameter_covariance):
        with pytest.raises(SingularInformationError) as caught:
            function(F, names)
        names_by_function.append(caught.value.unexcited)
        for name in caught.value.unexcited:
            assert name in str(caught.value)
    assert names_by_function[0] == names_by_function[1]
    return names_by_function[0]


def test_a_column_of_zeros_is_named(regressors, covariance):
    regressors[:, :, [2, 5]] = 0
    assert _unexcited(information_matrix(regressors, covariance)) == ("c", "f")


def test_one_of_two_equal_columns_is_named(regressors, covariance):
    regressors[:, :, 6] = 3e4 * regressors[:, :, 1]
    (name,) = _unexcited(information_matrix(regressors, covariance))
    assert name in ("b", "g")


def test_what_it_cannot_be_told_from_is_named_too(regressors, covariance):
    regressors[:, :, 6] = 3e4 * regressors[:, :, 1]
    regressors[:, :, 2] = 0
    F = information_matrix(regressors, covariance)
    nothing, pair = ScaledInformation.of(F).weak_directions(NAMES)
    if pair.name == "c":
        nothing, pair = pair, nothing
    assert (nothing.name, nothing.others, str(nothing)) == ("c", (), "c")
    assert {pair.name, *pair.others} == {"b", "g"}
    assert str(pair) == f"{pair.name} (confounded with {pair.others[0]})"
    with pytest.raises(SingularInformationError, match="confounded with") as caught:
        log_det(F, NAMES)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.directions, str(again)) == (caught.value.directions, str(caught.value))


def test_only_those_that_take_part_are_named(regressors, covariance):
    # a = d + e with a hundredth of f: f's share of the direction is far below a tenth.
    regressors[:, :, 0] = regressors[:, :, [3, 4]].sum(axis=2) + 0.01 * regressors[:, :, 5]
    (direction,) = ScaledInformation.of(information_matrix(regressors, covariance)).weak_directions(
        NAMES
    )
    assert {direction.name, *direction.others} == {"a", "d", "e"}
    assert " and " in str(direction)


def test_one_of_a_dependent_set_is_named(regressors, covariance):
    regressors[:, :, 0] = regressors[:, :, 3] - 2 * regressors[:, :, 4]
    (name,) = _unexcited(information_matrix(regressors, covariance))
    assert name in ("a", "d", "e")


def test_fewer_measurements_than_parameters(covariance, rng):
    regressors = rng.normal(size=(1, 6, 8))
    assert len(_unexcited(information_matrix(regressors, covariance))) == 2


def test_nothing_is_excited():
    assert _unexcited(np.zeros((8, 8))) == NAMES


def test_what_is_not_named_is_regular(regressors, covariance):
    regressors[:, :, 6] = regressors[:, :, 1]
    regressors[:, :, 2] = 0
    regressors[:, :, 0] = regressors[:, :, 3] + regressors[:, :, 7]
    named = _unexcited(information_matrix(regressors, covariance))
    assert len(named) == 3
    kept = [k for k, name in enumerate(NAMES) if name not in named]
    F = information_matrix(regressors[:, :, kept], covariance)
    assert np.isfinite(log_det(F, tuple(NAMES[k] for k in kept)))


def test_nearly_equal_columns_on_both_sides_of_the_threshold(rng):
    # Two unit columns at the angle ε have the eigenvalues 1 ± cos ε: ratio ε²/4.
    for epsilon, singular in ((1e-5, False), (1e-7, True)):
        F = np.array([[1, np.cos(epsilon)], [np.cos(epsilon), 1]])
        assert (epsilon**2 / 4 < EXCITABLE) is singular
        assert ScaledInformation.of(F).is_singular() is singular


def test_palida_at_rest(palida):
    still = FourierTrajectory(1.0, palida.home, np.zeros((6, 1)), np.zeros((6, 1)))
    evaluator = _judge(palida)
    F = evaluator.information(still, 10)
    named = _unexcited(F, palida.parameter_names)
    # Gravity loads all struts alike at home: p4, p5 and p10 share one column, the rest are zero.
    assert len(named) == 23
    (kept,) = set(palida.parameter_names) - set(named)
    assert kept in ("p4", "p5", "p10")
    for call in (evaluator.log_det, evaluator.value):
        with pytest.raises(SingularInformationError):
            call(F)
    assert evaluator.merit(still, 10) == -np.inf


def test_palida_moved_in_a_line(palida):
    # Up and down without turning: no moment of inertia of the platform is excited.
    mu = np.zeros((6, 2))
    mu[2] = 0.2
    line = FourierTrajectory(2.0, palida.home, mu, np.zeros((6, 2)))
    named = _unexcited(_judge(palida).information(line, 40), palida.parameter_names)
    assert {"p6", "p7", "p8"} <= set(named)
    assert not {f"r{j}" for j in range(1, 7)} & set(named)


def test_merit_of_a_restricted_set(palida):
    mu = np.zeros((6, 2))
    mu[2] = 0.2
    line = FourierTrajectory(2.0, palida.home, mu, np.zeros((6, 2)))
    names = ("p10", "r1", "v3")
    evaluator = _judge(palida, names=names)
    F = evaluator.information(line, 40)
    assert F.shape == (3, 3)
    full = _judge(palida).information(line, 40)
    columns = [palida.parameter_names.index(name) for name in names]
    np.testing.assert_allclose(F, full[np.ix_(columns, columns)], rtol=1e-10, atol=1e-12)
    assert np.isfinite(evaluator.merit(line, 40))
