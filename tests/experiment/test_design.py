"""The design as a whole, held against computations that are written out here."""

from dataclasses import replace

import numpy as np
import pytest

import expdesign
from expdesign.configuration import load_run
from expdesign.evaluation.machine_code import SWITCH
from expdesign.experiment import setup
from expdesign.experiment.precision import precision_in_words
from expdesign.experiment.setup import plan_search
from expdesign.information.fisher import SingularInformationError
from expdesign.information.identifiable import listed
from expdesign.solver.feasibility import random_start
from expdesign.workers import StoppedError
from tests.experiment.off_the_grids import TOLERANCE, assert_limits_kept, worst_excess


def regressors_of(result, samples):
    times = result.trajectory.period * np.arange(samples) / samples
    motion = result.trajectory.sample(times)
    return result.robot.regressor(motion.pose, motion.rate, motion.acceleration)


def information_of(result, samples):
    """Sum F over the samples of one period, sample by sample."""
    inverse = np.linalg.inv(result.configuration.robot.noise.force_covariance)
    names = result.robot.parameter_names
    columns = [names.index(name) for name in result.parameter_names]
    total = np.zeros((len(columns), len(columns)))
    for regressor in regressors_of(result, samples):
        judged = regressor[:, columns]
        total += judged.T @ inverse @ judged
    return total


def unit_diagonal(information):
    scales = np.sqrt(np.diag(information))
    return information / np.outer(scales, scales), scales


def log_det_of(information):
    """By LU of the matrix at unit diagonal, for the sake of its digits."""
    scaled, scales = unit_diagonal(information)
    sign, value = np.linalg.slogdet(scaled)
    assert sign == 1
    return value + 2 * np.sum(np.log(scales))


def std_of(information):
    scaled, scales = unit_diagonal(information)
    return np.sqrt(np.diag(np.linalg.inv(scaled))) / scales


# --- the limits -----------------------------------------------------------------------------------


def test_every_limit_is_kept_between_all_grids(tiny_result):
    keys = {limit.key for limit in tiny_result.robot.limits}
    assert set(worst_excess(tiny_result)) == keys
    assert_limits_kept(tiny_result)


def test_the_limits_are_used(tiny_result):
    """An optimal excitation is stopped by limits, not by the solver's margins."""
    assert -2e-3 < tiny_result.check.worst <= TOLERANCE


# --- what is reported -----------------------------------------------------------------------------


def test_log_det_is_that_of_the_trajectory(tiny_result):
    information = information_of(tiny_result, tiny_result.samples)
    assert tiny_result.samples == 24
    np.testing.assert_allclose(
        tiny_result.information, information, rtol=1e-9, atol=1e-12 * np.max(information)
    )
    assert tiny_result.log_det_information == pytest.approx(log_det_of(information), abs=1e-6)
    assert tiny_result.criterion_value == tiny_result.log_det_information


def test_predicted_std_is_that_of_the_trajectory(tiny_result):
    names = tiny_result.parameter_names
    assert names == tiny_result.robot.parameter_names
    per_period, experiment = tiny_result.predicted_std.per_period, tiny_result.experiment
    expected = std_of(information_of(tiny_result, 24))
    assert (per_period.samples, per_period.periods) == (24, 1)
    np.testing.assert_allclose([per_period.std[n] for n in names], expected, rtol=1e-5)
    # The experiment: three periods at 100 Hz.
    count = round(tiny_result.trajectory.period * 100)
    expected = std_of(3 * information_of(tiny_result, count))
    assert (experiment.samples, experiment.periods) == (3 * count, 3)
    np.testing.assert_allclose([experiment.std[n] for n in names], expected, rtol=1e-5)


def test_the_precision_of_a_motion_in_words(tiny_result):
    run = tiny_result.configuration
    mass = next(one for one in tiny_result.derived if one.quantity == "mass")
    std, scales = tiny_result.predicted_std.experiment.std, tiny_result.robot.scales
    shares = dict(zip(std, np.array(list(std.values())) / scales, strict=True))
    worst = max(shares, key=shares.get)
    largest = float(f"{100 * shares[worst]:.2g}")
    expected = f"the worst, {worst}, ± {largest:g} % in "
    words = precision_in_words(run, tiny_result.trajectory)
    assert words.startswith(f"mass ± {mass.rel_std_percent:.2g} %, {expected}")
    goals = replace(run, run=run.run.model_copy(update={"goals": {"p10": "1 kg"}}))
    named = precision_in_words(goals, tiny_result.trajectory)
    assert named.startswith(f"p10 ± {100 * shares['p10']:.2g} %, {expected}")


def test_the_period_is_a_whole_number_of_controller_steps(tiny_result):
    steps = tiny_result.trajectory.period / 0.01
    assert steps == pytest.approx(round(steps), abs=1e-9)
    assert tiny_result.samples_per_period == pytest.approx(steps)
    assert 0.2 <= tiny_result.trajectory.frequency <= 0.6
    assert not any("controller" in warning for warning in tiny_result.warnings)


def test_what_is_not_limited_is_told_with_what_the_motion_does_there(tiny_result):
    (said,) = (one for one in tiny_result.warnings if "no limit is set on" in one)
    pose = tiny_result.trajectory.sample(tiny_result.trajectory.sample_times(2000)).pose
    for name, values in zip(("phi", "theta", "psi"), pose[:, 3:].T, strict=True):
        assert f"{name} {np.degrees(np.abs(values).max()):.3g} deg from home" in said


def test_status_and_statistics(tiny_result):
    search = tiny_result.solver
    assert tiny_result.status in {"converged", "not converged"}
    assert tiny_result.passed
    assert len(search.starts) == 1
    assert [start.best for start in search.starts] == [True]
    for start in search.starts:
        assert start.kind == "random"
        assert start.status
        assert start.iterations == sum(stage["iterations"] for stage in start.stages) > 0
        assert all(stage["evaluations"]["grad_f"] > 0 for stage in start.stages)
        assert start.seconds > 0
    assert search.seconds > 0


# --- frequency ------------------------------------------------------------------------------------


def test_a_fixed_frequency_is_kept_and_warned_about(tiny, cheap_finish):
    result = expdesign.design(
        tiny(trajectory={"frequency": ["0.37 Hz", "0.37 Hz"]}, design={"max_iterations": 4})
    )
    assert result.trajectory.frequency == pytest.approx(0.37, rel=1e-12)
    assert result.samples_per_period == pytest.approx(1 / 0.0037)
    (warning,) = (w for w in result.warnings if "controller" in w)
    assert "270.27" in warning
    for frequency in (1 / 2.71, 1 / 2.70):
        assert f"{frequency:.9g} Hz" in warning
    # Rows at about the controller's rate, a whole number of them over exactly one period.
    times = result.motion.time
    np.testing.assert_allclose(times, result.trajectory.period * np.arange(270) / 270, rtol=1e-12)
    assert_limits_kept(result)
    # 100 Hz and 3 periods of no whole number of samples: their last one ends before the end.
    assert result.experiment.samples == int(3 / 0.0037) + 1  # the first at t = 0


# --- criteria, scaling, parameters ----------------------------------------------------------------


def nominal_scale(result):
    values = np.abs(result.robot.parameters)
    assert np.all(values > 0)
    return values


def condition_of(information):
    values = np.linalg.eigvalsh(information)
    return values[-1] / values[0]


@pytest.fixture(scope="module")
def settled(tiny):
    """Return the D-optimal design with iterations enough for its search to end."""
    return expdesign.design(tiny(design={"max_iterations": 160}))


@pytest.mark.parametrize("criterion", ["a", "e", "condition"])
def test_other_criteria(criterion, tiny, settled, cheap_finish):
    """Each is what its name says, of F scaled by the nominal values, and improved on."""
    result = expdesign.design(
        tiny(design={"criterion": criterion, "scaling": "nominal", "max_iterations": 160})
    )
    scale = nominal_scale(result)

    def value(information):
        scaled = information * np.outer(scale, scale)
        if criterion == "a":
            return np.trace(np.linalg.inv(scaled))
        if criterion == "e":
            return np.linalg.eigvalsh(scaled)[0]
        return condition_of(scaled)

    information = information_of(result, 24)
    assert result.criterion_value == pytest.approx(value(information), rel=1e-5)
    assert result.log_det_information == pytest.approx(log_det_of(information), abs=1e-5)
    assert_limits_kept(result)
    # Better than the feasible random motion that the start began with.
    plan = plan_search(result.configuration)
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(1,)))
    x = random_start(plan.problem, rng, 24, 0.4)
    before = plan.evaluator.information(plan.problem.variables.trajectory(x), 24)
    assert (value(information) > value(before)) == (criterion == "e")
    if criterion == "condition":
        assert value(information) < value(settled.information)
    assert result.log_det_information < settled.log_det_information


def trajectories_equal(a, b, rtol=1e-9):
    np.testing.assert_allclose(a.trajectory.vector(), b.trajectory.vector(), rtol=rtol, atol=rtol)


def test_scaling_changes_no_d_optimal_trajectory(tiny, few_limits, cheap_finish):
    search = {"starts": 1, "max_iterations": 3}
    si, nominal = (
        expdesign.design(tiny(robot=few_limits, design=search | {"scaling": scaling}))
        for scaling in ("si", "nominal")
    )
    trajectories_equal(si, nominal, rtol=1e-12)
    assert si.log_det_information == nominal.log_det_information
    # In units of its nominal value each parameter shifts log det F by a constant.
    scale = nominal_scale(si)
    shifted = log_det_of(si.information * np.outer(scale, scale))
    assert shifted - si.log_det_information == pytest.approx(2 * np.sum(np.log(scale)), abs=1e-6)


def test_rescaled_parameters_change_no_d_optimal_trajectory(tiny, cheap_finish):
    """The cost's own scales shift the cost by a constant and leave its derivatives alone."""
    problem = plan_search(load_run(tiny())).problem
    factors = 10 ** np.random.default_rng(5).uniform(-2, 2, problem.cost.scaling.size)
    rescaled = replace(problem.cost, scaling=problem.cost.scaling * factors)
    x = random_start(problem, np.random.default_rng(1), 40, 0.4)
    value, gradient, hessian = problem.cost.derivatives(x, 0.4, 1.0)
    other, other_gradient, other_hessian = rescaled.derivatives(x, 0.4, 1.0)
    np.testing.assert_allclose(other_gradient, gradient, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(
        other_hessian, hessian, rtol=1e-5, atol=1e-5 * np.max(np.abs(hessian))
    )
    # Read in SI units, both say the same, but for what rounding does to the smallest eigenvalues.
    rounding = np.finfo(float).eps * np.linalg.cond(rescaled.information(x, 0.4))
    assert rounding < 1e-3
    assert rescaled.criterion_value(other) == pytest.approx(
        problem.cost.criterion_value(value), abs=rounding
    )


def test_a_subset_of_the_parameters(tiny, cheap_finish):
    wanted = ["p10", "r3", "p9", "v1"]
    result = expdesign.design(tiny(design={"parameters": wanted, "starts": 1, "max_iterations": 6}))
    assert result.parameter_names == ("p9", "p10", "r3", "v1")
    assert result.information.shape == (4, 4)
    assert list(result.predicted_std.per_period.std) == list(result.parameter_names)
    information = information_of(result, 24)
    assert result.log_det_information == pytest.approx(log_det_of(information), abs=1e-8)
    assert_limits_kept(result)


# --- what cannot be designed ----------------------------------------------------------------------


def rubin(tiny, **design):
    return tiny(
        robot="rubin",
        trajectory={"frequency": ["0.5 mHz", "50 mHz"], "harmonics": 2, "controller_period": 0.1},
        experiment={"sampling": 10},
        design={"starts": 1, **design},
    )


def test_what_the_limits_cannot_excite_is_named_and_the_rest_is_designed(tiny, cheap_finish):
    with pytest.raises(SingularInformationError) as caught:
        expdesign.design(rubin(tiny))
    unexcited = caught.value.unexcited
    names = expdesign.load_robot("rubin").parameter_names
    assert set(unexcited) < set(names)
    assert list(unexcited) == [name for name in names if name in unexcited]
    for name in unexcited:
        assert name in str(caught.value)
    rest = [name for name in names if name not in unexcited]
    result = expdesign.design(rubin(tiny, parameters=rest, max_iterations=5))
    assert result.parameter_names == tuple(rest)
    assert result.passed
    assert np.isfinite(result.log_det_information)
    # What is left is regular, but far from measured: that is said, parameter by parameter.
    (warning,) = (w for w in result.warnings if "not identifiable" in w)
    nominal = dict(zip(names, np.abs(result.robot.parameters), strict=True))
    for name in rest:
        weak = result.experiment.std[name] > nominal[name] / 2
        assert (f" {name} (" in warning) == weak, name
    assert " p1 (" in warning
    # A hundred times the periods reduce a standard deviation to a tenth.
    far = [n for n in rest if result.experiment.std[n] > 10 * nominal[n] / 2]
    enough = warning.partition("periods is enough for ")[2].partition(", hardly excited")[0]
    assert enough == listed(far)


@pytest.mark.parametrize("limit", ["actuator_force", "strut_length"])
def test_limits_that_no_motion_keeps(limit, tiny):
    """Home is within them, by less than a motion needs that excites the parameters."""
    robot = expdesign.load_robot("palida")
    home = robot.home
    rest = np.zeros(6)
    if limit == "actuator_force":
        value = float(np.max(np.abs(robot.actuator_forces(home, rest, rest)))) + 1e-7
    else:
        length = float(robot.inverse_kinematics(home)[0])
        value = [length - 1e-7, length + 1e-7]
    with pytest.raises(SingularInformationError, match="does not excite"):
        expdesign.design(tiny(limits={limit: value}))


def test_one_harmonic_cannot_start_at_rest(tiny):
    with pytest.raises(expdesign.InputError) as caught:
        expdesign.design(tiny(design={"start": "rest"}, trajectory={"harmonics": 1}))
    (problem,) = caught.value.problems
    assert problem.key == "design.start"
    assert "rest" in problem.message


@pytest.mark.slow
def test_a_design_may_start_at_rest(tiny, cheap_finish):
    """One that the search finds from random motions, and by a hop from one of them."""
    search = {"start": "rest", "search": "hopping", "hops": 1, "max_iterations": 40}
    run = tiny(design=search, trajectory={"harmonics": 3})
    result = expdesign.design(run)
    start = result.trajectory.sample(0.0)
    np.testing.assert_allclose(start.rate, 0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(start.acceleration, 0, rtol=0, atol=1e-9)
    assert_limits_kept(result)
    steps = result.trajectory.period / 0.01
    assert steps == pytest.approx(round(steps), abs=1e-6)
    assert -2e-3 < result.check.worst <= TOLERANCE


def test_some_limit_is_needed_beside_those_that_stand_by_default(tiny):
    from expdesign.configuration.robot import load_robot_description

    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    for limits in ({}, {"rotation": "none"}):
        with pytest.raises(expdesign.InputError) as caught:
            expdesign.design(tiny(robot=robot | {"limits": limits}))
        assert [problem.key for problem in caught.value.problems] == ["limits"]


def test_the_noise_is_needed(tiny):
    from expdesign.configuration.robot import load_robot_description

    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    del robot["noise"]
    with pytest.raises(expdesign.InputError) as caught:
        expdesign.design(tiny(robot=robot))
    (problem,) = caught.value.problems
    assert problem.key == "noise"
    assert "force_std" in problem.allowed


class StopsAt:
    """A monitor that asks to stop as soon as a start is in a phase; None: from the beginning."""

    def __init__(self, phase):
        self.phase = phase

    def report(self, event):
        if event.phase == self.phase:
            self.phase = None

    def stop_requested(self):
        return self.phase is None


def test_an_interrupted_search_keeps_the_best_so_far(tiny, cheap_finish):
    result = expdesign.design(tiny(design={"starts": 3}), StopsAt("waiting"))
    assert result.status == "interrupted"
    assert not result.passed
    assert len(result.solver.starts) == 1
    assert_limits_kept(result)


def test_a_search_that_is_stopped_before_it_began_has_no_design(tiny):
    with pytest.raises(StoppedError, match="before any start"):
        expdesign.design(tiny(), StopsAt(None))


def test_a_search_whose_time_is_over_has_a_result(tiny, cheap_finish):
    result = expdesign.design(tiny(design={"starts": 500, "max_seconds": "0.2 s"}))
    assert 1 <= len(result.solver.starts) < 500
    assert result.check.passed


def test_two_workers_without_machine_code_find_a_design(tiny, few_limits, monkeypatch):
    def compile_something(*_arguments):
        raise AssertionError("there is nothing to compile")

    monkeypatch.setenv(SWITCH, "virtual-machine")
    monkeypatch.setattr(setup, "run_jobs", compile_something)
    assert expdesign.design(tiny(robot=few_limits, workers=2, design={"starts": 2})).passed
