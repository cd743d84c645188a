"""A motion as data: what was found once is the same when it is read again."""

import json

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.motion import check_motion, motion_from_record, motion_to_record
from tests.estimation.cases import ROBOT, trajectory
from tests.export.motions import DESIGNED, motion_of, spline_motion_of, task


def test_it_is_the_same_motion_to_the_last_digit():
    motion = spline_motion_of(ROBOT, trajectory(), 3, phase=0.2)
    again = motion_from_record(json.loads(json.dumps(motion_to_record(motion))), trajectory())
    assert again.window == motion.window
    assert [s.name for s in again.segments] == ["ramp in", "periods", "ramp out"]
    times = np.linspace(-0.1, motion.duration + 0.1, 700)
    for part in ("pose", "rate", "acceleration"):
        np.testing.assert_array_equal(
            getattr(again.sample(times), part), getattr(motion.sample(times), part)
        )
    np.testing.assert_array_equal(again.jerk(times), motion.jerk(times))


def test_ramps_of_another_kind_are_not_recorded():
    assert motion_to_record(motion_of(ROBOT, trajectory())) is None


def test_ramps_into_another_design_are_refused():
    record = motion_to_record(spline_motion_of(ROBOT, trajectory()))
    with pytest.raises(ValueError, match="do not lead into the designed motion"):
        motion_from_record(record, trajectory(seed=7))


@pytest.mark.parametrize(
    "change",
    [
        lambda record: record.pop("phase"),
        lambda record: record.update(phase=-1),
        lambda record: record.update(periods=0),
        lambda record: record.update(periods=float("inf")),
        lambda record: record.update(ramps=None),
        lambda record: record["ramps"].pop(),
        lambda record: record["ramps"][0].update(duration=0),
        lambda record: record["ramps"][0].update(duration="long"),
        lambda record: record["ramps"][1]["control_points"].pop(),
        lambda record: record["ramps"][1]["control_points"][2].pop(),
        lambda record: record["ramps"][1]["control_points"][2].__setitem__(3, None),
        lambda record: record["ramps"][1]["control_points"][2].__setitem__(3, 0.7),
    ],
)
def test_what_is_no_record(change):
    record = json.loads(json.dumps(motion_to_record(spline_motion_of(ROBOT, trajectory()))))
    change(record)
    with pytest.raises(ValueError, match=r"."):
        motion_from_record(record, trajectory())


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
