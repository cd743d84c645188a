"""A motion as data: what was found once is the same when it is read again."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.motion.executable import ExecutableMotion, Periods, lead_ramps
from expdesign.motion.planning import PIECES, check_motion
from expdesign.motion.ramp import MotionState, SplineRamp, end_coefficients, reversed_in_time
from tests.estimation.cases import ROBOT, trajectory
from tests.export.motions import DESIGNED, motion_of, recorded, spline_motion_of, task


def record_of(motion):
    """Return what a file says of a motion."""
    found = lead_ramps(motion)
    return found and json.loads(json.dumps(asdict(found)))


def recorded_motion(data, orbit, home):
    return recorded(data).motion(orbit, home)


def test_it_is_the_same_motion_to_the_last_digit():
    motion = spline_motion_of(ROBOT, trajectory(), 3, phase=0.2)
    again = recorded_motion(record_of(motion), trajectory(), ROBOT.home)
    assert again.window == motion.window
    assert [s.name for s in again.segments] == ["ramp in", "periods", "ramp out"]
    times = np.linspace(-0.1, motion.duration + 0.1, 700)
    for part in ("pose", "rate", "acceleration"):
        np.testing.assert_array_equal(
            getattr(again.sample(times), part), getattr(motion.sample(times), part)
        )
    for segment, other in zip(again.segments, motion.segments, strict=True):
        inside = np.linspace(0.0, segment.duration, 200)
        np.testing.assert_array_equal(segment.jerk(inside), other.jerk(inside))


def _way(name, start, end, duration):
    """The polynomial of fifth order between two states."""
    first, _ = end_coefficients(1, duration, start)
    last, _ = end_coefficients(1, duration, reversed_in_time(end))
    return SplineRamp(name, duration, np.concatenate([first, last[::-1]]))


def _with_pauses(orbit, *, apart=0.0):
    """A motion that pauses at rest on its way in and out; `apart` from where it goes on, m."""
    home, joined = MotionState.at_rest(ROBOT.home), MotionState.of(orbit.sample(0.0))
    pause = MotionState.at_rest(ROBOT.home + 1e-3)
    other = MotionState.at_rest(pause.pose + apart)
    segments = (
        _way("approach", home, pause, 1.0),
        _way("ramp in", other, joined, 0.5),
        Periods(orbit, 2),
        _way("ramp out", joined, pause, 0.5),
        _way("return", pause, home, 1.0),
    )
    return ExecutableMotion(segments, orbit, 2)


def test_a_motion_with_pauses_is_the_same_to_the_last_digit():
    motion = _with_pauses(trajectory())
    again = recorded_motion(record_of(motion), trajectory(), ROBOT.home)
    assert [s.name for s in again.segments] == [s.name for s in motion.segments]
    times = np.linspace(0, motion.duration, 500)
    np.testing.assert_array_equal(again.sample(times).pose, motion.sample(times).pose)


def test_ways_that_do_not_meet_are_refused():
    record = record_of(_with_pauses(trajectory(), apart=1e-4))
    with pytest.raises(ValueError, match="'ramp in' does not begin where 'approach' ends"):
        recorded_motion(record, trajectory(), ROBOT.home)


@pytest.mark.parametrize("before", [0, 4, -1])
def test_periods_before_or_after_all_ways_are_refused(before):
    record = record_of(_with_pauses(trajectory())) | {"before": before}
    with pytest.raises(ValueError, match="lead into the designed motion"):
        recorded_motion(record, trajectory(), ROBOT.home)


def test_ramps_of_another_kind_are_not_recorded():
    assert record_of(motion_of(ROBOT, trajectory())) is None


def test_ramps_into_another_design_are_refused():
    record = record_of(spline_motion_of(ROBOT, trajectory()))
    with pytest.raises(ValueError, match="do not lead into the designed motion"):
        recorded_motion(record, trajectory(seed=7), ROBOT.home)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda record: record.pop("phase"), "phase\n"),
        (lambda record: record.update(phase=-1), "as many periods"),
        (lambda record: record.update(periods=0), "as many periods"),
        (lambda record: record.update(periods=10**400), "as many periods"),
        (lambda record: record.update(periods=float("inf")), "periods\n"),
        (lambda record: record.update(periods=1.9), "periods\n"),
        (lambda record: record.update(periods=True), "periods\n"),
        (lambda record: record.update(periods="1"), "periods\n"),
        (lambda record: record["ramps"][0].update(name="periods"), "the name 'periods'"),
        (lambda record: record.update(ramps=None), "ramps\n"),
        (lambda record: record["ramps"].pop(), "no ramps lead into"),
        (lambda record: record["ramps"][0].update(duration=0), "not finite"),
        (lambda record: record["ramps"][0].update(duration="long"), "duration\n"),
        (lambda record: record["ramps"][1]["control_points"].pop(), "5 control points"),
        (lambda record: record["ramps"][1]["control_points"][2].pop(), "other than 6 coordinates"),
        (
            lambda record: record["ramps"][1]["control_points"][2].__setitem__(3, None),
            "control_points",
        ),
        (
            lambda record: record["ramps"][1]["control_points"][2].__setitem__(3, 0.7),
            "do not lead into the designed motion",
        ),
    ],
)
def test_what_is_no_record(change, said):
    record = record_of(spline_motion_of(ROBOT, trajectory()))
    change(record)
    with pytest.raises(ValueError, match=said):
        recorded_motion(record, trajectory(), ROBOT.home)


@pytest.mark.parametrize("point", range(6))
@pytest.mark.parametrize("ramp", [0, 1])
def test_every_control_point_at_an_end_counts(ramp, point):
    """Three at each end are pose, rate and acceleration there: of the orbit, or at rest at home."""
    record = record_of(spline_motion_of(ROBOT, trajectory()))
    at_home = (point < 3) == (ramp == 0)
    record["ramps"][ramp]["control_points"][point][2] += 1e-6
    expected = "begin and end at rest at home" if at_home else "lead into the designed motion"
    with pytest.raises(ValueError, match=expected):
        recorded_motion(record, trajectory(), ROBOT.home)


def test_ramps_from_another_home_are_refused():
    record = record_of(spline_motion_of(ROBOT, trajectory()))
    with pytest.raises(ValueError, match="at rest at home"):
        recorded_motion(record, trajectory(), ROBOT.home + 1e-6)


@pytest.mark.parametrize("duration", [0.003, 0.05, 3.0, 40.0])
def test_long_and_short_ramps_are_taken_again(duration):
    """The last digits of control points are much speed in a short ramp."""
    orbit = trajectory()
    ends = MotionState.at_rest(ROBOT.home), MotionState.of(orbit.sample(0.0))
    ramps = []
    for name, start, end in (("ramp in", *ends), ("ramp out", *ends[::-1])):
        first, _ = end_coefficients(PIECES, duration, start)
        last, _ = end_coefficients(PIECES, duration, reversed_in_time(end))
        between = np.linspace(start.pose, end.pose, PIECES - 1)
        points = np.concatenate([first, between, last[::-1]])
        ramps.append(SplineRamp(name, duration, points))
    motion = ExecutableMotion((ramps[0], Periods(orbit, 1), ramps[1]), orbit, 1)
    record = record_of(motion)
    assert recorded_motion(record, orbit, ROBOT.home).duration == motion.duration


@pytest.mark.parametrize("duration", [1e-10, 9e-4, 2e-3, 1.0])
def test_ramps_that_stand_still_do_not_lead_into_a_motion_that_passes_home(duration):
    orbit = trajectory()
    home = orbit.sample(0.0).pose[0]
    assert np.max(np.abs(orbit.sample(0.0).rate)) > 0.01
    still = [SplineRamp(name, duration, np.tile(home, (PIECES + 5, 1))) for name in ("in", "out")]
    record = record_of(ExecutableMotion((still[0], Periods(orbit, 1), still[1]), orbit, 1))
    with pytest.raises(ValueError, match="ramp"):
        recorded_motion(record, orbit, home)


def test_the_motion_of_a_real_design_keeps_every_limit():
    """Of LinuxCNC's robot with 12 harmonics: the tests of the exports run it."""
    configuration = load_run({"name": "designed", "robot": "linuxcnc"})
    motion = task(*DESIGNED).motion
    check = check_motion(configuration, motion)
    assert check.passed
    # It is a design and no timid orbit: a limit is used up.
    assert check.worst > -1e-3
    assert motion.trajectory.harmonics == 12
    motion.steps(1e-3)
