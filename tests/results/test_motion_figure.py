import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.configuration import load_run
from expdesign.motion.executable import ExecutableMotion, Periods
from expdesign.motion.ramp import (
    MotionState,
    SplineRamp,
    end_coefficients,
    reversed_in_time,
)
from expdesign.robot import load_robot
from expdesign.trajectory import FourierTrajectory
from results.figures.drawing import house_style, save_figures
from results.figures.motion import RestToRestMotion, motion_figure

STEP = 0.01


@pytest.fixture(scope="module")
def record():
    home = load_robot("palida").home
    rng = np.random.default_rng(0)
    orbit = FourierTrajectory.from_displacements(
        2 * np.pi / 2, home, *(0.01 * rng.normal(size=(2, 6, 2)))
    )
    rest, moving = MotionState.at_rest(home), MotionState.of(orbit.sample(0.0))

    def ramp(name, start, end):
        first, _ = end_coefficients(1, 0.5, start)
        last, _ = end_coefficients(1, 0.5, reversed_in_time(end))
        return SplineRamp(name, 0.5, np.concatenate([first, last[::-1]]))

    segments = (ramp("ramp in", rest, moving), Periods(orbit, 3), ramp("ramp out", moving, rest))
    motion = ExecutableMotion(segments, orbit, 3)
    run = {"name": "n", "robot": "palida", "trajectory": {"controller_period": STEP}}
    return RestToRestMotion(load_run(run), motion)


def test_the_record_is_at_the_controllers_steps(record):
    np.testing.assert_allclose(np.diff(record.motion.time), STEP)
    np.testing.assert_allclose(record.motion.time[-1], record.executable.starts[-1])
    names = [segment.name for segment in record.executable.segments]
    assert names == ["ramp in", "periods", "ramp out"]
    np.testing.assert_allclose(record.motion.speed[[0, -1]], 0, atol=1e-12)
    difference = (record.motion.length[2:] - record.motion.length[:-2]) / (2 * STEP)
    np.testing.assert_allclose(difference, record.motion.speed[1:-1], atol=2e-3)
    assert {limit.key for limit in record.robot.limits} <= set(limit_definitions())
    assert record.robot.limit("nothing") is None


def test_the_figure_marks_the_segments(record, tmp_path):
    with house_style():
        figure = motion_figure.draw(record)
    panels = np.array(figure.axes).reshape(3, 3)
    for axes in panels.flat:
        marks = [line for line in axes.lines if len(line.get_xdata()) == 2]
        vertical = [line.get_xdata()[0] for line in marks if np.ptp(line.get_xdata()) == 0]
        np.testing.assert_allclose(vertical, record.executable.starts[1:-1])
    texts = [text.get_text() for text in panels[0, 0].texts]
    assert texts[-2:] == ["ramp in", "periods"]
    np.testing.assert_allclose(panels[0, 1].get_xlim(), (0, record.executable.starts[-1]))
    paths = save_figures((motion_figure,), record, tmp_path)
    assert [path.name for path in paths] == ["motion.png", "motion.svg"]
    assert all(path.stat().st_size > 1000 for path in paths)
