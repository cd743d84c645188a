"""The motion from rest to rest, held against the robot's own public functions."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run
from expdesign.experiment.setup import plan_search
from expdesign.motion import planning
from expdesign.motion import ramp_search as ramp_module
from expdesign.motion.executable import moving_states
from expdesign.motion.planning import check_motion, executable_motion
from expdesign.motion.ramp_search import NoRampError
from expdesign.robot import robot_from
from expdesign.solver.feasibility import random_start
from expdesign.trajectory import FourierTrajectory
from tests.motion.conftest import PERIODS, STEP

MACHINES = [
    ("palida", 5),
    pytest.param(("linuxcnc", 5), marks=pytest.mark.slow),
]


@pytest.fixture(params=MACHINES, ids=str)
def machine(request):
    return request.param


def _parts(samples):
    return samples.pose, samples.rate, samples.acceleration


def test_segments_join_up_to_the_acceleration(motion, machine):
    segments = motion(*machine).segments
    assert [segment.name for segment in segments] == ["ramp in", "periods", "ramp out"]
    for before, after in itertools.pairwise(segments):
        left, right = before.sample(np.array([before.duration])), after.sample(np.zeros(1))
        for a, b in zip(_parts(left), _parts(right), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


def test_it_is_the_integral_of_its_own_acceleration(motion, machine):
    """Nothing jumps anywhere: differences of pose and rate agree with rate and acceleration."""
    whole = motion(*machine)
    times = np.linspace(0.0, whole.duration, 40_001)
    step = times[1]
    pose, rate, acceleration = _parts(whole.sample(times))
    trapezoid = step * (rate[1:] + rate[:-1]) / 2
    np.testing.assert_allclose(np.diff(pose, axis=0), trapezoid, atol=1e-3 * np.ptp(pose))
    trapezoid = step * (acceleration[1:] + acceleration[:-1]) / 2
    scale = np.max(np.abs(rate))
    np.testing.assert_allclose(np.diff(rate, axis=0), trapezoid, atol=1e-4 * scale)
    largest = max(
        np.max(np.abs(segment.jerk(np.linspace(0.0, segment.duration, 20_001))))
        for segment in whole.segments
    )
    assert np.max(np.abs(np.diff(acceleration, axis=0))) < 1.2 * step * largest


def test_it_starts_and_ends_at_rest_at_home(motion, machine, configuration):
    whole, home = motion(*machine), configuration(*machine).robot.home
    pose, rate, acceleration = _parts(whole.sample([0.0, whole.duration, -1, whole.duration + 1]))
    np.testing.assert_allclose(pose, np.tile(home, (4, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rate, 0, atol=1e-9)
    np.testing.assert_allclose(acceleration, 0, atol=1e-9)


def test_every_limit_is_kept_over_the_whole_motion(motion, machine, configuration):
    whole = motion(*machine)
    robot = robot_from(configuration(*machine).robot)
    ramps = [
        np.linspace(start, start + segment.duration, 15_013)
        for start, segment in zip(whole.starts[:-1], whole.segments, strict=True)
    ]
    samples = whole.sample(np.concatenate(ramps))
    struts = robot.strut_motion(*_parts(samples))
    measured = {
        "strut_length": struts.length,
        "strut_speed": struts.length_rate,
        "strut_acceleration": struts.length_acceleration,
        "alpha": struts.alpha,
        "beta": struts.beta,
        "actuator_force": robot.actuator_forces(*_parts(samples)),
        "position": samples.pose[:, :3],
    }
    bounds = configuration(*machine).robot.limits
    for key, values in measured.items():
        limit = bounds[key]
        slack = 1e-6 * (limit.upper - limit.lower)
        assert np.all(values >= limit.lower - slack), key
        assert np.all(values <= limit.upper + slack), key


def test_the_recheck_covers_every_limit_and_the_jerk(motion, machine, configuration):
    check = check_motion(configuration(*machine), motion(*machine))
    assert check.passed
    keys = {item.key for item in check.limits}
    assert keys == {*configuration(*machine).robot.limits, "strut_jerk"}
    assert "from rest to rest" in check.method


def test_the_jerk_of_the_struts_is_bounded(motion, machine, configuration):
    """By differences of the struts' acceleration, without the kernel that the search uses."""
    whole = motion(*machine)
    robot = robot_from(configuration(*machine).robot)
    default = configuration(*machine).robot.limits["strut_acceleration"].upper / 0.02
    for start, segment in zip(whole.starts[:-1], whole.segments, strict=True):
        if segment.name == "periods":
            continue
        times = np.linspace(start, start + segment.duration, 5001)
        struts = robot.strut_motion(*_parts(whole.sample(times)))
        jerk = np.diff(struts.length_acceleration, axis=0) / (times[1] - times[0])
        assert np.max(np.abs(jerk) / default) < 1 + 1e-6
        # The shortest ramp uses what it may.
        assert np.max(np.abs(jerk) / default) > 0.5


def test_every_segment_is_a_whole_number_of_controller_steps(motion, machine, orbit):
    whole = motion(*machine)
    steps = whole.steps(STEP)
    assert steps[1] == PERIODS * round(orbit(*machine).period / STEP)
    np.testing.assert_allclose(whole.duration, sum(steps) * STEP, rtol=1e-12)
    with pytest.raises(ValueError, match="ramp in takes"):
        whole.steps(STEP * np.sqrt(2))


def test_the_window_marks_the_designed_periods(motion, machine, orbit):
    whole, designed = motion(*machine), orbit(*machine)
    begin, end = whole.window
    np.testing.assert_allclose(end - begin, PERIODS * designed.period, rtol=1e-12)
    count = round(designed.period / STEP)
    once = designed.sample(designed.sample_times(count))
    rows = whole.sample(begin + STEP * np.arange(PERIODS * count))
    for measured, expected in zip(_parts(rows), _parts(once), strict=True):
        scale = np.maximum(np.max(np.abs(expected)), 1.0)
        np.testing.assert_allclose(
            measured / scale, np.tile(expected, (PERIODS, 1)) / scale, rtol=0, atol=1e-12
        )


def test_the_same_input_gives_the_same_ramp(motion, configuration, orbit):
    first = motion("palida", 5)
    plan = planning._plan(configuration("palida", 5), orbit("palida", 5))
    name, problem = plan.problems(0.0, planning.PIECES)[0]
    again = ramp_module.find_ramp(problem, plan.guesses(problem, 0.0), name, STEP, plan.width)
    assert again.duration == first.segments[0].duration
    np.testing.assert_array_equal(first.segments[0].coefficients, again.coefficients)
    assert first.seconds > 0


@pytest.mark.slow
def test_the_best_phase_is_not_longer(monkeypatch, motion, configuration, orbit, with_motion):
    monkeypatch.setattr(planning, "_PHASES", 2)
    settings = with_motion(configuration("palida", 5), phase="best")
    best = executable_motion(settings, orbit("palida", 5))
    assert check_motion(settings, best).passed
    assert best.duration <= 1.02 * motion("palida", 5).duration
    np.testing.assert_allclose(best.phase / STEP, round(best.phase / STEP), atol=1e-6)
    begin, _ = best.window
    expected = orbit("palida", 5).sample(best.phase).pose
    np.testing.assert_allclose(best.sample(begin).pose, expected, atol=1e-12)


def test_less_jerk_takes_longer(motion, configuration, orbit, with_motion):
    calm = with_motion(configuration("palida", 5), jerk=600.0)
    plan = planning._plan(calm, orbit("palida", 5))
    assert [limit.origin for limit in plan.limits.limits].count("motion.jerk") == 1
    name, problem = plan.problems(0.0, planning.PIECES)[0]
    slow = ramp_module.find_ramp(problem, plan.guesses(problem, 0.0), name, STEP, plan.width)
    assert ramp_module.worst_limit(problem, slow).kept
    states = moving_states(slow, np.linspace(0.0, slow.duration, 5001))
    jerk = plan.limits.values(states)[:, plan.limits.of_jerk]
    assert 0.5 * 600 < np.max(np.abs(jerk)) <= 600 * (1 + 1e-6)
    assert slow.duration > motion("palida", 5).segments[0].duration


@pytest.mark.slow
def test_a_design_at_rest_only_has_to_be_approached():
    run = {
        "name": "rest",
        "robot": "palida",
        "trajectory": {"harmonics": 3, "samples": 50, "controller_period": STEP},
        "design": {"start": "rest"},
        "experiment": {"periods": 2},
    }
    configuration = load_run(run)
    problem = plan_search(configuration).problem
    x = random_start(problem, np.random.default_rng(1), 200, 0.1)
    drawn = problem.variables.trajectory(x)
    omega = 2 * np.pi / (round(drawn.period / STEP) * STEP)
    resting = FourierTrajectory.from_displacements(
        omega, drawn.lambda0, 0.98 * drawn.sine, 0.98 * drawn.cosine
    )
    whole = executable_motion(configuration, resting)
    assert check_motion(configuration, whole).passed
    for segment, time in ((whole.segments[0], whole.segments[0].duration), (whole.segments[2], 0)):
        found = segment.sample(np.array([float(time)]))
        np.testing.assert_allclose(found.rate, 0, atol=1e-9)
        np.testing.assert_allclose(found.acceleration, 0, atol=1e-9)
        np.testing.assert_allclose(found.pose, resting.sample(0.0).pose, atol=1e-12)


def test_where_the_optimisation_is_lost_a_guess_within_the_limits_is_taken(
    monkeypatch, motion, configuration, orbit
):
    def lost(problem, guess, width):
        return ramp_module.RampAttempt(problem.pack(guess), problem, np.inf, "strut_speed")

    monkeypatch.setattr(ramp_module, "shortest", lost)
    designed = orbit("linuxcnc", 5)
    calm = FourierTrajectory(designed.omega, designed.lambda0, 0.5 * designed.mu, 0.5 * designed.nu)
    whole = executable_motion(configuration("linuxcnc", 5), calm)
    assert check_motion(configuration("linuxcnc", 5), whole).passed
    whole.steps(STEP)


def test_a_limit_without_enclosure_is_kept_by_the_ways_and_not_certified():
    """One that is computed by numbers, in a way of its own, and that binds: they are slower."""
    run = {"name": "own", "robot": "palida", "experiment": {"periods": 1}}
    run["trajectory"] = {"harmonics": 1, "samples": 24, "controller_period": 0.01}
    known = load_run(run)
    few = {key: known.robot.limits[key] for key in ("strut_length", "strut_speed")}
    speed, most = few["strut_speed"], 0.03
    own = replace(
        speed.definition,
        smooth=speed.definition.natural,
        numerical=lambda values: np.sort(values, axis=1),
    )
    slow = replace(speed, lower=np.full(6, -most), upper=np.full(6, most), definition=own)
    configuration = replace(known, robot=replace(known.robot, limits={**few, "strut_speed": slow}))
    pose = known.robot.home - np.array([0, 0, 0.05, 0, 0, 0])
    mu = np.zeros((6, 1))
    mu[0] = 0.02
    orbit = FourierTrajectory(np.pi, pose, mu, np.zeros((6, 1)))
    whole = executable_motion(configuration, orbit)
    check = check_motion(configuration, whole)
    assert check.passed
    sampled = [item.key for item in check.limits if not item.certified]
    assert sampled == ["strut_speed"]
    samples = whole.sample(np.linspace(0.0, whole.duration, 20_001))
    speeds = np.abs(robot_from(known.robot).strut_motion(*_parts(samples)).length_rate)
    assert 0.8 * most < np.max(speeds) <= most * (1 + 2e-6)


# --- what is refused ------------------------------------------------------------------------------


def test_a_jerk_below_the_designs_own_is_refused(configuration, orbit, with_motion):
    with pytest.raises(InputError, match="itself has a strut jerk") as refused:
        executable_motion(with_motion(configuration("palida", 5), jerk=10.0), orbit("palida", 5))
    assert refused.value.problems[0].key == "motion.jerk"


def test_a_trajectory_that_breaks_a_limit_is_refused(configuration, orbit):
    designed = orbit("palida", 5)
    larger = FourierTrajectory(
        designed.omega, designed.lambda0, 1.3 * designed.mu, 1.3 * designed.nu
    )
    with pytest.raises(InputError, match="itself breaks this limit"):
        executable_motion(configuration("palida", 5), larger)


def test_a_period_of_broken_steps_is_refused(configuration, orbit):
    designed = orbit("palida", 5)
    broken = FourierTrajectory(0.99997 * designed.omega, designed.lambda0, designed.mu, designed.nu)
    with pytest.raises(InputError, match="controller steps"):
        executable_motion(configuration("palida", 5), broken)


@pytest.mark.slow
def test_where_no_ramp_exists_the_limit_that_binds_is_named(monkeypatch):
    """Strut 1 may not leave home: it has no speed."""
    monkeypatch.setattr(ramp_module, "_ATTEMPTS", 1)
    monkeypatch.setattr(ramp_module, "_ROUNDS_PER_DURATION", 1)
    free = {"name": "stuck", "robot": "palida", "experiment": {"periods": 1}}
    free["trajectory"] = {"harmonics": 1, "frequency": 0.5, "samples": 24}
    free["trajectory"] |= {"frequency": [0.5, 0.5], "controller_period": 0.01}
    robot = robot_from(load_run(free).robot)
    pose = robot.home - np.array([0, 0, 0.05, 0, 0, 0])
    bounds = [[-1e-6, 1e-6], *[[-2.0, 2.0]] * 5]
    tight = load_run({**free, "limits": {"strut_speed": bounds}})
    still = FourierTrajectory(np.pi, pose, np.zeros((6, 1)), np.zeros((6, 1)))
    with pytest.raises(NoRampError, match="no ramp in was found") as refused:
        executable_motion(tight, still)
    assert refused.value.limit == "strut_speed"
    assert "motion.phase: best" in str(refused.value)
