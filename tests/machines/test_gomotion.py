"""Go Motion's INI file of a hexapod: joints, limits and units in one file."""

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.machines.importing import read_machine
from tests.machines import simulated as bench
from tests.machines.machines_of import asked, fixed_axes

CM = 100.0


def ini(home_angles="2 -1 3", limits="55 95"):
    low, high = limits.split()
    servos = "".join(
        f"[SERVO_{j}]\nQUANTITY = Length\nPK_PARAMETERS = {bench.text(CM * np.r_[base, head])}\n"
        f"MIN_LIMIT = {low} ; cm\nMAX_LIMIT = {high}\nMAX_VEL = 20\nMAX_ACC = {100 + j}\n"
        for j, (base, head) in enumerate(zip(bench.BASE, bench.PLATFORM, strict=True), 1)
    )
    return (
        "; units: [cm], [deg]\n[GOMOTION]\nLENGTH_UNITS_PER_M = 100.0\n"
        "ANGLE_UNITS_PER_RAD = 57.295779513082323\n[TRAJ]\nKINEMATICS = genhexkins\n"
        f"HOME = {bench.text(CM * bench.POSITION)} {home_angles}\n"
        f"MIN_LIMIT = -10 -12 60 -10 -10 -10\nMAX_LIMIT = 10 12 80 10 10 10\n{servos}"
    )


def read(folder, content):
    (folder / "hexapod.ini").write_text(content)
    return read_machine("m", [folder / "hexapod.ini"])


def test_joints_home_and_limits(tmp_path):
    machine = read(tmp_path, ini())
    np.testing.assert_allclose(machine.base_joints, bench.BASE, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, bench.PLATFORM, atol=1e-12)
    np.testing.assert_allclose(machine.home[:3], bench.POSITION, atol=1e-12)
    expected = fixed_axes([2, -1, 3], degrees=True).as_euler("XYZ")
    np.testing.assert_allclose(machine.home[3:], expected, atol=1e-12)
    assert machine.limits == {
        "strut_length": (0.55, 0.95),
        "strut_speed": 0.2,
        "strut_acceleration": tuple((100.0 + j) / 100 for j in range(1, 7)),
        "position": {"x": (-0.1, 0.1), "y": (-0.12, 0.12), "z": (0.6, 0.8)},
    }
    assert asked(machine) == {"limits.rotation"}


@pytest.mark.parametrize("limits", ["-1000 1000", "1000 1000", "100 100000", "75 75"])
def test_a_placeholder_is_no_limit(limits, tmp_path):
    machine = read(tmp_path, ini(limits=limits))
    assert "strut_length" not in machine.limits
    assert "limits.strut_length" in asked(machine)


@pytest.mark.parametrize(
    ("old", "new", "limit", "left"),
    [
        ("MIN_LIMIT = 55 ; cm\n", "", "strut_length", None),
        ("-10 -12 60 -10", "-1000 -12 60 -10", "position", {"y": (-0.12, 0.12), "z": (0.6, 0.8)}),
        ("MAX_VEL = 20", "MAX_VEL = 1e9", "strut_speed", None),
        ("MAX_ACC = 103", "MAX_ACC = 1e9", "strut_acceleration", None),
        ("MAX_ACC = 103\n", "", "strut_acceleration", None),
    ],
)
def test_what_limits_nothing_is_a_question(old, new, limit, left, tmp_path):
    machine = read(tmp_path, ini().replace(old, new, 1))
    assert machine.limits.get(limit) == left
    assert f"limits.{limit}" in asked(machine)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("genhexkins", "tripointkins", "these kinematics are not read"),
        ("LENGTH_UNITS_PER_M = 100.0", "", "LENGTH_UNITS_PER_M is missing"),
        ("= 100.0", "= -1", "are not positive"),
        ("[SERVO_3]", "[SERVO_7]", "PK_PARAMETERS is missing"),
        ("2 -1 3", "2 -1", "5 numbers"),
        ("MAX_VEL = 20", "MAX_VEL = 0", r"hexapod.ini:15: .SERVO_1.MAX_VEL"),
        ("2 -1 3", "2 -1 three", "is no number"),
    ],
)
def test_what_is_wrong_is_named(old, new, said, tmp_path):
    with pytest.raises(InputError, match=said):
        read(tmp_path, ini().replace(old, new))
