"""PI's description of a hexapod."""

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.machines.importing import read_machine
from tests.machines.machines_of import FOLDER, asked, lengths

FILE = FOLDER / "h811.yaml"


@pytest.fixture(scope="module")
def machine():
    return read_machine("h811", [FILE])


def test_joints_home_and_range(machine):
    assert machine.base_joints[2] == (-0.038973463, 0.041900747, -0.088326097)
    assert machine.platform_joints[5] == (0.029355222, -0.025682309, 0.0)
    assert machine.home == (0.0,) * 6
    assert machine.limits["position"]["z"] == (-0.0065001, 0.0065001)
    assert machine.limits["rotation"]["psi"] == (-0.3665208882, 0.3665208882)
    assert {"limits.strut_length", "limits.strut_speed", "limits.actuator_force"} <= asked(machine)


def test_its_struts_are_alike_at_zero_and_lengthen_with_height(machine):
    # Pythagoras, by hand, for axis 0.
    aside, up = np.hypot(0.055773843 - 0.029355221, 0.012801635 - 0.025682309), 0.088326097
    np.testing.assert_allclose(lengths(machine, machine.home), np.hypot(aside, up), atol=2e-9)
    risen = lengths(machine, [0, 0, 0.005, 0, 0, 0])
    np.testing.assert_allclose(risen, np.hypot(aside, up + 0.005), atol=2e-9)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("x: 0.055773843", "x: near", "axis_0.base_anchor.x"),
        ("x: 0.055773843", "x: .inf", "axis_0.base_anchor.x"),
        ("x: 0.055773843, ", "", "axis_0.base_anchor.x"),
        ("x: 0.055773843", "x: true", "axis_0.base_anchor.x"),
        ("axis_3:", "axis_9:", "axis_3"),
        ("upper_limit: 0.0065001", "upper_limit: -0.1", "z"),
    ],
)
def test_what_is_wrong_is_told_with_its_key(old, new, key, tmp_path):
    text = FILE.read_text()
    assert old in text
    file = tmp_path / "changed.yaml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_machine("changed", [file])
    assert caught.value.problems[0].key == key


@pytest.mark.parametrize("text", ["name: other\n", "axis_0: [1, 2]\n", "axis_0: {\n", ""])
def test_other_yaml_is_refused(text, tmp_path):
    file = tmp_path / "other.yaml"
    file.write_text(text)
    with pytest.raises(InputError):
        read_machine("other", [file])
