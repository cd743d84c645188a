"""A Stewart platform's variables in a MATLAB file."""

import numpy as np
import pytest
from scipy.io import savemat

from expdesign.configuration import InputError, geometry
from expdesign.machines.importing import read_machine
from expdesign.robot import load_robot
from tests.machines.machines_of import asked, lengths


def ring(radius, middle, half_angle, height=0.0):
    angles = np.radians(
        [middle + 120 * (j // 2) + half_angle * (2 * (j % 2) - 1) for j in range(6)]
    )
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(6, height)])


# The numbers of the demonstration: radii of 3 m and 1 m, offsets of 2.5° and 10°, height 2 m.
BASE = ring(3, 0, 2.5)
TOP = np.roll(ring(1, 60, 10, 2.0), 1, axis=0)
DEMONSTRATION = {
    "pos_base": BASE,
    "pos_top": TOP,
    "body_pts": TOP.T - [[0], [0], [2]],
    "height": 2.0,
    "top_mass": 1216.9,
    "legs": TOP - BASE,
    "comment": "text is no number",
    "lower_leg": [{"origin": np.zeros(3)}, {"origin": np.ones(3)}],
}


def saved(folder, variables):
    savemat(folder / "machine.mat", variables)
    return folder / "machine.mat"


def test_the_demonstration_of_mathworks(tmp_path):
    machine = read_machine("m", [saved(tmp_path, DEMONSTRATION)])
    np.testing.assert_allclose(machine.base_joints, BASE, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, TOP - [0, 0, 2], atol=1e-12)
    assert machine.home == (0, 0, 2, 0, 0, 0)
    assert machine.moved_mass == 1216.9
    np.testing.assert_allclose(
        lengths(machine, machine.home), np.linalg.norm(TOP - BASE, axis=1), atol=1e-12
    )
    # The robot that ships is the same machine, described by hand.
    shipped = load_robot("mathworks").description
    there = geometry.geometry_at(
        np.array(shipped.home), np.array(shipped.base_joints), np.array(shipped.platform_joints)
    )
    np.testing.assert_allclose(lengths(machine, machine.home), there.lengths, atol=1e-9)
    assert "base_joints" in asked(machine)


def test_without_a_height_the_tcp_is_amid_the_upper_joints(tmp_path):
    names = ("pos_base", "pos_top")
    machine = read_machine("m", [saved(tmp_path, {k: DEMONSTRATION[k] for k in names})])
    np.testing.assert_allclose(machine.home[:3], [0, 0, 2], atol=1e-12)
    assert "home" in asked(machine)


def test_the_struct_of_stewart_simscape(tmp_path):
    base, platform = ring(0.115, 0, 10), np.roll(ring(0.09, 60, 10), 1, axis=0)
    struct = {
        "platform_F": {"Fa": base.T, "type": 1},
        "platform_M": {"Mb": platform.T},
        "geometry": {"H": 0.09},
    }
    machine = read_machine("m", [saved(tmp_path, {"stewart": struct})])
    np.testing.assert_allclose(machine.base_joints, base, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, platform, atol=1e-12)
    # The robot that ships is the same one; its struts are 116.5 mm long.
    shipped = load_robot("dehaeze").description
    assert np.allclose(lengths(machine, machine.home), 0.1165, atol=5e-5)
    assert machine.home == tuple(shipped.home)


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"pos_base": BASE[:5]}, "pos_base"),
        ({"body_pts": np.full((3, 6), np.nan)}, "body_pts"),
    ],
)
def test_what_is_wrong_is_told_with_the_variable(changed, key, tmp_path):
    with pytest.raises(InputError) as caught:
        read_machine("m", [saved(tmp_path, DEMONSTRATION | changed)])
    assert caught.value.problems[0].key == key


def test_files_without_such_variables_and_damaged_ones_are_refused(tmp_path):
    file = saved(tmp_path, {"speed": np.ones(6)})
    with pytest.raises(InputError):
        read_machine("m", [file])
    whole = saved(tmp_path, DEMONSTRATION).read_bytes()
    for content in (whole[:400], b"\x89HDF\r\n\x1a\n" + bytes(600)):
        file.write_bytes(content)
        with pytest.raises(InputError):
            read_machine("m", [file])


def test_a_length_that_is_damaged(tmp_path):
    """One wrong bit of an exponent makes a platform larger than the universe."""
    angle = np.arange(6) * np.pi / 3
    base = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    base[2, 0] = 1e231
    path = tmp_path / "platform.mat"
    savemat(path, {"pos_base": base, "pos_top": 0.6 * base + [0, 0, 1]})
    with pytest.raises(InputError) as caught:
        read_machine("lab", [path])
    assert caught.value.problems[0].key == "base_joints"
