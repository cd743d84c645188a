"""The same motion smaller and slower: home + F (λ(F t) − home), for a first run on the machine."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from expdesign.configuration import InputError, export_section
from expdesign.export.exporting import export_table, file_name
from expdesign.export.result import ExportResult, exported_motion, exported_table, readme
from expdesign.export.table_file import find_table_file
from tests.estimation.cases import ROBOT, trajectory
from tests.export import reading
from tests.export.motions import spline_motion_of
from tests.export.written import small_task

F = 0.3
STEP = 10e-3
COARSE = {"segment": 50e-3, "tolerance": "1 mm"}


@cache
def work():
    """Return a task whose ways are splines, as the search finds them, from another phase."""
    return replace(small_task(), motion=spline_motion_of(ROBOT, trajectory(), 2, 0.25))


def by_definition(times):
    """Return pose, rate and acceleration of home + F (λ(F t) − home) from those of λ."""
    pose, rate, acceleration = work().motion.sample(F * times)
    return ROBOT.home + F * (pose - ROBOT.home), F**2 * rate, F**3 * acceleration


def test_every_part_of_the_motion_is_scaled():
    motion = work().motion
    made = motion.scaled(F, ROBOT.home)
    assert made.duration == pytest.approx(motion.duration / F, rel=1e-12)
    assert made.window == pytest.approx(np.array(motion.window) / F, rel=1e-12)
    # Not on the seams, where rounding decides which of two parts is meant.
    times = np.linspace(-0.1, made.duration + 0.1, 1777)
    for found, wanted in zip(made.sample(times), by_definition(times), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())
    for k in range(3):
        jerk = made.segments[k].jerk(np.array([0.1, 0.2]))
        own = motion.segments[k].jerk(F * np.array([0.1, 0.2]))
        np.testing.assert_allclose(jerk, F**4 * own, rtol=1e-9, atol=1e-9)
    assert motion.scaled(1.0, ROBOT.home).window == motion.window


def exported(folder, **options):
    section = export_section(scale=F, **options)
    return export_table(section, work(), folder / file_name(section))


FORMATS = {
    "xps-pvt": (COARSE, reading.xps, None),
    "pmac-pvt": (COARSE, reading.pmac, ";"),
    "linuxcnc-strut": (
        {"segment": STEP, "tolerance": "1 mm"},
        reading.rows_alone(STEP),
        "#",
    ),
    "ros2": (COARSE, reading.joint_yaml, "#"),
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_table_is_the_scaled_motion_and_says_so(name, tmp_path):
    options, read, comment = FORMATS[name]
    made = exported(tmp_path, format=name, **options)
    assert made.path.stem == f"{name}-scale-0.3"
    unit = 1.0 if name == "ros2" else 1e3
    times, position, _ = read(made.path, unit * ROBOT.inverse_kinematics(ROBOT.home))
    wanted = ROBOT.inverse_kinematics(by_definition(times)[0])
    np.testing.assert_allclose(position / unit, wanted, rtol=0, atol=1e-8)
    # Within the limits of the robot, as it is executed.
    assert {check.key for check in made.check.limits} == {one.key for one in ROBOT.limits}
    if comment is not None:
        head = made.path.read_text().splitlines()[0]
        assert head.startswith(comment)
        assert "scaled by 0.3" in head


def test_a_program_in_g_code_says_so_in_a_comment(tmp_path):
    made = exported(tmp_path, format="linuxcnc-gcode")
    first = made.path.read_text().splitlines()[0]
    # Comments do not nest.
    assert (first.count("("), first.count(")"), "scaled by 0.3" in first) == (1, 1, True)


def test_rates_and_accelerations_of_the_table_are_its_derivatives(tmp_path):
    """By differences of the rows, and F² and F³ times those of the whole motion."""
    made = exported(tmp_path, format="csv", segment=STEP, tolerance="1 mm")
    table = pd.read_csv(made.path)
    table.columns = [name.partition(" ")[0] for name in table.columns]
    x, rate, acceleration = (table[name].to_numpy() for name in ("psi", "dpsi", "ddpsi"))
    slope = (x[2:] - x[:-2]) / (2 * STEP)
    bend = (x[2:] - 2 * x[1:-1] + x[:-2]) / STEP**2
    assert np.abs(slope - rate[1:-1]).max() < 2e-3 * np.abs(rate).max()
    assert np.abs(bend - acceleration[1:-1]).max() < 2e-2 * np.abs(acceleration).max()
    dense = np.linspace(0.0, work().motion.duration, 20_001)
    whole = work().motion.sample(dense)
    assert np.abs(rate).max() == pytest.approx(F**2 * np.abs(whole.rate[:, 5]).max(), rel=1e-3)
    largest = np.abs(whole.acceleration[:, 5]).max()
    assert np.abs(acceleration).max() == pytest.approx(F**3 * largest, rel=1e-3)
    inside = table["t"][table["window"] == 1]
    assert inside.min() == pytest.approx(work().motion.window[0] / F, abs=STEP)
    assert inside.max() == pytest.approx(work().motion.window[1] / F, abs=STEP)


def test_its_record_tells_the_scale_and_it_is_found_again(tmp_path):
    made = exported(tmp_path, format="xps-pvt", **COARSE)
    full = export_section(format="xps-pvt", **COARSE)
    other = export_table(full, work(), tmp_path / file_name(full))
    files = {one.path.name: exported_table(one) for one in (made, other)}
    record = ExportResult(exported_motion(work()), files)
    record.write_as(tmp_path / "exports.json")
    again = ExportResult.read(tmp_path / "exports.json")
    assert {name: entry.scale for name, entry in again.files.items()} == {
        made.path.name: F,
        other.path.name: 1.0,
    }
    begin, end = np.array(work().motion.window) / F
    assert again.files[made.path.name].window(again.motion) == pytest.approx((begin, end))
    text = " ".join(readme(again).split())
    assert f"its measurement window from {begin:.6f} s to {end:.6f} s" in text
    assert text.count("scaled by 0.3") == 1
    found = find_table_file(made.path, ROBOT, trajectory())
    assert found.window == pytest.approx((begin, end), rel=1e-12)
    assert found.design.period == pytest.approx(trajectory().period / F, rel=1e-12)
    wanted = ROBOT.inverse_kinematics(by_definition(begin + np.array([0.0, 1.0]))[0])
    np.testing.assert_allclose(
        found.executed.lengths(begin + np.array([0.0, 1.0])), wanted, atol=1e-3
    )


@pytest.mark.parametrize("scale", [0, -0.5, 1.01, "30 mm"])
def test_no_scale(scale):
    with pytest.raises(
        ValueError, match=r"greater than 0|less than or equal to 1|not a share|is a length"
    ):
        export_section(format="csv", scale=scale)


def test_a_scale_that_takes_hours(tmp_path):
    section = export_section(format="csv", scale=1e-4)
    with pytest.raises(InputError, match=r"scale") as error:
        export_table(section, work(), tmp_path / "t.csv")
    assert "at least" in str(error.value)
    assert list(tmp_path.iterdir()) == []
