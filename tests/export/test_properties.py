"""Writers, readers, interpolators and rotations for all numbers, not only those of a design."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from expdesign.configuration import export_section
from expdesign.export.definition import Axes, Interpolation, Rows, Settings, TableError
from expdesign.export.execution import differences, interpolate_rows, refine_times
from expdesign.export.formats import table_formats
from expdesign.export.rotation import (
    angle_derivatives,
    angular_motion,
    from_quaternions,
    from_roll_pitch_yaw,
    quaternions,
    roll_pitch_yaw,
)
from expdesign.mechanism.strut import angular_acceleration, angular_velocity, rotation_matrix

TEXT = ("xps-pvt", "pvt-csv", "pmac-pvt", "pi-wave", "linuxcnc-strut", "linuxcnc-gcode", "ros2")
values = st.floats(-2000, 2000, allow_subnormal=False)
angles = arrays(float, (4, 3), elements=st.floats(-1.2, 1.2))
rates = arrays(float, (4, 3), elements=st.floats(-5, 5))


def made(name, digits, start):
    form = table_formats()[name]
    section = export_section(format=name)
    space = section.coordinates
    units = (form.units,) * 6
    axes = Axes(space, form.axes[space], units, np.arange(6), np.ones(6), np.zeros(6))
    motion = SimpleNamespace(window=(0.0, 1.0), periods=1, duration=10.0)
    task = SimpleNamespace(name="n", motion=motion, controller_period=1e-3)
    return Settings(section, form, task, axes, digits, 1e-3, 1e-6, start)


@given(
    name=st.sampled_from(TEXT),
    digits=st.integers(1, 9),
    count=st.integers(2, 6),
    data=st.data(),
)
@settings(max_examples=150)
def test_what_is_written_is_read(name, digits, count, data, tmp_path_factory):
    form = table_formats()[name]
    position, rate, acceleration = (
        data.draw(arrays(float, (count, 6), elements=values)) for _ in range(3)
    )
    if form.uniform:
        times = 1e-3 * np.arange(count)
    else:
        # Rows of G-code are whole servo cycles of 1 ms apart.
        steps = st.floats(2e-3 if name == "linuxcnc-gcode" else 1e-4, 1.0)
        times = np.concatenate(
            [[0], np.cumsum(data.draw(arrays(float, count - 1, elements=steps)))]
        )
    times = form.written_times(times, made(name, digits, np.zeros(6)))
    rate[[0, -1]] = 0
    chosen = made(name, digits, np.round(position[0], digits))
    rows = Rows(times, position, rate, acceleration)
    path = tmp_path_factory.mktemp("table") / f"table{form.suffix}"
    form.write(path, rows, chosen)
    again = form.read(path, chosen)
    half = chosen.half_unit + 1e-9 * 10.0**-digits + 1e-11
    assert np.abs(again.times - times).max() < 1e-12 * count + 1e-15
    assert np.abs(again.position - position).max() <= half
    if form.interpolation is not Interpolation.LINEAR:
        assert np.abs(again.rate - rate).max() <= half
    if form.interpolation is Interpolation.QUINTIC:
        assert np.abs(again.acceleration - acceleration).max() <= half


@given(text=st.text(max_size=200), name=st.sampled_from(TEXT))
def test_any_other_text_is_refused(text, name, tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "table"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(TableError):
        table_formats()[name].read(path, made(name, 6, np.zeros(6)))


@pytest.mark.parametrize("time", ["PVTx", "PVT0", "PVT1e9", "PVT3.99 Z:1:1", None])
def test_a_wrong_time_of_a_pmac_program_is_named_by_its_line(time, tmp_path):
    """None: the move before it is lost."""
    path, settings, form = tmp_path / "table", made("pmac-pvt", 6, np.zeros(6)), "pmac-pvt"
    rows = Rows(0.004 * np.arange(9), np.zeros((9, 6)), np.zeros((9, 6)))
    table_formats()[form].write(path, rows, settings)
    lines = path.read_text().splitlines()
    line = [k for k, text in enumerate(lines) if text.startswith("PVT")][4]
    if time is None:
        del lines[line - 1]
    else:
        lines[line] = time
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(TableError, match=f"^line {line + (time is not None)}: "):
        table_formats()[form].read(path, settings)


@pytest.mark.parametrize(("kind", "degree"), [(k, 2 * n + 1) for n, k in enumerate(Interpolation)])
@given(data=st.data())
def test_polynomials_are_met(kind, degree, data):
    power = np.arange(degree + 1)
    factors = data.draw(arrays(float, (degree + 1, 6), elements=st.floats(-1, 1)))
    times = np.array([0, 0.3, 0.4, 1.0])
    exact = np.polynomial.Polynomial

    def at(t, order):
        return np.stack([exact(column).deriv(order)(t) for column in factors.T], axis=1)

    rows = Rows(times, at(times, 0), at(times, 1), at(times, 2))
    path = interpolate_rows(kind, rows)
    fine = refine_times(times, 10)
    assert len(fine) == 31
    assert set(times) <= set(fine)
    for order in range(min(3, degree + 1)):
        assert path(fine, order) == pytest.approx(at(fine, order), abs=1e-8)
    assert len(power) == degree + 1


@given(arrays(float, (3, 6), elements=st.floats(-1, 1)))
def test_differences_of_parabolas(factors):
    times = np.array([0, 0.1, 0.25, 0.3])
    parabola = factors[0] + np.outer(times, factors[1]) + np.outer(times**2, factors[2])
    first, second = differences(times, parabola)
    assert first[1:-1] == pytest.approx(factors[1] + 2 * np.outer(times[1:-1], factors[2]))
    assert second[1:-1] == pytest.approx(np.broadcast_to(2 * factors[2], (2, 6)), abs=1e-9)
    assert not np.any(first[[0, -1]])
    assert not np.any(second[[0, -1]])


@given(angles)
def test_conventions_of_rotation(given_angles):
    matrices = [ca.evalf(rotation_matrix(ca.SX(row))).full() for row in given_angles]
    fixed = roll_pitch_yaw(given_angles)
    for row, matrix in zip(fixed, matrices, strict=True):
        # LinuxCNC: R = Rz(C) Ry(B) Rx(A).
        x, y, z = (
            Rotation.from_rotvec(a * e).as_matrix() for a, e in zip(row, np.eye(3), strict=True)
        )
        assert z @ y @ x == pytest.approx(matrix, abs=1e-12)
    assert Rotation.from_quat(quaternions(given_angles)).as_matrix() == pytest.approx(
        np.array(matrices), abs=1e-12
    )
    for back in (from_roll_pitch_yaw(fixed), from_quaternions(quaternions(given_angles))):
        again = [ca.evalf(rotation_matrix(ca.SX(row))).full() for row in back]
        assert np.array(again) == pytest.approx(np.array(matrices), abs=1e-9)


@given(angles, rates, rates)
def test_angular_motion_is_the_graphs(given_angles, first, second):
    velocity, acceleration = angular_motion(given_angles, first, second)
    for k in range(4):
        parts = [ca.SX(x[k]) for x in (given_angles, first, second)]
        assert velocity[k] == pytest.approx(ca.evalf(angular_velocity(*parts[:2])).full()[:, 0])
        expected = ca.evalf(angular_acceleration(*parts)).full()[:, 0]
        assert acceleration[k] == pytest.approx(expected, abs=1e-9)
    back = angle_derivatives(given_angles, velocity, acceleration)
    assert back[0] == pytest.approx(first, abs=1e-9)
    assert back[1] == pytest.approx(second, abs=1e-7)
