"""Ipopt behind its interface, on problems whose solutions are known."""

import numpy as np
import pytest

from expdesign.solver.ipopt import IPOPT_OPTIONS, solve_with_ipopt
from tests.solver.programs import INF, Fit, Quadratic, Rosenbrock, quadratic, rosenbrock

OPTIONS = {"print_level": 0, "sb": "yes", "tol": 1e-9}


def test_convex_quadratic_program():
    """The solution of the KKT system, with the two active rows and the inactive third."""
    program = quadratic()
    result = solve_with_ipopt(program, np.zeros(3), options=OPTIONS)
    A = Quadratic.A[:2]
    kkt = np.block([[Quadratic.H, A.T], [A, np.zeros((2, 2))]])
    solution = np.linalg.solve(kkt, np.concatenate([Quadratic.c, [0.5, 5.0]]))
    assert result.converged
    assert result.status == "Solve_Succeeded"
    np.testing.assert_allclose(result.x, solution[:3], atol=1e-6)
    assert result.objective == pytest.approx(program.f(solution[:3]), abs=1e-6)
    # Positive at the upper bound, negative at the lower, zero where a row is inactive.
    assert solution[3] > 0 > solution[4]
    np.testing.assert_allclose(result.multipliers, [*solution[3:], 0.0], atol=1e-5)


def test_nonlinear_program():
    """Stationarity on the circle, with the multiplier of the row."""
    program = Fit(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))
    result = solve_with_ipopt(program, np.array([0.1, 0.2]), options=OPTIONS)
    angles = np.linspace(0, np.pi / 2, 2_000_001)
    costs = (np.cos(angles) - 2) ** 2 + 4 * (np.sin(angles) - 1) ** 2
    best = angles[np.argmin(costs)]
    assert result.converged
    np.testing.assert_allclose(result.x, [np.cos(best), np.sin(best)], atol=2e-6)
    assert result.multipliers[0] > 0
    stationary = program.slope(result.x) + result.multipliers[0] * 2 * result.x
    np.testing.assert_allclose(stationary, 0, atol=1e-6)


def test_least_squares_without_rows():
    result = solve_with_ipopt(rosenbrock(), np.array([-1.2, 1.0]), options=OPTIONS)
    assert result.converged
    np.testing.assert_allclose(result.x, [1, 1], atol=1e-5)
    assert result.multipliers.shape == (0,)


def test_bounds_on_the_variables():
    program = Rosenbrock(([-INF, -INF], [0.5, INF]), ([], []))
    result = solve_with_ipopt(program, np.zeros(2), options=OPTIONS)
    assert result.converged
    np.testing.assert_allclose(result.x, [0.5, 0.25], atol=1e-5)


@pytest.mark.parametrize("make", [quadratic, rosenbrock])
def test_evaluations_are_the_true_ones(make):
    program = make()
    result = solve_with_ipopt(program, np.full(program.lower.size, 0.3), options=OPTIONS)
    counts, calls = result.evaluations, program.calls
    assert calls["cost_derivatives"] == 0
    assert counts["f"] == calls["cost"] > 0
    assert counts["grad_f"] == calls["cost_gradient"] > 0
    assert counts["g"] == calls["rows"]
    assert counts["jac_g"] == calls["jacobian"]
    # No point is evaluated twice for the Hessian or the iteration's report.
    assert counts["grad_f"] <= result.iterations + 2


def test_an_interruption_is_not_lost_in_ipopt():
    def report(*_iteration):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve_with_ipopt(quadratic(), np.zeros(3), options=OPTIONS, report=report)


def test_report_gets_every_iterate():
    program, seen = quadratic(), []

    def report(*iteration):
        seen.append(iteration)
        return True

    result = solve_with_ipopt(program, np.zeros(3), options=OPTIONS, report=report)
    assert [number for number, *_ in seen] == list(range(1, len(seen) + 1))
    assert len(seen) >= result.iterations
    for _, objective, violation, x in seen:
        assert objective == pytest.approx(program.f(x), rel=1e-12, abs=1e-12)
        rows = program.g(x)
        excess = np.maximum(program.row_lower - rows, rows - program.row_upper)
        assert violation == pytest.approx(max(0.0, *excess), abs=1e-12)
    np.testing.assert_allclose(seen[-1][-1], result.x, atol=1e-6)


@pytest.mark.parametrize("stop_at", [1, 3])
def test_report_stops_the_solver(stop_at):
    numbers = []

    def report(number, *_):
        numbers.append(number)
        return number < stop_at

    result = solve_with_ipopt(rosenbrock(), np.array([-1.2, 1.0]), options=OPTIONS, report=report)
    assert numbers == list(range(1, stop_at + 1))
    assert result.status == "User_Requested_Stop"
    assert not result.converged
    assert np.all(np.isfinite(result.x))


def test_status_of_too_few_iterations():
    result = solve_with_ipopt(
        rosenbrock(), np.array([-1.2, 1.0]), options={**OPTIONS, "max_iter": 2}
    )
    assert result.status == "Maximum_Iterations_Exceeded"
    assert not result.converged
    assert result.iterations == 2


def test_status_of_contradicting_rows():
    """On the circle of radius 2 and inside that of radius 1, there is no point."""

    class Contradiction(Fit):
        def g(self, x):
            return np.array([x @ x, x @ x])

        def row_slopes(self, x):
            return np.array([2 * x, 2 * x])

    program = Contradiction(([-INF] * 2, [INF] * 2), ([-INF, 4.0], [1.0, INF]))
    result = solve_with_ipopt(program, np.array([0.5, 0.5]), options=OPTIONS)
    assert result.status == "Infeasible_Problem_Detected"
    assert not result.converged


def test_status_of_a_model_without_a_number():
    class Undefined(Fit):
        def f(self, x):
            return np.nan

    program = Undefined(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))
    result = solve_with_ipopt(program, np.array([0.5, 0.5]), options=OPTIONS)
    assert result.status == "Invalid_Number_Detected"
    assert not result.converged


def test_an_error_in_the_model_is_not_swallowed():
    """It ends the solve; it does not become a number."""

    class Broken(Fit):
        def slope(self, x):
            raise ZeroDivisionError("broken model")

    program = Broken(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))
    try:
        result = solve_with_ipopt(program, np.array([0.5, 0.5]), options=OPTIONS)
    except (RuntimeError, ZeroDivisionError):
        return
    assert not result.converged


def test_the_options_of_the_search_are_ipopts():
    result = solve_with_ipopt(quadratic(), np.zeros(3), options=IPOPT_OPTIONS)
    assert result.converged
