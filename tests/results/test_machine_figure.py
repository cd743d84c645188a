"""The machine at home, drawn in space and from two sides."""

import numpy as np
import pytest

from expdesign.robot import load_robot
from results.figures.drawing import house_style
from results.figures.machine import machine_figure, view_extent

COLUMNS = {
    "From above": [0, 1],
    "From the front, along y": [0, 2],
    "From the side, along x": [1, 2],
}


@pytest.fixture(scope="module", params=["palida", "rubin"])
def drawn(request):
    robot = load_robot(request.param)
    with house_style():
        figure = machine_figure.draw(robot)
        figure.canvas.draw()
    return robot, figure


def _lines(axes):
    return [np.column_stack(line.get_xydata().T) for line in axes.get_lines()]


def test_every_view_shows_the_struts_and_the_tcp(drawn):
    robot, figure = drawn
    base = 1e3 * robot.description.base_joints
    joints = 1e3 * robot.description.struts_at(robot.home).joints
    space, *planes = figure.axes
    shown = [(np.column_stack(line.get_data_3d()), [0, 1, 2]) for line in space.get_lines()]
    for axes in planes:
        shown += [(line, COLUMNS[axes.get_title(loc="left")]) for line in _lines(axes)]
    views = [COLUMNS[axes.get_title(loc="left")] for axes in planes]
    assert views[0] == [0, 1]
    # No strut is behind another one there.
    middles = ((base + joints) / 2)[:, views[1]]
    assert len(np.unique(np.round(middles, 6), axis=0)) == 6
    for columns in ([0, 1, 2], *views):
        lines = [line for line, own in shown if own == columns]
        for j in range(6):
            strut = np.stack([base[j], joints[j]])[:, columns]
            assert any(line.shape == strut.shape and np.allclose(line, strut) for line in lines)
        home = 1e3 * robot.home[:3][columns]
        assert any(len(line) == 1 and np.allclose(line[0], home) for line in lines)


def test_the_views_are_to_scale(drawn):
    _, figure = drawn
    for axes in figure.axes[1:]:
        box = axes.get_window_extent()
        x, y = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        assert box.width / x == pytest.approx(box.height / y, rel=1e-6)


def test_nothing_is_cut_off_or_covered(drawn):
    _, figure = drawn
    image = np.asarray(figure.canvas.buffer_rgba())
    for edge in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert np.all(edge == 255)
    space, *planes = figure.axes
    parts = [view_extent(space).transformed(figure.transFigure)]
    parts += [axes.get_tightbbox() for axes in planes]
    parts += [legend.get_window_extent() for legend in figure.legends]
    for k, one in enumerate(parts):
        for other in parts[:k]:
            assert not one.padded(-1).overlaps(other)
