"""What limits cost: multipliers of problems whose multipliers are known, and of a design."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.experiment import sensitivity
from expdesign.experiment.sensitivity import (
    FREQUENCY,
    WIDER,
    balance_gradients,
    limit_sensitivity,
    sensitivity_at_design,
)
from expdesign.experiment.setup import plan_search
from expdesign.solver.phases import finish_phase
from expdesign.solver.starts import no_report, solve_phase
from expdesign.trajectory import TrajectoryFile


def test_multipliers_of_a_known_optimum():
    # min ‖x − a‖² with x₁ ≤ 1, x₂ ≤ 2, x₃ ≤ 9 has its optimum at (1, 2, a₃).
    a, x = np.array([3.0, 5.0, 4.0]), np.array([1.0, 2.0, 4.0])
    multipliers, left = balance_gradients(2 * (x - a), np.eye(3))
    assert multipliers == pytest.approx([4, 6, 0])
    assert left == pytest.approx(0, abs=1e-12)


def test_what_no_limit_explains_is_left():
    slope = np.array([-3.0, -4.0])
    multipliers, left = balance_gradients(slope, np.array([[1.0, 0.0]]))
    assert multipliers == pytest.approx([3])
    assert left == pytest.approx(0.8)
    # A limit on the other side holds nothing back.
    assert balance_gradients(slope, np.array([[-1.0, 0.0]]))[1] == pytest.approx(1)
    assert balance_gradients(slope, np.empty((0, 2)))[1] == 1
    assert balance_gradients(np.zeros(2), np.eye(2))[1] == 0


# Scaled variables, where the search from a random start came to a hundredth.
NEAR_AN_OPTIMUM = np.array([
    *(0, 0, 1.59, 0, 3.68), *(-0.08, 0.02, 0.9, 0.17, 3.72), *(0, 0, -3.57, 0, 1.87),
    *(0.61, 0.1, 1.08, 0.17, -1.94), *(-0.42, -0.21, 1.91, -0.18, -2.21),
    *(-0.58, 0.85, 1.15, 1.66, 0.59), 1,
])  # fmt: skip


@pytest.fixture(scope="module")
def run():
    """Return a small problem that few limits hold."""
    return load_run(
        {
            "name": "small",
            "robot": "palida",
            "trajectory": {"harmonics": 2, "frequency": [0.2, 0.6], "samples": 24},
            "design": {"starts": 1, "search": "restarts", "smoothing": [0.4, 0.2]},
            "experiment": {"sampling": 100},
            "workers": 1,
        }
    )


@pytest.mark.parametrize("key", ["a", "condition", "d", "e"])
def test_gains_are_those_of_the_criterion(run, key, monkeypatch):
    plan = plan_search(run.with_section("design", criterion=key))
    problem, x, width = plan.problem, NEAR_AN_OPTIMUM, plan.widths[-1]
    criterion, level = problem.criterion, problem.criterion.levels[-1]
    _, slope = problem.cost.gradient(x, width, level)
    # The limit "tilt" holds the motion back from this step alone.
    better = x - 0.01 * slope / (slope @ slope)
    costs, values = (
        [of(each) for each in (x, better)]
        for of in (
            lambda at: problem.cost.value(at, width, level),
            lambda at: criterion.value(np.linalg.eigvalsh(problem.cost.information(at, width))),
        )
    )
    rows = sensitivity._ActiveRows(
        ["tilt"], -slope[None], np.array([costs[0] - costs[1]]), np.zeros(1)
    )
    monkeypatch.setattr(sensitivity, "_active_rows", lambda *_: rows)
    found = sensitivity_at_design(plan, problem.variables.trajectory(x))
    now, then = values
    expected = then / now if criterion.larger_is_better else now / then
    if criterion.invariant:
        expected = np.exp((then - now) / len(problem.cost.scaling))
    assert expected > 1.005
    assert found.gains["tilt"] == pytest.approx(expected - 1, rel=0.05)


@pytest.mark.slow
def test_gains_are_those_of_solving_again_with_wider_limits(run):
    plan = plan_search(run)
    problem = plan.problem
    stage = replace(finish_phase(problem, plan.widths, 400), radius=None)
    x = NEAR_AN_OPTIMUM
    costs = [np.inf, 1e9]
    while costs[-2] - costs[-1] > 1e-6:
        x, record = solve_phase(problem, stage, x, no_report)
        costs.append(record.objective)
    found = limit_sensitivity(run, problem.variables.trajectory(x))
    assert found.unexplained < 0.05
    holding = [key for key, gain in found.gains.items() if gain > 0.01 and key != FREQUENCY]
    assert len(holding) > 2
    step = 0.01
    for key in holding:
        limits = tuple(
            limit if limit.key != key else _wider(limit, step) for limit in problem.limits.limits
        )
        wider = replace(problem, limits=replace(problem.limits, limits=limits))
        _, record = solve_phase(wider, stage, x, no_report)
        gain = np.expm1((costs[-1] - record.objective) * WIDER / step)
        assert gain == pytest.approx(found.gains[key], rel=0.1, abs=0.01), key


@pytest.mark.slow
def test_what_a_reserve_costs_is_what_solving_again_without_it_gains(run):
    share = 0.01
    reserved = load_run(
        {**run.run.model_dump(by_alias=True, exclude={"feedforward"}), "limits": {"reserve": share}}
    )
    plan = plan_search(reserved)
    problem = plan.problem
    stage = replace(finish_phase(problem, plan.widths, 400), radius=None)
    x, record = solve_phase(problem, stage, 0.95 * NEAR_AN_OPTIMUM, no_report)
    found = limit_sensitivity(reserved, problem.variables.trajectory(x))
    limits = tuple(limit.with_reserve(0.0) for limit in problem.limits.limits)
    stated = replace(problem, limits=replace(problem.limits, limits=limits))
    _, without = solve_phase(stated, stage, x, no_report)
    lost = -np.expm1(without.objective - record.objective)
    assert lost > 0.02
    assert found.reserve == pytest.approx(lost, rel=0.1)
    assert set(found.reserved) == {limit.key for limit in problem.limits.limits}
    assert sum(found.reserved.values()) == pytest.approx(found.reserve, rel=0.05)
    assert limit_sensitivity(run, problem.variables.trajectory(x)).reserve == 0


def _wider(limit, share):
    two_sided = np.isfinite(limit.lower) & np.isfinite(limit.upper)
    move = np.where(two_sided, share / 2, share) * limit.range
    return replace(limit, lower=limit.lower - move, upper=limit.upper + move)


@pytest.mark.slow
def test_gains_at_a_design_are_about_those_at_the_optimum_beside_it():
    run = load_run("palida")
    file = Path(__file__).parents[2] / "benchmarks" / "designs" / "palida.json"
    trajectory = TrajectoryFile.read(file).trajectory
    exact = limit_sensitivity(run, trajectory)
    rough = sensitivity_at_design(plan_search(run), trajectory)
    assert rough.unexplained < 0.03
    assert rough.gains == pytest.approx(exact.gains, abs=0.015)
    assert max(rough.gains.values()) > 0.03
