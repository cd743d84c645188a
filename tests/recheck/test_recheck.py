import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from constraints import Limit, limit_definitions
from expdesign.configuration.limits import row_labels
from expdesign.recheck.certificate import CLOSE, recheck
from expdesign.recheck.limit_check import TOLERANCE, grid_points, states_at, worst_sampled
from expdesign.robot import LimitModel, Robot, load_robot
from expdesign.trajectory import FourierTrajectory, PoseSamples

SAMPLES = 50
_SIDES = (0.0, -1e-9, 1e-9)
"""s, just before and after a moment."""
INF = np.inf


@pytest.fixture(scope="module")
def palida():
    return load_robot("palida")


@pytest.fixture(scope="module")
def motion(palida):
    """A generic motion whose extremes are between the points of any grid."""
    rng = np.random.default_rng(2)
    reach = np.array([0.06, 0.06, 0.05, 0.1, 0.1, 0.3])[:, None]
    return FourierTrajectory.from_displacements(
        2.9, palida.home, *(reach * rng.normal(size=(2, 6, 5)) / 3)
    )


def _limit(key, lower=-INF, upper=INF, origin="test"):
    definition = limit_definitions()[key]
    labels = row_labels(definition)
    lower, upper = (np.broadcast_to(side, len(labels)).astype(float) for side in (lower, upper))
    return Limit(definition, lower, upper, labels, origin)


def _model(robot, *limits):
    return LimitModel(robot, limits)


def _value(robot, trajectory, limit, row):
    """The quantity of one row as a function of time, or of many times."""
    model = _model(robot, limit)

    def function(time):
        values = model.values(states_at(trajectory, np.atleast_1d(time)))[:, row]
        return values if np.ndim(time) else float(values[0])

    return function


def _true_maximum(function, trajectory, points=400):
    """Time and value of the largest value of a smooth function over the period."""
    times = trajectory.period * np.arange(points) / points
    best = times[np.argmax(function(times))]
    step = trajectory.period / points
    found = minimize_scalar(
        lambda t: -function(t),
        bounds=(best - step, best + step),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return found.x % trajectory.period, -found.fun


def _on_grid(robot, trajectory, limit):
    """Largest value of every row on the grid of the recheck."""
    times = trajectory.sample_times(grid_points(SAMPLES))
    return np.max(_model(robot, limit).values(states_at(trajectory, times)), axis=0)


# --- the grid -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("samples", "points"), [(1, 4000), (50, 4000), (200, 4000), (201, 4020), (1000, 20000)]
)
def test_the_grid_is_twenty_times_finer(samples, points):
    assert grid_points(samples) == points


def test_states_are_side_by_side(motion):
    states = states_at(motion, np.array([0.1, 0.2, 0.3]))
    samples = motion.sample([0.1, 0.2, 0.3])
    assert states.shape == (3, 18)
    np.testing.assert_array_equal(states[:, :6], samples.pose)
    np.testing.assert_array_equal(states[:, 6:12], samples.rate)
    np.testing.assert_array_equal(states[:, 12:], samples.acceleration)


# --- values, rows and times -----------------------------------------------------------------------


def test_worst_values_are_those_of_the_motion(palida, motion):
    """By the robot's own functions on a grid, limit by limit."""
    found = {check.key: check for check in recheck(_model(palida, *palida.limits), motion).limits}
    assert list(found) == [limit.key for limit in palida.limits]
    times = motion.sample_times(4000)
    samples = motion.sample(times)
    states = samples.pose, samples.rate, samples.acceleration
    struts = palida.strut_motion(*states)
    for key, values in (
        ("strut_length", struts.length),
        ("strut_speed", struts.length_rate),
        ("strut_acceleration", struts.length_acceleration),
        ("alpha", struts.alpha),
        ("beta", struts.beta),
        ("actuator_force", palida.actuator_forces(*states)),
        ("position", samples.pose[:, :3]),
    ):
        limit = next(limit for limit in palida.limits if limit.key == key)
        violations = limit.violation(values)
        check = found[key]
        assert check.violation >= np.max(violations)
        assert check.violation == pytest.approx(np.max(violations), abs=1e-3)
        row = limit.labels.index(check.row)
        k = int(np.argmax(violations[:, row]))
        apart = abs(check.time - times[k])
        assert min(apart, motion.period - apart) < 2 * motion.period / 4000
        assert check.bound in (limit.lower[row], limit.upper[row])
        assert (check.origin, check.unit) == (limit.origin, limit.unit)
        assert check.title == limit.definition.title


def test_value_time_and_violation_belong_together(palida, motion):
    model = _model(palida, *palida.limits)
    for check in recheck(model, motion).limits:
        assert 0 <= check.time < motion.period
        limit = next(limit for limit in palida.limits if limit.key == check.key)
        row = limit.labels.index(check.row)
        assert check.violation == limit.violation_of(row, check.value)
        assert check.bound == limit.nearest_bound(row, check.value)
        function = _value(palida, motion, limit, row)
        # Where a rate turns, the force jumps: both sides of that moment count.
        here = [function(check.time + side) for side in _SIDES]
        assert min(abs(value - check.value) for value in here) < 1e-6 * abs(check.value)


@pytest.mark.parametrize("strut", range(6))
def test_the_right_strut_and_side(strut, palida, motion):
    """Only one strut's bound is tight, and only on one side."""
    limit = _limit("strut_speed", -50, 50)
    speed = _value(palida, motion, limit, strut)
    for sign in (1, -1):
        time, peak = _true_maximum(lambda t, s=sign: s * speed(t), motion)
        lower, upper = np.full(6, -50.0), np.full(6, 50.0)
        (upper if sign > 0 else lower)[strut] = sign * 0.9 * peak
        (check,) = recheck(
            _model(palida, dataclasses.replace(limit, lower=lower, upper=upper)), motion
        ).limits
        assert check.row == f"strut {strut + 1}"
        assert check.value == pytest.approx(sign * peak, rel=1e-9)
        assert check.bound == pytest.approx(sign * 0.9 * peak)
        assert check.violation == pytest.approx(0.1 * peak / (50 + 0.9 * peak), rel=1e-6)
        assert check.time == pytest.approx(time, abs=1e-4)


def test_pairs_of_struts(palida, motion):
    limit = _limit("strut_clearance", 0.0, INF)
    clear = _on_grid_smallest(palida, motion, limit)
    closest = int(np.argmin(clear))
    (check,) = recheck(_model(palida, limit), motion).limits
    lower = np.full(15, 1e-3)
    lower[closest] = clear[closest] + 0.01
    broken = dataclasses.replace(limit, lower=lower)
    (check,) = recheck(_model(palida, broken), motion).limits
    assert check.row == limit.labels[closest]
    assert check.violation > 0
    # The same pair left open, as one that shares a joint.
    lower[closest] = -INF
    (check,) = recheck(_model(palida, dataclasses.replace(limit, lower=lower)), motion).limits
    assert check.row != limit.labels[closest]


def _on_grid_smallest(robot, trajectory, limit):
    times = trajectory.sample_times(grid_points(SAMPLES))
    return np.min(_model(robot, limit).values(states_at(trajectory, times)), axis=0)


# --- between the points ---------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["strut_length", "strut_speed", "strut_acceleration", "tilt"])
def test_a_violation_between_the_points_of_the_grid(key, palida, motion):
    limit = _limit(key)
    peaks = _on_grid(palida, motion, limit)
    row = int(np.argmax(peaks))
    time, peak = _true_maximum(_value(palida, motion, limit, row), motion)
    assert peak > peaks[row] * (1 + 1e-14)
    # Planted: no point of the grid breaks it, the motion does.
    bound = (peaks[row] + peak) / 2
    planted = _limit(key, upper=bound)
    times = motion.sample_times(grid_points(SAMPLES))
    model = _model(palida, planted)
    assert np.max(model.violations(states_at(motion, times))) < 0
    (check,) = recheck(model, motion).limits
    assert check.violation > 0
    assert check.value == pytest.approx(peak, rel=1e-9)
    assert check.proved >= (peak - bound) / abs(bound)
    assert check.row == planted.labels[row]
    assert check.time == pytest.approx(time, abs=1e-4)


def test_a_violation_at_the_seam_of_the_period(palida):
    """The worst moment is just before t = 0, where the grid has ended."""
    sine, cosine = np.zeros((6, 1)), np.zeros((6, 1))
    step = 2 * np.pi / grid_points(SAMPLES)
    sine[0], cosine[0] = 0.05 * np.sin(-0.4 * step), 0.05 * np.cos(-0.4 * step)
    trajectory = FourierTrajectory.from_displacements(3.0, palida.home, sine, cosine)
    planted = _limit("position", upper=[0.05 * (1 - 1e-9 * step), INF, INF])
    (check,) = recheck(_model(palida, planted), trajectory).limits
    assert check.row == "x"
    assert check.value == pytest.approx(0.05, rel=1e-13)
    assert check.violation > 0
    assert check.time == pytest.approx(trajectory.period - 0.4 * step / 3, rel=1e-6)


def _turning_points(speed, period, points=2000):
    """Times at which a speed changes its sign."""
    times = np.linspace(0, period, points + 1)
    values = speed(times)
    return [
        brentq(speed, a, b, xtol=1e-15)
        for a, b, p, q in zip(times[:-1], times[1:], values[:-1], values[1:], strict=True)
        if p * q < 0
    ]


@pytest.fixture(scope="module")
def sticky(palida):
    """PaLiDA with so much dry friction in the actuators that the jumps are the extremes."""
    friction = {f"r{j}": 60.0 for j in range(1, 7)} | {f"v{j}": 0.0 for j in range(1, 7)}
    parameters = palida.description.parameters | friction | {"r_alpha": 0.0, "r_beta": 0.0}
    return Robot(dataclasses.replace(palida.description, parameters=parameters))


@pytest.mark.parametrize("strut", range(6))
def test_jumps_of_dry_friction(strut, sticky, motion):
    """The force is largest just before or after its strut turns: its limit from one side."""
    limit = _limit("actuator_force", -1e4, 1e4)
    force = _value(sticky, motion, limit, strut)
    speed = _value(sticky, motion, _limit("strut_speed"), strut)
    turns = _turning_points(speed, motion.period)
    assert len(turns) >= 2
    inner = _true_maximum(force, motion, points=4000)[1]
    sides = {t + side: force(t + side) for t in turns for side in (-1e-10, 1e-10)}
    time, peak = max(sides.items(), key=lambda item: item[1])
    on_grid = _on_grid(sticky, motion, limit)[strut]
    lower, upper = np.full(6, -1e4), np.full(6, 1e4)
    upper[strut] = (on_grid + max(peak, inner)) / 2
    planted = dataclasses.replace(limit, lower=lower, upper=upper)
    (check,) = recheck(_model(sticky, planted), motion).limits
    assert check.row == f"strut {strut + 1}"
    assert check.proved > 0
    assert check.violation > -CLOSE
    assert check.value == pytest.approx(max(peak, inner), abs=CLOSE * limit.range[strut])
    if peak > inner + 1e-6:
        assert check.time == pytest.approx(time % motion.period, abs=1e-6)


def test_the_unsmoothed_force_is_checked(sticky, motion):
    (check,) = recheck(_model(sticky, _limit("actuator_force", -1e4, 1e4)), motion).limits
    row = int(check.row.split()[1]) - 1
    sample = motion.sample(check.time + np.array(_SIDES))
    forces = sticky.actuator_forces(*sample)[:, row]
    assert np.min(np.abs(forces - check.value)) < 1e-6 * abs(check.value)


# --- every row and every peak ---------------------------------------------------------------------


def test_a_row_that_is_second_on_the_grid_may_be_first_between(palida):
    """x is worse on the grid, y is worse between its points."""
    step = 2 * np.pi / grid_points(SAMPLES)
    n, size = 10, 0.02
    sine, cosine = np.zeros((6, n)), np.zeros((6, n))
    # x has its peak on a point of the grid; y, ten times faster, all of its midway.
    cosine[0, 0] = size
    sine[1, -1], cosine[1, -1] = size * np.sin(n * step / 2), size * np.cos(n * step / 2)
    trajectory = FourierTrajectory.from_displacements(3.0, palida.home, sine, cosine)
    missed = size * (1 - np.cos(n * step / 2))
    upper = [size + missed / 8, size - missed / 2, INF]
    model = _model(palida, _limit("position", upper=upper))
    states = states_at(trajectory, trajectory.sample_times(grid_points(SAMPLES)))
    on_grid = np.max(model.violations(states), axis=0)
    assert on_grid[1] < on_grid[0] < 0
    result = recheck(model, trajectory)
    assert result.limits[0].row == "y"
    assert result.worst == pytest.approx(missed / 2 / size, rel=1e-3)
    assert not result.passed


def test_peaks_that_are_second_on_the_grid_may_be_first_between(palida):
    """x has twelve peaks: four on points of the grid, four higher ones a third of a step off."""
    step = 2 * np.pi / grid_points(SAMPLES)
    size = 0.02
    missed = size * (1 - np.cos(12 * step / 3))
    lift = missed / 3
    cosine, sine = np.zeros((6, 12)), np.zeros((6, 12))
    cosine[0, 11] = size
    cosine[0, 3], sine[0, 3] = lift * np.cos(np.pi * 2 / 3), lift * np.sin(np.pi * 2 / 3)
    trajectory = FourierTrajectory.from_displacements(3.0, palida.home, sine, cosine)
    upper = size + lift / 2
    model = _model(palida, _limit("position", upper=[upper, INF, INF]))
    states = states_at(trajectory, trajectory.sample_times(grid_points(SAMPLES)))
    assert np.max(model.violations(states)) < 0
    (check,) = recheck(model, trajectory).limits
    assert check.value == pytest.approx(size + lift, abs=lift / 100)
    assert check.violation > TOLERANCE


def test_a_jump_of_a_row_that_is_second_on_the_grid(sticky, motion):
    """Two struts turn; the grid comes close to the jump of one and misses that of the other."""
    limit = _limit("actuator_force", -1e4, 1e4)
    on_grid = _on_grid(sticky, motion, limit)
    peaks = np.empty(6)
    for strut in range(6):
        force = _value(sticky, motion, limit, strut)
        speed = _value(sticky, motion, _limit("strut_speed"), strut)
        turns = _turning_points(speed, motion.period)
        peaks[strut] = max(force(t + side) for t in turns for side in (-1e-10, 1e-10))
    gaps = peaks - on_grid
    smooth, jumping = int(np.argmin(gaps)), int(np.argmax(gaps))
    assert gaps[smooth] < 0 < gaps[jumping]
    upper = np.full(6, 1e4)
    upper[smooth] = on_grid[smooth] + gaps[jumping] / 20
    upper[jumping] = peaks[jumping] - gaps[jumping] / 2
    model = _model(sticky, _limit("actuator_force", upper=upper))
    states = states_at(motion, motion.sample_times(grid_points(SAMPLES)))
    found = np.max(model.violations(states), axis=0)
    assert found[jumping] < found[smooth] < 0
    result = recheck(model, motion)
    assert result.limits[0].row == f"strut {jumping + 1}"
    assert result.worst == pytest.approx(gaps[jumping] / 2 / upper[jumping], rel=0.05)
    assert not result.passed


# --- the verdict ----------------------------------------------------------------------------------


def test_verdict(palida, motion):
    limit = _limit("strut_speed")
    row = int(np.argmax(_on_grid(palida, motion, limit)))
    _, peak = _true_maximum(_value(palida, motion, limit, row), motion)
    for excess, passed in ((-1e-3, True), (0.5 * TOLERANCE, True), (2 * TOLERANCE, False)):
        # One-sided: shares of |bound|.
        result = recheck(_model(palida, _limit("strut_speed", upper=peak / (1 + excess))), motion)
        assert result.worst == pytest.approx(excess, rel=1e-4)
        assert result.passed is passed


def test_worst_of_several_limits(palida, motion):
    loose, tight = _limit("strut_speed", -100, 100), _limit("strut_length", upper=0.3)
    result = recheck(_model(palida, loose, tight), motion)
    assert [check.key for check in result.limits] == ["strut_speed", "strut_length"]
    assert result.limits[0].violation < 0 < result.limits[1].violation
    assert result.worst == result.limits[1].violation
    assert not result.passed


def test_no_limits(palida, motion):
    result = recheck(_model(palida), motion)
    assert result.limits == ()
    assert result.worst == -INF
    assert result.passed


def test_method_says_what_was_done(palida, motion):
    result = recheck(_model(palida, _limit("tilt", upper=1.0)), motion)
    assert result.certified
    assert str(result.limits[0].cells) in result.method


def test_a_limit_without_enclosure_is_sampled_and_not_certified(palida, motion):
    """One that is computed by numbers, in a way of its own."""
    speed = _limit("strut_speed", -2, 2)
    own = dataclasses.replace(
        speed.definition, key="own", numerical=np.abs, smooth=speed.definition.natural
    )
    unknown = dataclasses.replace(speed, definition=own)
    first, second = recheck(_model(palida, unknown, speed), motion).limits
    assert (first.key, second.key) == ("own", "strut_speed")
    assert second.certified
    assert not first.certified
    assert np.isnan(first.proved)
    assert first.possible == first.violation
    assert second.possible == second.proved > second.violation
    assert abs(first.value) == pytest.approx(abs(second.value), rel=1e-3)


def test_a_value_that_is_not_a_number_counts_as_broken(palida):
    """The TCP on a base joint: a strut without length has no direction."""
    robot = Robot(
        dataclasses.replace(palida.description, platform_joints=palida.description.base_joints)
    )
    still = FourierTrajectory(1.0, np.zeros(6), np.zeros((6, 1)), np.zeros((6, 1)))
    result = recheck(_model(robot, _limit("alpha", -1, 1)), still)
    assert not result.passed


# --- motions that do not repeat -------------------------------------------------------------------


class _Climb:
    """A platform that rises from home at one speed; what lies outside of its time is far away."""

    def __init__(self, home, speed, duration):
        self.home, self.speed, self.duration = home, speed, duration

    def sample(self, times):
        pose = np.tile(self.home, (len(times), 1))
        pose[:, 2] += self.speed * times
        outside = (times < 0) | (times > self.duration)
        pose[outside, 2] += 1.0
        rate = np.zeros_like(pose)
        rate[:, 2] = self.speed
        return PoseSamples(pose, rate, np.zeros_like(pose))


@pytest.mark.parametrize("speed", [0.1, -0.1])
def test_a_motion_that_does_not_repeat_is_checked_up_to_both_ends(palida, speed):
    upper = palida.home[2] + (0.04 if speed > 0 else -0.01)
    limit = _limit("position", lower=[-1, -1, -1], upper=[1, 1, upper])
    climb = _Climb(palida.home, speed, 0.5)
    times = np.linspace(0, 0.5, 101)
    model = _model(palida, limit)
    (check,) = worst_sampled(model, times, model.values(states_at(climb, times)))
    assert check.row == "z"
    assert check.time == (0.5 if speed > 0 else 0.0)
    assert check.value == pytest.approx(palida.home[2] + (0.05 if speed > 0 else 0), abs=1e-15)
    assert check.violation == pytest.approx(0.01 / (upper + 1))
