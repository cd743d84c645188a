"""What the optimiser is given, against finite differences and plain formulas."""

import dataclasses

import numpy as np
import pytest

from constraints import Limit, limit_definitions
from expdesign.configuration import load_run
from expdesign.configuration.limits import row_labels
from expdesign.configuration.robot import load_robot_description
from expdesign.experiment.setup import plan_search
from expdesign.information.criteria import criteria
from expdesign.information.fisher import PeriodicNoise, information_matrix
from expdesign.information.marginal import Marginal
from expdesign.noise import Autoregressive, Hum, NoiseSpectrum
from expdesign.problem.design_problem import build_problem
from expdesign.problem.program import LinearRows, RowIndex, smoothing_gap
from expdesign.problem.variables import DesignVariables
from expdesign.recheck.evaluator import Evaluator
from expdesign.robot import load_robot, robot_from
from expdesign.solver.interior_point import solve_by_interior_point
from expdesign.trajectory import FourierTrajectory, PhaseBasis

HARMONICS, SAMPLES = 2, 24
WIDTH = 0.3


def _problem(robot, criterion="d", names=None, scaling=None, harmonics=HARMONICS):
    return build_problem(
        robot,
        harmonics=harmonics,
        frequency=(0.1, 0.6),
        samples=SAMPLES,
        covariance=robot.description.noise.force_covariance,
        criterion=criteria()[criterion],
        scaling=np.abs(robot.parameters) if scaling is None else scaling,
        names=names or robot.parameter_names,
    )


@pytest.fixture(scope="module")
def palida():
    return load_robot("palida")


def _in_order(limits):
    return {key: limits[key] for key in limit_definitions() if key in limits}


@pytest.fixture(scope="module")
def everything(palida):
    """PaLiDA with all the limits that exist."""
    description = palida.description
    bounds = {
        "attitude": (np.full(1, -1.2), np.full(1, 1.3)),
        "platform_joint_angle": (np.full(6, -np.inf), np.full(6, 0.6)),
        "rotation": (np.array([-0.5, -0.4, -np.inf]), np.array([0.5, np.inf, np.inf])),
    }
    more = {
        key: Limit(definition, *bounds[key], row_labels(definition), "test")
        for key, definition in limit_definitions().items()
        if key in bounds
    }
    # The axes are not the default ones, so that no angle is zero at home.
    axes = np.add(description.platform_joint_axes, [0.1, -0.2, 0.05])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return robot_from(
        dataclasses.replace(
            description, limits=_in_order({**description.limits, **more}), platform_joint_axes=axes
        )
    )


@pytest.fixture(scope="module")
def problem(everything):
    return _problem(everything)


def _variant(problem, criterion="d", names=None, scaling=None):
    """The same problem judged otherwise; nothing is compiled again."""
    names = names or problem.robot.parameter_names
    scaling = np.abs(problem.robot.parameters) if scaling is None else scaling
    columns = np.array([problem.robot.parameter_names.index(name) for name in names])
    cost = dataclasses.replace(
        problem.cost,
        criterion=criteria()[criterion],
        columns=columns,
        scaling=scaling[columns],
    )
    return dataclasses.replace(problem, cost=cost, names=names)


@pytest.fixture(scope="module")
def points(problem):
    rng = np.random.default_rng(3)
    points = 0.3 * rng.normal(size=(3, problem.variables.size))
    points[:, -1] = [1.0, 0.8, 0.9]
    return points


def _central(function, x, h=1e-6):
    """Derivative of a function (…) to x (z,) by differences of fourth order: (…, z)."""
    columns = []
    for k in range(x.size):
        step = h * np.eye(x.size)[k]
        m2, m1, p1, p2 = (np.asarray(function(x + c * step)) for c in (-2, -1, 1, 2))
        columns.append((m2 - 8 * m1 + 8 * p1 - p2) / (12 * h))
    return np.stack(columns, axis=-1)


def _assert_close(found, expected, tolerance, floor=0.0):
    """Judge entries relative to the largest of their row, but at least to `floor`."""
    size = np.maximum(np.max(np.abs(expected), axis=-1, keepdims=True), floor)
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=tolerance)


# --- the variables --------------------------------------------------------------------------------


@pytest.fixture
def variables(palida):
    return DesignVariables(
        3, np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), palida.home, (0.6, 3.8), 3.8
    )


def test_number_of_variables(variables):
    assert variables.size == 12 * 3 + 7
    assert variables.per_coordinate == 7


def test_pack_and_unpack(variables):
    rng = np.random.default_rng(0)
    trajectory = FourierTrajectory(1.9, *(rng.normal(size=s) for s in (6, (6, 3), (6, 3))))
    packed = variables.pack(trajectory)
    assert packed.shape == (variables.size,)
    again = variables.trajectory(packed)
    np.testing.assert_allclose(again.vector(), trajectory.vector(), rtol=1e-13)
    values = rng.normal(size=variables.size)
    values[-1] = 0.4
    np.testing.assert_allclose(variables.pack(variables.trajectory(values)), values, rtol=1e-12)


def test_home_is_zero(variables, palida):
    still = FourierTrajectory(3.8, palida.home, np.zeros((6, 3)), np.zeros((6, 3)))
    np.testing.assert_array_equal(variables.pack(still), [*np.zeros(42), 1])


def test_bounds_are_those_of_the_frequency(variables):
    lower, upper = variables.bounds()
    assert np.all(np.isinf(lower[:-1]))
    assert np.all(np.isinf(upper[:-1]))
    assert lower[-1] * 3.8 == pytest.approx(0.6)
    assert upper[-1] == 1


def test_states_are_the_samples_of_the_trajectory(variables):
    rng = np.random.default_rng(1)
    values = np.append(rng.normal(size=42), 0.7)
    trajectory = variables.trajectory(values)
    times = trajectory.sample_times(11)
    samples = trajectory.sample(times)
    states = variables.states(values, PhaseBasis.at(trajectory.omega * times, 3))
    expected = np.concatenate([samples.pose, samples.rate, samples.acceleration], axis=1)
    np.testing.assert_allclose(states, expected, rtol=1e-12, atol=1e-12)


def all_rows(path, slopes):
    """Every quantity at every point is a row, with a scale of one."""
    points, quantities, _ = slopes.shape
    rows = RowIndex.of(np.ones((points, quantities), dtype=bool), np.ones(quantities))
    return LinearRows(np.zeros(points * quantities), path, slopes, rows)


def test_sensitivities_of_the_states(variables):
    rng = np.random.default_rng(2)
    values = np.append(rng.normal(size=42), 0.7)
    basis = PhaseBasis.at(np.linspace(0, 6, 5), 3)
    slope = variables.slope(values, basis)
    slopes = all_rows(slope, np.tile(np.eye(18), (5, 1, 1))).jacobian().reshape(5, 18, 43)
    expected = _central(lambda x: variables.states(x, basis), values, h=1e-3)
    np.testing.assert_allclose(slopes, expected, rtol=1e-9, atol=1e-9)
    step = np.random.default_rng(2).normal(size=43)
    np.testing.assert_allclose(slope.state_change(step), expected @ step, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("rows", [1, 4, 37])
def test_both_ways_to_carry_sensitivities_agree(rows, variables):
    rng = np.random.default_rng(3)
    values = np.append(rng.normal(size=42), 0.7)
    basis = PhaseBasis.at(rng.uniform(0, 6, 9), 3)
    sensitivities = rng.normal(size=(9, rows, 18))
    slope = variables.slope(values, basis)
    one_by_one = all_rows(slope, sensitivities).jacobian().reshape(9, rows, -1)
    summed = slope.transposed_products(sensitivities.transpose(0, 2, 1)).T
    np.testing.assert_allclose(summed, one_by_one.sum(axis=0), rtol=1e-11, atol=1e-11)


# --- the objective --------------------------------------------------------------------------------


def test_information_is_that_of_the_model(everything, problem, points):
    """For a tiny width, per sample and in the scaling, it is the unsmoothed F."""
    evaluator = Evaluator(
        everything,
        everything.description.noise.force_covariance,
        problem.criterion,
        np.abs(everything.parameters),
        everything.parameter_names,
    )
    scale = np.abs(everything.parameters)
    F = evaluator.information(problem.variables.trajectory(points[0]), SAMPLES)
    expected = F * np.multiply.outer(scale, scale) / SAMPLES
    found = problem.cost.information(points[0], 1e-9)
    size = np.sqrt(np.multiply.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-12)


@pytest.mark.parametrize("criterion", ["d", "a", "e", "condition"])
def test_gradient_of_the_cost(criterion, problem, points):
    problem = _variant(problem, criterion)
    for level in problem.criterion.levels:
        for x in points[:1] if level else points[:2]:
            value, gradient, _ = problem.cost.derivatives(x, WIDTH, level)
            assert value == pytest.approx(problem.cost.value(x, WIDTH, level), rel=1e-7)
            expected = _central(lambda y, p=problem, k=level: p.cost.value(y, WIDTH, k), x, h=2e-4)
            _assert_close(gradient, expected, 1e-6)


def test_gradient_with_sharp_friction(problem, points):
    _, gradient, _ = problem.cost.derivatives(points[0], 0.02, 0.0)
    expected = _central(lambda y: problem.cost.value(y, 0.02, 0.0), points[0], h=1e-5)
    _assert_close(gradient, expected, 1e-6)


@pytest.fixture(scope="module")
def coloured(problem, everything):
    """The same problem under noise with memory, and a hum near a multiple of the frequency."""
    covariance = everything.description.noise.force_covariance
    parts = (
        Autoregressive.with_covariance(np.full((6, 1), 0.95), covariance),
        Hum.of(np.array([2.8]), np.full((1, 6), 10.0)),
    )
    memory = PeriodicNoise(NoiseSpectrum(parts), 100.0, 3.0)
    return dataclasses.replace(problem, cost=dataclasses.replace(problem.cost, memory=memory))


@pytest.mark.parametrize("criterion", ["d", "condition"])
def test_gradient_under_coloured_noise(criterion, coloured, points):
    problem = _variant(coloured, criterion)
    level = problem.criterion.levels[0]
    for x in points[:2]:
        value, gradient, hessian = problem.cost.derivatives(x, WIDTH, level)
        assert value == pytest.approx(problem.cost.value(x, WIDTH, level), rel=1e-7)
        expected = _central(lambda y: problem.cost.value(y, WIDTH, level), x, h=1e-4)
        _assert_close(gradient, expected, 1e-6)
        again, alone = problem.cost.gradient(x, WIDTH, level)
        assert again == pytest.approx(value, rel=1e-12)
        _assert_close(alone, gradient, 1e-9)
        size = np.max(np.abs(hessian))
        assert np.min(np.linalg.eigvalsh(hessian)) >= -1e-10 * size
    # The spectrum's own share of the derivative to the frequency is seen.
    fixed = dataclasses.replace(problem.cost, memory=None)
    assert abs(fixed.gradient(x, WIDTH, level)[1][-1] - gradient[-1]) > 1e-3


def test_information_under_coloured_noise_is_the_evaluators(coloured, everything, points):
    names = everything.parameter_names
    evaluator = Evaluator(
        everything,
        everything.description.noise.force_covariance,
        coloured.criterion,
        np.ones(24),
        names,
        coloured.cost.memory,
    )
    cost = coloured.cost.value(points[0], 1e-9, 0.0)
    F = evaluator.information(coloured.variables.trajectory(points[0]), SAMPLES)
    assert coloured.cost.criterion_value(cost) == pytest.approx(evaluator.log_det(F), abs=1e-6)


def test_gradient_for_some_of_the_parameters(palida, points):
    names = ("p10", "p3", "v2", "r_beta")
    problem = _problem(palida, names=names, scaling=np.ones(24))
    assert problem.names == names
    _, gradient, hessian = problem.cost.derivatives(points[1], WIDTH, 0.0)
    expected = _central(lambda y: problem.cost.value(y, WIDTH, 0.0), points[1], h=1e-4)
    _assert_close(gradient, expected, 1e-6)
    assert hessian.shape == (31, 31)


@pytest.fixture(scope="module")
def after_a_change(palida):
    """A problem that judges what five parameters have changed by, the rest known so far."""
    names = ("p6", "p7", "p8", "p9", "p10")
    rng = np.random.default_rng(8)
    # As much as the experiment's samples tell, with correlations.
    spread = 0.05 * np.abs(palida.parameters)[:, None] * rng.normal(size=(24, 40)) / np.sqrt(40)
    places = np.array([palida.parameter_names.index(name) for name in names])
    prior = Marginal(np.eye(24)[:, places], spread, np.ones(40), 500.0)
    scaling = np.abs(palida.parameters)
    every = np.arange(24)
    problem = _problem(palida, names=names).with_marginal(prior, scaling, scaling[places], every)
    return problem, prior, names


@pytest.mark.parametrize("criterion", ["d", "a"])
def test_gradient_for_a_change_with_a_prior(criterion, after_a_change, points):
    problem = after_a_change[0].with_criterion(criteria()[criterion])
    level = problem.criterion.levels[0]
    for x in points[:2]:
        value, gradient, hessian = problem.cost.derivatives(x, WIDTH, level)
        assert value == pytest.approx(problem.cost.value(x, WIDTH, level), rel=1e-9)
        expected = _central(lambda y: problem.cost.value(y, WIDTH, level), x, h=1e-4)
        _assert_close(gradient, expected, 1e-6)
        again, alone = problem.cost.gradient(x, WIDTH, level)
        assert again == pytest.approx(value, rel=1e-12)
        _assert_close(alone, gradient, 1e-9)
        assert np.min(np.linalg.eigvalsh(hessian)) >= -1e-10 * np.max(np.abs(hessian))


def test_hessian_for_a_change_is_gauss_newton(after_a_change, points):
    """The second derivative of −log det S / k for dF linear in x, by the joint problem.

    log det S = log det J − log det (F + P⁻¹), J with the columns that have changed twice.
    """
    problem, prior, names = after_a_change
    x, scale = points[0], problem.cost.scaling
    _, _, hessian = problem.cost.derivatives(x, WIDTH, 0.0)
    factor = prior.nuisance / scale[:, None] * np.sqrt(prior.samples)
    known = np.linalg.inv(factor @ factor.T)
    twice = np.concatenate([prior.interest, np.eye(24)], axis=1)
    joint = twice.T @ problem.cost.information(x, WIDTH) @ twice
    joint[len(names) :, len(names) :] += known
    changes = twice.T @ _changes(problem, x) @ twice

    def curvature(matrix, slopes):
        steps = np.linalg.solve(matrix, slopes)
        return np.einsum("iab,jba->ij", steps, steps)

    others = slice(len(names), None)
    expected = curvature(joint, changes) - curvature(
        joint[others, others], changes[:, others, others]
    )
    expected /= len(names)
    size = np.sqrt(np.multiply.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(hessian / size, expected / size, rtol=0, atol=1e-5)


def test_readable_cost_of_a_change_is_the_evaluators(palida, after_a_change, points):
    """The evaluator comes from the unsmoothed model and F in SI, the cost from scaled columns."""
    problem, prior, names = after_a_change
    covariance = palida.description.noise.force_covariance
    evaluator = Evaluator(palida, covariance, problem.criterion, np.ones(24), names, marginal=prior)
    cost = problem.cost.value(points[0], 1e-9, 0.0)
    found = evaluator.information(problem.variables.trajectory(points[0]), SAMPLES)
    assert found.shape == (5, 5)
    assert problem.cost.criterion_value(cost) == pytest.approx(evaluator.value(found), abs=1e-6)


@pytest.fixture(
    scope="module",
    params=[("d", "auto"), ("a", "budget")],
    ids="-".join,
)
def with_tolerances(request):
    """A problem with deviations as nuisances, estimated or only budgeted, and its evaluator."""
    criterion, systematic = request.param
    run = load_run(
        {
            "name": "total",
            "robot": "palida",
            "tolerances": {
                "force_constant": {"common": "0.5 %", "each": "0.5 %"},
                "gravity": "0.1 deg",
                "delay": "0.2 ms",
                "clock": "20 ppm",
            },
            "trajectory": {"harmonics": HARMONICS, "samples": SAMPLES},
            "design": {"criterion": criterion, "scaling": "nominal"},
            "estimate": {"systematic": systematic},
        }
    )
    return plan_search(run)


def test_derivatives_with_tolerances(with_tolerances, points):
    problem = with_tolerances.problem
    level, x = problem.criterion.levels[0], points[1]
    value, gradient = problem.cost.gradient(x, WIDTH, level)
    assert value == pytest.approx(problem.cost.value(x, WIDTH, level), rel=1e-7)
    expected = _central(lambda y: problem.cost.value(y, WIDTH, level), x, h=1e-4)
    _assert_close(gradient, expected, 1e-6)
    _, again, hessian = problem.cost.derivatives(x, WIDTH, level)
    _assert_close(again, gradient, 1e-5)
    assert np.min(np.linalg.eigvalsh(hessian)) >= -1e-9 * np.max(np.abs(hessian))


def test_cost_with_tolerances_is_the_evaluators(with_tolerances, points):
    """The evaluator takes Z from the motion as a whole, the cost from the state."""
    problem, evaluator = with_tolerances.problem, with_tolerances.evaluator
    cost = problem.cost.value(points[0], 1e-9, problem.criterion.levels[0])
    found = evaluator.information(problem.variables.trajectory(points[0]), SAMPLES)
    expected = evaluator.value(found)
    assert problem.cost.criterion_value(cost) == pytest.approx(expected, rel=1e-6)


def _changes(problem, x):
    """dF/dx, (z, k, k), by differences."""
    return np.moveaxis(_central(lambda y: problem.cost.information(y, WIDTH), x, h=1e-4), -1, 0)


def test_hessian_of_d_is_gauss_newton(problem, points):
    """−log det F / m: (1/m) tr F⁻¹ dF_i F⁻¹ dF_j, the second derivative for dF linear in x."""
    for x in points[:2]:
        _, _, hessian = problem.cost.derivatives(x, WIDTH, 0.0)
        F = problem.cost.information(x, WIDTH)
        steps = np.linalg.solve(F, _changes(problem, x))
        expected = np.einsum("iab,jba->ij", steps, steps) / len(F)
        size = np.sqrt(np.multiply.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(hessian / size, expected / size, rtol=0, atol=1e-5)


def test_hessian_of_a_is_gauss_newton(problem, points):
    """Log tr F⁻¹: 2 tr(F⁻¹ dF_i F⁻¹ dF_j F⁻¹)/tr F⁻¹ less the product of the slopes."""
    problem = _variant(problem, "a")
    x = points[0]
    _, gradient, hessian = problem.cost.derivatives(x, WIDTH, 1.0)
    inverse = np.linalg.inv(problem.cost.information(x, WIDTH))
    changes = _changes(problem, x)
    total = np.trace(inverse)
    first = -np.einsum("ab,ibc,ca->i", inverse, changes, inverse) / total
    left = np.einsum("ab,ibc->iac", inverse, changes)
    second = 2 * np.einsum("iab,jbc,ca->ij", left, left, inverse, optimize=True) / total
    expected = (second + second.T) / 2 - np.multiply.outer(first, first)
    _assert_close(gradient, first, 1e-6)
    size = np.sqrt(np.multiply.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(hessian / size, expected / size, rtol=0, atol=1e-5)


@pytest.mark.parametrize("criterion", ["d", "a", "e", "condition"])
def test_hessian_is_symmetric_and_positive_semidefinite(criterion, problem, points):
    problem = _variant(problem, criterion)
    for level in problem.criterion.levels:
        for x in points:
            _, _, hessian = problem.cost.derivatives(x, WIDTH, level)
            size = np.max(np.abs(hessian))
            np.testing.assert_allclose(hessian, hessian.T, rtol=0, atol=1e-10 * size)
            assert np.min(np.linalg.eigvalsh(hessian)) >= -1e-10 * size


def test_a_shift_in_time_by_a_sample_leaves_the_cost(problem, points):
    trajectory = problem.variables.trajectory(points[0])
    shifted = problem.variables.pack(trajectory.shifted(trajectory.sample_times(SAMPLES)[5]))
    for width in (1.0, 0.1):
        here, there = (problem.cost.value(x, width, 0.0) for x in (points[0], shifted))
        assert there == pytest.approx(here, rel=1e-9)


def test_scaling_shifts_the_d_cost_by_a_constant_and_leaves_its_derivatives(problem, points):
    si = _variant(problem, scaling=np.ones(24))
    constant = 2 * np.sum(np.log(np.abs(problem.robot.parameters))) / 24
    for x in points:
        value, gradient, hessian = problem.cost.derivatives(x, WIDTH, 0.0)
        other, slope, curvature = si.cost.derivatives(x, WIDTH, 0.0)
        assert other - value == pytest.approx(constant, rel=1e-6)
        _assert_close(slope, gradient, 1e-6)
        _assert_close(curvature.ravel(), hessian.ravel(), 1e-5)


def test_readable_cost_is_the_log_det(everything, problem, points):
    evaluator = Evaluator(
        everything,
        everything.description.noise.force_covariance,
        problem.criterion,
        np.ones(24),
        everything.parameter_names,
    )
    cost = problem.cost.value(points[0], 1e-9, 0.0)
    F = evaluator.information(problem.variables.trajectory(points[0]), SAMPLES)
    assert problem.cost.criterion_value(cost) == pytest.approx(evaluator.log_det(F), abs=1e-6)


def test_information_by_hand(palida, problem, points):
    """From the robot's own regressor, with the signs of friction replaced by tanh."""
    trajectory = problem.variables.trajectory(points[2])
    samples = trajectory.sample(trajectory.sample_times(SAMPLES))
    states = samples.pose, samples.rate, samples.acceleration
    regressors = palida.regressor(*states).copy()
    motion = palida.strut_motion(*states)
    friction = np.arange(24) >= 10
    regressors[:, :, friction & (np.arange(24) < 18)] = 0
    for j in range(6):
        regressors[:, j, 12 + j] = np.tanh(motion.length_rate[:, j] / WIDTH)
    names = tuple(name for k, name in enumerate(palida.parameter_names) if k not in (10, 11))
    columns = [palida.parameter_names.index(name) for name in names]
    scaled = regressors[:, :, columns] * np.abs(palida.parameters)[columns]
    expected = information_matrix(scaled, palida.description.noise.force_covariance) / SAMPLES
    found = _variant(problem, names=names).cost.information(points[2], WIDTH)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.max(expected))


# --- the limits -----------------------------------------------------------------------------------


def _program(problem, phases, mask, **options):
    return problem.program(phases, mask, width=WIDTH, level=0.0, samples=SAMPLES, **options)


@pytest.fixture(scope="module")
def program(problem):
    phases = np.array([0.2, 1.0, 2.9, 4.4])
    rows = problem.limits.scale.size
    mask = np.ones((4, rows), dtype=bool)
    mask[2, ::3] = False
    mask[3] = False
    return _program(problem, phases, mask), mask[:3]


@pytest.mark.parametrize(("samples", "few"), [(24, 16), (60, 20), (9, 9)])
def test_the_hessian_in_a_program_is_that_of_a_third_of_the_samples(problem, points, samples, few):
    """Gradient and value are those of all of them."""
    phases, width, level = np.array([0.3]), 0.2, 0.5
    mask = np.ones((1, len(problem.limits.keys)), dtype=bool)
    given = problem.program(phases, mask, width=width, level=level, samples=samples)
    value, gradient, hessian = given.cost_derivatives(points[0])
    every = dataclasses.replace(problem.cost, samples=samples)
    all_value, all_gradient = every.gradient(points[0], width, level)
    assert value == all_value
    np.testing.assert_array_equal(gradient, all_gradient)
    third = dataclasses.replace(problem.cost, samples=few)
    np.testing.assert_array_equal(hessian, third.derivatives(points[0], width, level)[2])


def test_jacobian_of_the_limits(program, points):
    program, mask = program
    assert np.count_nonzero(mask) == program.row_lower.size == program.row_upper.size
    for x in points:
        rows = program.linear_rows(x)
        values, jacobian = rows.values, rows.jacobian()
        assert jacobian.shape == (np.count_nonzero(mask), x.size)
        np.testing.assert_allclose(values, program.rows(x), rtol=1e-12, atol=1e-12)
        expected = _central(program.rows, x, h=1e-4)
        # Some rows are constant (a clearance next to the base): differences see their rounding.
        floor = 1e-4 * np.maximum(np.abs(values), 1)[:, None]
        _assert_close(jacobian, expected, 1e-6, floor)


def test_products_with_the_jacobian_of_the_rows(program, points):
    program, _ = program
    rng = np.random.default_rng(0)
    rows = program.linear_rows(points[0])
    jacobian = rows.jacobian()
    weights, step = rng.normal(size=len(jacobian)), rng.normal(size=jacobian.shape[1])
    for found, expected in (
        (rows.jacobian_product(step), jacobian @ step),
        (rows.transposed_product(weights), jacobian.T @ weights),
        (rows.curvature(weights), jacobian.T @ np.diag(weights) @ jacobian),
    ):
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * size)


def test_what_is_no_row_need_not_be_a_number(problem, points, monkeypatch):
    phases = np.array([0.2, 1.0, 2.9])
    mask = np.zeros((3, problem.limits.scale.size), dtype=bool)
    mask[0, 0] = mask[1, 1] = True
    program = _program(problem, phases, mask)
    x = points[0]
    expected = program.linear_rows(x)
    slopes = type(problem.limits).smooth_slopes

    def with_gaps(limits, states, width):
        values, found = slopes(limits, states, width)
        found[0, 1], found[1, 0] = np.nan, np.inf
        return values, found

    monkeypatch.setattr(type(problem.limits), "smooth_slopes", with_gaps)
    rows, weights = program.linear_rows(x), np.array([2.0, 3.0])
    np.testing.assert_array_equal(rows.curvature(weights), expected.curvature(weights))
    np.testing.assert_array_equal(
        rows.transposed_product(weights), expected.transposed_product(weights)
    )


@pytest.mark.parametrize("periodic", [True, False])
def test_what_smooth_friction_hides_is_counted_as_far_as_it_reaches(problem, points, periodic):
    states = problem.states(points[0], 2 * np.pi * np.arange(40) / 40)
    limits, reach, count = problem.limits, 2, len(states)
    exact = limits.violations(states)
    hidden = np.zeros_like(exact)
    bounded = limits.two_sided & np.isfinite(exact)
    np.subtract(exact, limits.smooth_violations(states, WIDTH), out=hidden, where=bounded)
    places = np.arange(count)[:, None] + np.arange(-reach, reach + 1)
    places = places % count if periodic else np.clip(places, 0, count - 1)
    expected = np.maximum(np.max(hidden[places], axis=1), 0)
    assert np.any(np.max(hidden[places], axis=1) < 0)
    assert np.any(expected > 0)

    found = smoothing_gap(limits, states, exact, WIDTH, reach, periodic=periodic)

    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_rows_are_the_limits_of_the_model(problem, program, points):
    """For a tiny width the smooth rows are the transforms of what users read."""
    phases = np.array([0.2, 1.0, 2.9])
    for x in points[:2]:
        basis = PhaseBasis.at(phases, HARMONICS)
        natural = problem.limits.values(problem.variables.states(x, basis))
        smooth = problem.limits.smooth_values(problem.states(x, phases), 1e-9)
        assert natural.shape == smooth.shape == (3, problem.limits.scale.size)
        for limit, columns in zip(problem.limits.limits, problem.limits.columns, strict=True):
            there = limit.definition.transform(natural[:, columns])
            if limit.definition.conservative:
                assert np.all(smooth[:, columns] >= there - 1e-9)
            else:
                np.testing.assert_allclose(
                    smooth[:, columns], there, rtol=1e-10, atol=1e-10, err_msg=limit.key
                )


def test_smooth_and_exact_limits_tell_the_same_violations(problem):
    rng = np.random.default_rng(9)
    phases = np.linspace(0, 6, 7)
    basis = PhaseBasis.at(phases, HARMONICS)
    seen = np.zeros(2, dtype=int)
    for spread in (0.1, 0.5, 1.0):
        x = spread * rng.normal(size=problem.variables.size)
        x[-1] = 0.8
        exact = problem.limits.violations(problem.variables.states(x, basis))
        smooth = problem.smooth_violations(x, phases, 1e-9)
        assert exact.shape == smooth.shape
        for limit, columns in zip(problem.limits.limits, problem.limits.columns, strict=True):
            here, there = exact[:, columns], smooth[:, columns]
            clear = np.isfinite(here) & (np.abs(here) > 1e-6)
            if limit.definition.conservative:
                assert np.all(here[clear & (there <= 0)] <= 0)
            else:
                np.testing.assert_array_equal((here > 0)[clear], (there > 0)[clear], limit.key)
            np.testing.assert_array_equal(np.isneginf(here), np.isneginf(there))
            seen += [np.count_nonzero(here[clear] > 0), np.count_nonzero(here[clear] <= 0)]
    assert np.all(seen > 20)


def test_margins_tighten_the_rows(problem):
    lower, upper = problem.limits.smooth_bounds()
    margins = np.full((5, problem.limits.scale.size), 0.05)
    tight_lower, tight_upper = problem.limits.smooth_bounds(margins)
    assert tight_lower.shape == (5, lower.size)
    given_below, given_above = np.isfinite(lower), np.isfinite(upper)
    assert np.all(tight_lower[:, given_below] > lower[given_below])
    assert np.all(tight_upper[:, given_above] < upper[given_above])
    assert np.all(np.isneginf(tight_lower[:, ~given_below]))
    assert np.all(np.isposinf(tight_upper[:, ~given_above]))


def test_rows_and_bounds_are_scaled_alike(problem, program, points):
    program, mask = program
    scale = np.broadcast_to(problem.limits.scale, mask.shape)[mask]
    states = problem.states(points[0], np.array([0.2, 1.0, 2.9]))
    values = problem.limits.smooth_values(states, WIDTH)[mask]
    np.testing.assert_allclose(program.rows(points[0]) * scale, values, rtol=1e-12)
    lower, upper = problem.limits.smooth_bounds()
    np.testing.assert_allclose(
        program.row_lower * scale, np.broadcast_to(lower, mask.shape)[mask], rtol=1e-12
    )
    np.testing.assert_allclose(
        program.row_upper * scale, np.broadcast_to(upper, mask.shape)[mask], rtol=1e-12
    )


def test_trust_region(problem):
    mask = np.zeros((1, problem.limits.scale.size), dtype=bool)
    center = np.append(np.full(30, 0.2), 0.99)
    program = _program(problem, np.zeros(1), mask, box=(center, 0.1))
    np.testing.assert_allclose(program.lower[:-1], 0.1)
    np.testing.assert_allclose(program.upper[:-1], 0.3)
    assert program.lower[-1] == pytest.approx(0.89)
    assert program.upper[-1] == 1
    free = _program(problem, np.zeros(1), mask, box=(center, None))
    assert np.all(np.isinf(free.lower[:-1]))


def test_a_program_without_rows(problem, points):
    mask = np.zeros((3, problem.limits.scale.size), dtype=bool)
    program = _program(problem, np.arange(3.0), mask)
    rows = program.linear_rows(points[0])
    assert rows.values.shape == program.rows(points[0]).shape == (0,)
    assert rows.jacobian().shape == (0, 31)
    assert rows.jacobian_product(points[0]).shape == (0,)
    assert not np.any(rows.transposed_product(np.empty(0)))
    assert not np.any(rows.curvature(np.empty(0)))
    solved = solve_by_interior_point(program, points[0], most=3)
    assert np.all(np.isfinite(solved.x))
    assert np.isfinite(program.cost(points[0]))


def test_a_robot_without_limits(points):
    description = load_robot_description("palida")
    robot = robot_from(dataclasses.replace(description, limits={}))
    problem = _problem(robot)
    assert problem.limits.limits == ()
    assert problem.limits.violations(np.zeros((4, 18))).shape == (4, 0)
    assert problem.smooth_violations(points[0], np.arange(3.0), WIDTH).shape == (3, 0)
    assert np.all(problem.variables.scale > 0)
    program = _program(problem, np.arange(3.0), np.zeros((3, 0), dtype=bool))
    assert program.linear_rows(points[0]).jacobian().shape == (0, 31)


# --- the statement --------------------------------------------------------------------------------


def test_frequency_can_be_fixed(problem):
    fixed = problem.with_variables(omega_bounds=(2.0, 2.0))
    lower, upper = fixed.variables.bounds()
    assert lower[-1] == upper[-1]
    assert lower[-1] * fixed.variables.omega_scale == pytest.approx(2.0)
    assert fixed.variables.omega_scale == problem.variables.omega_scale
    assert problem.variables.omega_bounds == pytest.approx((0.2 * np.pi, 1.2 * np.pi))


def test_scale_is_what_the_limits_allow_at_rest(problem, everything):
    scale = problem.variables.scale
    assert scale.shape == (6,)
    limits = {limit.key: limit for limit in everything.limits}
    reach = np.minimum(
        limits["position"].upper - everything.home[:3],
        everything.home[:3] - limits["position"].lower,
    )
    assert np.all(scale[:3] <= reach)
    assert np.all(scale[3:5] <= limits["tilt"].upper)
    for i in range(6):
        for side in (-1, 1):
            state = np.concatenate([everything.home, np.zeros(12)])
            state[i] += side * scale[i]
            assert np.all(problem.limits.violations(state[None]) <= 0), i


@pytest.mark.parametrize("harmonics", [1, 5, 12])
def test_any_number_of_harmonics(harmonics, problem):
    variables = dataclasses.replace(problem.variables, harmonics=harmonics)
    problem = dataclasses.replace(
        problem, cost=dataclasses.replace(problem.cost, variables=variables)
    )
    assert problem.variables.size == 12 * harmonics + 7
    rng = np.random.default_rng(harmonics)
    x = 0.1 * rng.normal(size=problem.variables.size)
    x[-1] = 0.8
    if harmonics > 1:
        _, gradient, hessian = problem.cost.derivatives(x, WIDTH, 0.0)
        direction = rng.normal(size=x.size)
        slope = _central(
            lambda t: problem.cost.value(x + t[0] * direction, WIDTH, 0.0), np.zeros(1), 1e-4
        )
        assert gradient @ direction == pytest.approx(slope[0], rel=1e-6)
        assert hessian.shape == (x.size, x.size)
