"""Rows before and after the periods: they are left out, or `data.start` is named."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.identification.periods import UnsuitableDataError, choose_omega, leave_out_ramps
from estimation.processing.period import find_motion_onset
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory

MOTION = trajectory()
DATA = measured(MOTION)


def after_rest(rows, data=DATA):
    """Return a recording that begins so many rows before the motion."""
    still = data.lengths[0] + 1e-4 * np.random.default_rng(1).standard_normal((rows, 6))
    forces = np.repeat(data.forces[:1], rows, axis=0)
    time = np.arange(rows + len(data)) * STEP
    lengths = np.vstack([still, data.lengths])
    return replace(data, time=time, lengths=lengths, forces=np.vstack([forces, data.forces]))


@pytest.mark.parametrize("rows", [40, 130, 700])
def test_the_begin_of_the_motion(rows):
    assert find_motion_onset(after_rest(rows)) == pytest.approx(rows * STEP, abs=4 * STEP)


def test_a_motion_from_its_first_row_on_has_none():
    assert find_motion_onset(DATA) is None
    for begin in range(0, 200, 9):
        part = slice(begin, None)
        own = {name: getattr(DATA, name)[part] for name in ("time", "lengths", "forces")}
        assert find_motion_onset(replace(DATA, **own)) is None


@pytest.mark.parametrize("stride", [1, 4, 10])
def test_one_period_that_moves_from_its_first_row_on_has_none(stride):
    for begin in range(0, 200, 9):
        rows = np.arange(begin, begin + 200, stride)
        own = {"lengths": DATA.lengths[rows], "forces": DATA.forces[rows]}
        time = STEP * stride * np.arange(len(rows))
        assert find_motion_onset(replace(DATA, time=time, **own)) is None


@pytest.mark.parametrize("power", [2, 3, 5])
def test_a_smooth_begin_is_motion(power):
    """From rest with a jump of the acceleration, of the jerk, and smoother still."""
    share = np.minimum(np.arange(len(DATA)) / 400, 1.0) ** power
    lengths = ROBOT.inverse_kinematics(ROBOT.home) + share[:, None] * np.linspace(0.03, 0.1, 6)
    assert find_motion_onset(replace(DATA, lengths=lengths)) is None


def test_a_rest_in_every_period_is_part_of_it():
    still = np.repeat(DATA.lengths[:1], 80, axis=0)
    periods = [part for one in np.split(DATA.lengths, 5) for part in (still, one)]
    lengths = np.vstack(periods)
    time = np.arange(len(lengths)) * STEP
    assert find_motion_onset(replace(DATA, time=time, lengths=lengths, forces=0 * lengths)) is None


def test_a_period_that_is_refused_names_the_start():
    """Rest for longer than the motion: the lengths do not repeat."""
    data = after_rest(700)
    short = replace(
        data, time=data.time[:1050], lengths=data.lengths[:1050], forces=data.forces[:1050]
    )
    with pytest.raises(UnsuitableDataError) as caught:
        choose_omega(run(), short, None)
    assert "data.start: 3.5" in caught.value.problems[0].allowed


def with_ramps(rest, lead):
    """Return five periods with a rest, a smooth lead-in and lead-out, of so many rows each."""
    rows = np.arange(-rest - lead, len(DATA) + lead + rest)
    share = np.clip(np.minimum(rows + lead, len(DATA) + lead - rows) / lead, 0, 1)
    fade = (share**3 * (10 - 15 * share + 6 * share**2))[:, None]
    moved = DATA.lengths[:200].mean(axis=0), DATA.forces[:200].mean(axis=0)
    lengths, forces = (
        middle + fade * (values[rows % len(DATA)] - middle)
        for middle, values in zip(moved, (DATA.lengths, DATA.forces), strict=True)
    )
    return replace(DATA, time=np.arange(len(rows)) * STEP, lengths=lengths, forces=forces)


@pytest.mark.parametrize(("rest", "lead"), [(0, 120), (90, 70), (400, 180)])
def test_lead_in_and_lead_out_are_left_out(rest, lead):
    found = leave_out_ramps(run(), with_ramps(rest, lead), MOTION)
    assert len(found) == len(DATA)
    assert found.time[0] == pytest.approx((rest + lead) * STEP, abs=0.05 * 200 * STEP)
    assert "`data.start: " in found.warnings[-1]


def test_periods_alone_are_all_in_use():
    for part in (slice(None), slice(37, 930)):
        own = {name: getattr(DATA, name)[part] for name in ("time", "lengths", "forces")}
        data = replace(DATA, **own)
        assert leave_out_ramps(run(), data, MOTION) is data
