"""The dense interior point method, on problems whose solutions are known, and beside Ipopt."""

import numpy as np
import pytest

from expdesign.solver import interior_point
from expdesign.solver.interior_point import RENEWED, solve_by_interior_point
from expdesign.solver.ipopt import solve_with_ipopt
from tests.solver.programs import INF, Counted, Fit, Quadratic, Rosenbrock, quadratic, rosenbrock

# It ends where the objective stands still; Ipopt has the last word in a design.
CLOSE = 5e-3


def test_convex_quadratic_program():
    program = quadratic()
    result = solve_by_interior_point(program, np.zeros(3), most=200)
    A = Quadratic.A[:2]
    kkt = np.block([[Quadratic.H, A.T], [A, np.zeros((2, 2))]])
    solution = np.linalg.solve(kkt, np.concatenate([Quadratic.c, [0.5, 5.0]]))
    assert result.converged
    np.testing.assert_allclose(result.x, solution[:3], atol=CLOSE)
    assert result.objective == pytest.approx(program.f(solution[:3]), rel=CLOSE)
    np.testing.assert_allclose(result.multipliers, [*solution[3:], 0.0], atol=0.1)


@pytest.mark.parametrize("start", [(0.1, 0.2), (3.0, -4.0)])
def test_nonlinear_program_from_inside_and_from_outside(start):
    program = Fit(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))
    result = solve_by_interior_point(program, np.array(start), most=200)
    angles = np.linspace(0, np.pi / 2, 2_000_001)
    costs = (np.cos(angles) - 2) ** 2 + 4 * (np.sin(angles) - 1) ** 2
    best = angles[np.argmin(costs)]
    assert result.converged
    np.testing.assert_allclose(result.x, [np.cos(best), np.sin(best)], atol=CLOSE)


def test_without_rows():
    result = solve_by_interior_point(rosenbrock(), np.array([-1.2, 1.0]), most=200)
    assert result.converged
    np.testing.assert_allclose(result.x, [1, 1], atol=0.05)
    assert result.multipliers.shape == (0,)


@pytest.mark.parametrize("bounds", [(-INF, 0.5), (0.2, 0.5), (0.5, 0.5)])
def test_bounds_on_the_variables(bounds):
    program = Rosenbrock(([bounds[0], -INF], [bounds[1], INF]), ([], []))
    result = solve_by_interior_point(program, np.zeros(2), most=300)
    assert bounds[0] <= result.x[0] <= bounds[1]
    np.testing.assert_allclose(result.x, [0.5, 0.25], atol=0.01)


@pytest.mark.parametrize("seed", range(12))
def test_many_rows_beside_ipopt(seed):
    """Random convex programs with many more rows than variables, from points that break them."""
    rng = np.random.default_rng(seed)
    size, count = 12, 300

    class Random(Counted):
        H = np.cov(rng.normal(size=(size, 3 * size)))
        c = rng.normal(size=size)
        A = rng.normal(size=(count, size))

        f, slope = Quadratic.f, Quadratic.slope
        curvature, g, row_slopes = Quadratic.curvature, Quadratic.g, Quadratic.row_slopes

    program = Random(
        ([-INF] * size, [INF] * size), (-rng.uniform(0.5, 2, count), rng.uniform(0.5, 2, count))
    )
    start = rng.normal(size=size)
    found = solve_by_interior_point(program, start, most=300)
    best = solve_with_ipopt(program, start, options={"print_level": 0, "sb": "yes"})
    assert found.converged
    assert best.converged
    assert found.objective == pytest.approx(best.objective, abs=5e-3 * (1 + abs(best.objective)))
    rows = program.A @ found.x
    assert np.all(rows >= program.row_lower - 1e-3)
    assert np.all(rows <= program.row_upper + 1e-3)


def test_rows_that_contradict_each_other_end_it():
    program = Quadratic(([-INF] * 3, [INF] * 3), ([2.0, -INF, 0], [INF, 5.0, 0.1]))
    program.A = np.array([[1.0, 0, 0], [0, 1.0, 0], [1.0, 0, 0]])
    result = solve_by_interior_point(program, np.zeros(3), most=60)
    rows = program.g(result.x)
    assert np.max(np.maximum(program.row_lower - rows, rows - program.row_upper)) > 0.5
    assert not result.converged


def test_values_that_are_no_numbers_end_it():
    class Hole(Quadratic):
        def cost_derivatives(self, x):
            cost, slope, curvature = super().cost_derivatives(x)
            return cost, slope, curvature * np.where(np.abs(x).max() > 0.5, np.nan, 1.0)

    program = Hole(([-INF] * 3, [INF] * 3), ([-INF, 5.0, -INF], [0.5, INF, 100.0]))
    result = solve_by_interior_point(program, np.zeros(3), most=60)
    assert result.status == "Invalid_Number_Detected"
    assert not result.converged


def test_a_cost_that_is_no_number_is_no_solution():
    class Hole(Quadratic):
        def f(self, x):
            return np.nan if np.abs(x).max() > 0.2 else super().f(x)

    program = Hole(([-INF] * 3, [INF] * 3), ([-INF, 5.0, -INF], [0.5, INF, 100.0]))
    result = solve_by_interior_point(program, np.zeros(3), most=60)
    assert np.isfinite(result.objective)
    assert not result.converged


@pytest.mark.parametrize("barrier", [1e-2, 1e-3, 1e-5])
@pytest.mark.parametrize("start", [(0.5, 0.1), (0.0, 2.0), (3.0, -4.0)])
def test_a_cost_that_stands_still_beyond_the_rows_is_no_solution(barrier, start):
    class High(Fit):
        """So high that every step changes it little; its steps cross the circle."""

        def f(self, x):
            return 1000 + 0.015 * x @ x + 0.05 * x[0]

        def slope(self, x):
            return 0.03 * x + [0.05, 0.0]

        def curvature(self, x):
            return 0.03 * np.eye(2)

    program = High(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))
    result = solve_by_interior_point(program, np.array(start), most=60, barrier=barrier)
    assert result.x @ result.x <= 1 + 1e-3 or not result.converged


def test_a_cost_without_eigenvalues_ends_it():
    class Singular(Quadratic):
        def f(self, x):
            if np.abs(x).max() > 0.5:
                raise np.linalg.LinAlgError
            return super().f(x)

    program = Singular(([-INF] * 3, [INF] * 3), ([-INF, 5.0, -INF], [0.5, INF, 100.0]))
    result = solve_by_interior_point(program, np.zeros(3), most=60)
    assert np.all(np.isfinite(result.x))
    assert np.abs(result.x).max() <= 0.5
    assert not result.converged
    nowhere = solve_by_interior_point(program, np.ones(3), most=60)
    assert not nowhere.converged


class Straight(Fit):
    """A cost without a curvature of its own; all that bends is the circle."""

    def f(self, x):
        return 1000 - x[0]

    def slope(self, x):
        return np.array([-1.0, 0.0])

    def curvature(self, x):
        return np.zeros((2, 2))


def straight():
    return Straight(([-INF] * 2, [INF] * 2), ([-INF], [1.0]))


@pytest.mark.parametrize(
    ("program", "start"), [(quadratic(), (0.3, 0.3, 0.3)), (straight(), (0.5, 0.1))]
)
def test_evaluations_are_the_true_ones_and_every_iterate_is_reported(program, start):
    seen = []

    def report(*iteration):
        seen.append(iteration)
        return True

    result = solve_by_interior_point(program, np.array(start), most=200, report=report)
    counts, calls = result.evaluations, program.calls
    # The first trial of every step is evaluated with its derivatives, others only where it fails:
    # on the circle, and never between planes.
    again = counts["grad_f"] - (result.iterations + 1)
    assert (again > 0) == (counts["f"] > 0) == isinstance(program, Straight)
    assert 0 <= again <= counts["f"] == calls["cost"]
    assert 0 <= calls["cost_derivatives"] - 1 - result.iterations // RENEWED <= again
    assert calls["cost_derivatives"] + calls["cost_gradient"] == counts["grad_f"]
    assert counts["g"] == calls["rows"]
    assert counts["jac_g"] == calls["jacobian"]
    assert [number for number, *_ in seen] == list(range(1, result.iterations + 2))
    for _, objective, violation, x in seen:
        assert objective == pytest.approx(program.f(x), rel=1e-12, abs=1e-12)
        rows = program.g(x)
        excess = np.maximum(program.row_lower - rows, rows - program.row_upper)
        assert violation == pytest.approx(max(0.0, *excess), abs=1e-12)


@pytest.mark.parametrize("following", [True, False])
def test_slacks_follow_their_rows_where_they_are_asked_to(following, monkeypatch):
    seen, try_slacks = [], interior_point.try_slacks

    def recorded(*arguments):
        seen.append(arguments[-1])
        return try_slacks(*arguments)

    monkeypatch.setattr(interior_point, "try_slacks", recorded)
    solve_by_interior_point(straight(), np.array([0.5, 0.1]), most=60, following=following)
    # The first ones are put inside, and never follow.
    assert not seen[0]
    assert set(seen[1:]) == {following}


def test_a_slope_that_is_no_number_is_no_optimum():
    program = rosenbrock()
    program.slope = lambda x: np.full(2, np.nan)
    result = solve_by_interior_point(program, np.array([-1.0, 1.0]), most=20)
    assert not result.converged


@pytest.mark.parametrize("following", [True, False])
def test_with_few_iterations_the_barrier_falls_to_its_end_only_where_slacks_stay(
    following, monkeypatch
):
    """Where they follow their rows, they end on their bounds when it falls that fast."""
    barriers, eliminate_slacks = [], interior_point.eliminate_slacks

    def recorded(*arguments):
        barriers.append(arguments[-1])
        return eliminate_slacks(*arguments)

    monkeypatch.setattr(interior_point, "eliminate_slacks", recorded)
    solve_by_interior_point(
        straight(), np.array([0.5, 0.1]), most=12, barrier=0.1, following=following
    )
    shares = np.array(barriers[1:]) / barriers[:-1]
    if following:
        assert np.min(shares) > 0.86
    else:
        assert np.min(shares) < 0.5


@pytest.mark.parametrize("stop_at", [1, 3])
def test_a_report_stops_it(stop_at):
    result = solve_by_interior_point(
        quadratic(), np.zeros(3), most=200, report=lambda number, *_: number < stop_at
    )
    assert result.status == "User_Requested_Stop"
    assert not result.converged
    assert result.iterations == stop_at - 1


@pytest.mark.parametrize("following", [True, False])
@pytest.mark.parametrize("renewed", [None, 1, 6])
def test_rows_that_bend_are_kept_where_the_cost_does_not(following, renewed):
    result = solve_by_interior_point(
        straight(),
        np.array([0.5, 0.1]),
        most=60,
        barrier=1e-3,
        following=following,
        renewed=renewed,
    )
    assert result.converged
    assert result.x @ result.x <= 1 + 1e-4
    np.testing.assert_allclose(result.x, [1.0, 0.0], atol=1e-3)
