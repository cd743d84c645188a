"""Every format, two robots, 5 and 12 harmonics: what stands in the file is the design."""

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError, export_section
from expdesign.configuration.parameters import Drive, Gear
from expdesign.export.definition import LENGTH_UNITS, Interpolation
from expdesign.export.exporting import ExportError, export_table, file_name
from expdesign.export.formats import table_formats
from expdesign.export.result import exported_table
from expdesign.export.row_times import SHARE, STEPS
from expdesign.export.table_file import certify_file, read_table_file
from expdesign.export.whole_table import wrong_columns
from expdesign.mechanism.strut import rotation_matrix
from expdesign.robot import Robot
from tests.export import reading
from tests.export.motions import CASES, task

STEP = 4e-3
COUNTS = {"counts_per_metre": 1e8}
UNIFORM = {"segment": STEP, "tolerance": "200 um"}
# Segments are searched for xps-pvt and ros2, and for the platform of ros2.
GIVEN = {"segment": "4 ms", "tolerance": "50 um"}
MM, DEG = 1e3, 180 / np.pi
STRUT_MM = np.full(6, MM)
POSE_MM = np.repeat([MM, DEG], 3)
# options, reader, axes' units for m and rad, half a unit of the last digit
EXPORTS = {
    "xps-pvt": ({}, reading.xps, STRUT_MM, 0.5e-8),
    "pmac-pvt": (GIVEN, reading.pmac, STRUT_MM, 0.5e-8),
    "pmac-pvt pose": (GIVEN | {"space": "pose"}, reading.pmac, POSE_MM, 0.5e-8),
    "pvt-csv": (GIVEN, reading.zaber, STRUT_MM, 0.5e-8),
    # Longer lines break limits.
    "linuxcnc-gcode": ({}, reading.gcode, POSE_MM, 0.5e-6),
    "linuxcnc-strut": (UNIFORM, reading.rows_alone(STEP), STRUT_MM, 0.5e-6),
    "pi-wave": (UNIFORM, reading.rows_alone(STEP), POSE_MM, 0.5e-6),
    "galil-contour": (UNIFORM | COUNTS, reading.galil(STEP), np.full(6, 1e8), 0.5),
    "csv": (UNIFORM, reading.csv, np.ones(6), 1e-12),
    "mat": (UNIFORM, reading.mat, STRUT_MM, 1e-9),
    "mat pose": (UNIFORM | {"space": "pose"}, reading.mat, POSE_MM, 1e-9),
    "ros2": ({}, reading.joint_yaml, np.ones(6), 0.5e-11),
    "ros2 mcap": (GIVEN | {"encoding": "mcap"}, reading.joint_bag, np.ones(6), 1e-12),
}


def section(key, **more):
    options, *_ = EXPORTS[key]
    return export_section(format=key.split()[0], **(options | more))


def fixed_axes(pose):
    """Roll, pitch and yaw with R = Rz(C) Ry(B) Rx(A), from the robot's own matrix."""
    angles = ca.SX.sym("angles", 3)
    matrix = ca.Function("R", [angles], [rotation_matrix(angles)])
    found = [Rotation.from_matrix(matrix(row[3:]).full()).as_euler("xyz") for row in pose]
    return np.concatenate([pose[:, :3], np.unwrap(found, axis=0)], axis=1)


def designed(key, work, times):
    states = work.motion.sample(times)
    if EXPORTS[key][2] is POSE_MM:
        if key == "linuxcnc-gcode":
            return fixed_axes(states.pose), None
        return states.pose, states.rate
    struts = work.robot.strut_motion(states.pose, states.rate, states.acceleration)
    return struts.length, struts.length_rate


CHECKED = ("xps-pvt", "ros2", "linuxcnc-gcode")
"""Formats of which it is tested what the check says: PVT, a message, and line segments."""


def test_rounding_moves_no_acceleration_even_where_rows_are_closest():
    largest = 30.0  # m/s², as of a strut
    for name, form in table_formats().items():
        if form.interpolation is not Interpolation.LINEAR and form.digits is not None:
            apart = 0.5 * 10.0**-form.digits / LENGTH_UNITS["mm"]
            # Of a Hermite cubic both of whose ends are off by that, in opposite directions.
            assert 12 * apart / min(STEPS) ** 2 <= SHARE * 2 * largest / 10, name


def test_all_formats_are_here():
    assert {key.split()[0] for key in EXPORTS} == set(table_formats())


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("key", EXPORTS)
def test_rows_are_the_design_at_the_times_as_written(key, case, tmp_path):
    work = task(*case)
    asked = section(key)
    made = export_table(asked, work, tmp_path / file_name(asked))
    _, read, unit, half = EXPORTS[key]
    home, _ = designed(key, work, np.zeros(1))
    digits = made.settings.digits
    start = home[0] * unit if digits is None else np.round(home[0] * unit, digits)
    times, positions, rates = read(made.path, start)
    wanted, speeds = designed(key, work, times)
    slack = 1e-11 * np.abs(wanted * unit).max()
    assert np.abs(positions - wanted * unit).max() <= half + slack
    if rates is not None:
        assert np.abs(rates - speeds * unit).max() <= half + 1e-11 * np.abs(speeds * unit).max()
    # From rest at home to rest at home, all of the motion.
    assert np.abs(positions[[0, -1]] - home * unit).max() <= half + slack
    longest = STEP if key != "linuxcnc-gcode" else made.check.longest_step
    assert 0 <= times[-1] - work.motion.duration + 1e-6 <= longest
    assert len(times) == made.check.rows
    # Nothing else lies beside the file.
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in (made.path, *made.companions)}
    if key in CHECKED:
        _assert_sound(made.check, key, work)


def _assert_sound(check, key, work):
    assert not check.failures
    # Servo cycles of the planner, which skips those of the slowest rows.
    assert check.points >= (9 if key == "linuxcnc-gcode" else 10) * (check.rows - 1)
    assert check.row_error <= 1
    assert {limit.key for limit in check.limits} == {limit.key for limit in work.robot.limits}
    rates = {"strut_speed", "strut_acceleration", "actuator_force"}
    planned = rates if key == "linuxcnc-gcode" else set()
    assert max(one.violation for one in check.limits if one.key not in planned) <= 1e-3
    if planned:
        assert abs(check.information.log_det_change) < 0.25
        assert abs(check.information.std_change) < 0.02
        return
    assert check.position_error < 1e-6
    assert max(check.acceleration_error_share, check.force_error_share) <= 1e-3
    assert abs(check.information.log_det_change) < 0.01
    assert abs(check.information.std_change) < 0.001


@pytest.mark.parametrize("encoding", ["yaml", "mcap"])
@pytest.mark.parametrize("case", CASES, ids=str)
def test_platform_of_ros2(case, encoding, tmp_path):
    work = task(*case)
    asked = export_section(format="ros2", space="pose", encoding=encoding)
    made = export_table(asked, work, tmp_path / file_name(asked))
    assert not made.check.failures
    if encoding == "mcap":
        return
    points = YAML(typ="safe").load(made.path.read_text())["points"]
    point = points[len(points) // 2]
    time = point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]
    place, turn = point["transforms"][0].values()
    states = work.motion.sample([time - 1e-6, time, time + 1e-6])
    pose = states.pose[1]
    assert [*place.values()] == pytest.approx(pose[:3], abs=1e-9)
    matrix = ca.evalf(rotation_matrix(ca.SX(pose[3:]))).full()
    assert Rotation.from_quat([*turn.values()]).as_matrix() == pytest.approx(matrix, abs=1e-9)
    # ω × in the base frame is Ṙ Rᵀ.
    before, after = (ca.evalf(rotation_matrix(ca.SX(states.pose[k, 3:]))).full() for k in (0, 2))
    spin = (after - before) @ matrix.T / 2e-6
    twist = point["velocities"][0]
    assert [*twist["linear"].values()] == pytest.approx(states.rate[1, :3], abs=1e-9)
    wanted = [spin[2, 1], spin[0, 2], spin[1, 0]]
    assert [*twist["angular"].values()] == pytest.approx(wanted, abs=1e-7)


def test_axes_units_order_signs_and_zeros(tmp_path):
    work = task()
    asked = export_section(
        format="xps-pvt",
        order=[3, 1, 2, 6, 5, 4],
        sign=[1, -1, 1, 1, -1, 1],
        offset="home",
        counts_per_metre=[1e6, 2e6, 1e6, 1e6, 1e6, 1e6],
    )
    made = export_table(asked, work, tmp_path / "file.trj")
    assert made.settings.axes.units == ("counts",) * 6
    assert made.settings.digits == 3
    times, positions, _ = reading.xps(made.path, np.zeros(6))
    lengths = work.robot.inverse_kinematics(work.motion.sample(times).pose)
    moved = lengths - work.robot.inverse_kinematics(work.robot.home)
    wanted = 1e6 * np.stack(
        [moved[:, 2], moved[:, 0], -2 * moved[:, 1], moved[:, 5], -moved[:, 4], moved[:, 3]], axis=1
    )
    assert np.abs(positions - wanted).max() <= 0.5e-3 + 1e-8


@pytest.mark.parametrize(
    ("options", "units"),
    [
        ({"units": "rev", "columns": ["dq", "Q", "window"]}, {}),
        ({"counts_per_revolution": 1e6, "segment": "4 ms"}, {}),
        ({"counts_per_metre": [1e8, 2e8, 1e8, 1e8, 1e8, 3e8]}, {"Q": "N"}),
        ({"units": "mm", "columns": ["Q"]}, {}),
        ({"units": "mm", "columns": ["x", "dz", "ddy", "phi", "Q"]}, {}),
    ],
)
def test_a_csv_is_read_with_the_options_that_wrote_it(options, units, tmp_path):
    """Order, signs, zeros and counts have the same keys and values in `export` and `data`."""
    work = task()
    turned = replace(work.robot.description, drive=Drive(gear=Gear(lead=0.02)))
    work = replace(work, robot=Robot(turned))
    axes = {"order": [3, 1, 2, 6, 5, 4], "sign": [1, -1, 1, 1, -1, 1], "offset": "home"}
    given = UNIFORM | axes | options
    made = export_table(export_section(format="csv", **given), work, tmp_path / "file.csv")
    counts = {key: value for key, value in options.items() if "counts" in key}
    section = DataSection(units=units, **axes, **counts)
    found = read_measurement(made.path, section, work.robot)
    states = work.motion.sample(STEP * np.arange(len(found)))  # at rest at the ends
    assert np.abs(found.lengths - work.robot.inverse_kinematics(states.pose)).max() < 1e-12
    forces = work.robot.actuator_forces(*states)
    assert np.abs(found.forces - forces).max() < 1e-9 * np.abs(forces).max()
    header = made.path.read_text().partition("\n")[0].split(",")
    assert len(header) == (13 if options.get("columns") == ["Q"] else len(header))
    shown = {"x [mm]", "dz [mm/s]", "ddy [mm/s^2]", "phi [rad]"}
    assert ("x" in options.get("columns", ())) == (shown <= set(header))
    table = read_table_file(made.path, made.settings)
    assert certify_file(table).faults == ()
    assert wrong_columns(made.settings, table.executed.rows) == []


def test_a_csv_has_one_unit_of_lengths_and_lengths_alone(tmp_path):
    whole, lengths = (
        export_table(
            export_section(format="csv", **UNIFORM, units="mm", **chosen), task(), tmp_path / name
        ).path
        for name, chosen in (("whole.csv", {}), ("lengths.csv", {"columns": ["q"]}))
    )
    table = pd.read_csv(whole)
    assert not [name for name in table if "[m]" in name or "[m/" in name]
    pose = task().motion.sample(table["t [s]"].to_numpy()).pose
    np.testing.assert_allclose(table["z [mm]"], 1e3 * pose[:, 2], rtol=1e-12)
    assert list(pd.read_csv(lengths)) == ["t [s]", *(f"q{j} [mm]" for j in range(1, 7))]


def test_all_columns_of_a_csv_have_the_order_of_its_axes(tmp_path):
    order, sign = [2, 1, 3, 4, 5, 6], [1, 1, -1, 1, 1, 1]
    tables = []
    for name, axes in (("plain", {}), ("axes", {"order": order, "sign": sign})):
        made = export_table(
            export_section(format="csv", **UNIFORM, **axes), task(), tmp_path / f"{name}.csv"
        )
        guide = " ".join(exported_table(made).guide.split())
        assert ("positive extends" in guide) == (name == "plain")
        assert ("belong to the struts 2, 1, 3, 4, 5, 6; q, dq" in guide) == (name == "axes")
        tables.append(np.genfromtxt(made.path, delimiter=",", names=True))
        assert (
            wrong_columns(made.settings, read_table_file(made.path, made.settings).executed.rows)
            == []
        )
    plain, ordered = tables
    units = {"q": "m", "dq": "ms", "ddq": "ms2", "Q": "N", "alpha": "rad", "beta": "rad"}
    for kind, unit in units.items():
        for axis, strut in enumerate(order, start=1):
            factor = sign[strut - 1] if kind not in ("alpha", "beta") else 1
            wanted = factor * plain[f"{kind}{strut}_{unit}"]
            np.testing.assert_array_equal(ordered[f"{kind}{axis}_{unit}"], wanted)


def test_a_table_of_motors_needs_their_lead(tmp_path):
    work = task()
    with pytest.raises(InputError, match=r"states no lead.*drive: \{screw: \{lead: 5 mm\}\}"):
        export_table(export_section(format="csv", units="rev"), work, tmp_path / "file.csv")


def test_relative_rows_do_not_gather_rounding(tmp_path):
    work = task("palida", 12)
    asked = export_section(format="xps-pvt", digits=4, segment="4 ms", tolerance="10 um")
    try:
        made = export_table(asked, work, tmp_path / "file.trj")
    except ExportError as error:  # four digits shake the accelerations; the rows are what counts
        pytest.fail(str(error))
    home = np.round(1e3 * work.robot.inverse_kinematics(work.robot.home), 4)
    times, positions, _ = reading.xps(made.path, home)
    lengths = 1e3 * work.robot.inverse_kinematics(work.motion.sample(times).pose)
    assert len(times) > 900
    assert np.abs(positions - lengths).max() <= 0.5e-4 * 1.0001


def test_no_jumps_of_a_full_turn(tmp_path):
    """A home turned by 179° about z has its yaw on both sides of 180°."""
    work = task()
    turned = work.motion
    angle = np.radians(179.5)

    class Turned:
        segments, starts, duration = turned.segments, turned.starts, turned.duration
        window, periods, trajectory = turned.window, turned.periods, turned.trajectory

        @staticmethod
        def sample(times):
            states = turned.sample(times)
            return states._replace(pose=states.pose + np.array([0, 0, 0, 0, 0, angle]))

    from expdesign.export.exporting import resolve_settings
    from expdesign.export.row_times import ideal_rows, uniform_times

    work = replace(work, motion=Turned)
    settings = resolve_settings(section("linuxcnc-gcode"), work)
    times = uniform_times(turned, STEP)
    rows = ideal_rows(settings, times)
    yaw = rows.position[:, 5]
    assert yaw.min() < 180 < yaw.max()
    assert np.abs(np.diff(rows.position[:, 3:], axis=0)).max() < 5


@pytest.mark.parametrize("name", table_formats())
def test_a_format_is_handed_over_by_worker_processes(name):
    form = table_formats()[name]
    copy = pickle.loads(pickle.dumps(form))
    assert (copy.name, copy.write, copy.read) == (name, form.write, form.read)
