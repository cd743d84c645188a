import numpy as np
import pytest

from expdesign.information.criteria import criteria
from expdesign.solver.feasibility import perturb, random_start
from expdesign.solver.phases import PhaseResult, continuation_phases, hop_phases
from expdesign.solver.starts import is_hopeless

WIDTH = 0.4


@pytest.fixture(scope="module")
def origin(problem):
    return random_start(problem, np.random.default_rng(0), 40, WIDTH)


@pytest.mark.parametrize("seed", range(6))
def test_a_hop_keeps_the_limits_and_moves(problem, origin, seed):
    x = perturb(problem, origin, np.random.default_rng(seed), WIDTH)
    assert x.shape == origin.shape
    phases = 2 * np.pi * np.arange(24) / 24
    assert np.max(problem.smooth_violations(x, phases, WIDTH)) <= 0
    assert np.max(np.abs(x - origin)) > 1e-3
    lower, upper = problem.variables.bounds()
    assert lower[-1] <= x[-1] <= upper[-1]
    # It is no new random start: most of the motion is the old one.
    assert np.corrcoef(x[:-1], origin[:-1])[0, 1] > 0.5


def test_the_generator_decides_and_the_origin_stays(problem, origin):
    before = origin.copy()
    first, again, other = (
        perturb(problem, origin, np.random.default_rng(seed), WIDTH) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.max(np.abs(first - other)) > 1e-3
    np.testing.assert_array_equal(origin, before)


def test_a_fixed_frequency_stays(problem, origin):
    omega = problem.variables.trajectory(origin).omega
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    for seed in range(3):
        x = perturb(fixed, origin, np.random.default_rng(seed), WIDTH)
        assert fixed.variables.trajectory(x).omega == pytest.approx(omega, rel=1e-15)


# --- what is given up -----------------------------------------------------------------------------


def reached(name, objective, width=0.1, level=1.0, samples=48):
    return PhaseResult(
        name, width, level, samples, 100, 1, 10, {}, 1.0, "Solve_Succeeded", True, objective, 0.0
    )


def test_a_hop_is_given_up_when_it_is_far_behind_in_the_same_phase():
    reference = (reached("blunt", -1.2), reached("sharp", -1.4))
    assert not is_hopeless(reached("blunt", -1.3), reference, last=False)
    assert not is_hopeless(reached("blunt", -1.2), reference, last=False)
    assert not is_hopeless(reached("blunt", -1.195), reference, last=False)
    assert is_hopeless(reached("blunt", -1.1), reference, last=False)


def test_in_its_last_phase_it_is_when_it_is_behind_at_all():
    reference = (reached("blunt", -1.2), reached("sharp", -1.2))
    assert not is_hopeless(reached("sharp", -1.2), reference, last=True)
    assert is_hopeless(reached("sharp", -1.195), reference, last=True)


@pytest.mark.parametrize("other", [{"width": 0.2}, {"level": 4.0}, {"samples": 24}])
def test_costs_of_other_problems_are_not_compared(other):
    reference = (reached("sharp", -1.2),)
    assert is_hopeless(reached("sharp", 0.0), reference, last=True)
    assert not is_hopeless(reached("sharp", 0.0, **other), reference, last=True)


def test_only_like_phases_are_compared():
    """The smoothing tells apart sharp phases; of several alike the last counts."""
    reference = (reached("sharp", -1.5, 0.2), reached("sharp", -1.0), reached("sharp", -1.2))
    assert not is_hopeless(reached("blunt", 0.0), reference, last=False)
    assert not is_hopeless(reached("sharp", -1.2), reference, last=True)
    assert is_hopeless(reached("sharp", -1.1), reference, last=True)
    assert not is_hopeless(reached("sharp", 0.0), (), last=True)


@pytest.mark.parametrize("harmonics", [2, 5, 7])
@pytest.mark.parametrize("key", ["d", "e"])
@pytest.mark.parametrize("widths", [(0.2,), (0.4, 0.2), (0.4, 0.2, 0.1)])
def test_a_hops_last_phase_can_be_compared_with_a_starts(problem, harmonics, key, widths):
    """And with no other stage of a start: what a start is measured by is its last stage."""
    case = problem.with_criterion(criteria()[key]).with_variables(harmonics=harmonics)
    phases = continuation_phases(case, widths, 10)
    first, *_, settled = hop_phases(case, widths, 10)
    for name in ("name", "width", "level", "samples", "points"):
        assert getattr(settled, name) == getattr(phases[-1], name)
    assert (first.name, first.width, first.points) == ("blunt", widths[0], 8 * harmonics + 8)
    assert first.harmonics is None
    kinds = [(one.name, one.width, one.level, one.points) for one in phases]
    assert kinds.count(kinds[-1]) == 1
    assert phases[-1].points == 16 * harmonics + 20
