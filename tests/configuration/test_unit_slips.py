"""Numbers that are probably meant in another unit: what `check` says of them."""

import copy

import pytest
import yaml

from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files

SCREW = {"screw": {"lead": "10 mm", "inertia": "0.6 kg cm^2"}}


@pytest.fixture
def warned(tmp_path):
    """Return the warnings of a robot that is PaLiDA with changes: key path to value."""
    path = next(each for each in robot_files().values() if each.stem == "palida")
    document = yaml.safe_load(path.read_text("utf-8"))

    def warnings(changes):
        changed = copy.deepcopy(document)
        for keys, value in changes.items():
            *above, last = keys.split(".")
            part = changed
            for key in above:
                part = part[key]
            part[last] = value
        file = tmp_path / "robot.yaml"
        file.write_text(yaml.safe_dump(changed), "utf-8")
        return set(load_robot_description(file).warnings)

    return warnings


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits.rotation": {"psi": [-15, 15]}}, ("limits.rotation: psi", "-859.4 deg")),
        ({"limits.alpha": [-20, 20]}, ("limits.alpha", "rad")),
        ({"limits.position": {"x": [-50, 50]}}, ("limits.position: x", "-50 m")),
        (
            {
                "base_joints": {"radius": 720, "half_angle": 0.1, "pairs": "1-2"},
                "home": [0, 0, 0.7, 0, 0, 0],
            },
            ("base_joints: 720 m",),
        ),
        ({"limits.strut_speed": 250}, ("limits.strut_speed", "250 m/s")),
        ({"drive": {"screw": {"lead": 10, "inertia": 6e-5}}}, ("lead", "10 m")),
        ({"drive": {"screw": {"lead": 0.01, "inertia": 0.6}}}, ("m_drive", "kg cm^2")),
        ({"drive": {"screw": {"lead": 0.01}}}, ("no inertia",)),
    ],
)
def test_a_number_in_another_unit_is_named(changes, words, warned):
    (warning,) = warned(changes) - warned({})
    assert all(word in warning for word in words)


@pytest.mark.parametrize(
    "changes",
    [
        {"limits.rotation": {"psi": ["-15 deg", "15 deg"]}},
        {"limits.rotation": {"psi": [-6.2, 6.2]}},
        {"limits.position": {"x": [-0.5, 0.5]}},
        {"limits.strut_speed": 25},
        {"drive": SCREW},
        {"drive": {"screw": {"lead": "1 mm", "inertia": "1 kg cm^2"}}},  # a stiff machine: 3.9 t
    ],
)
def test_unusual_is_not_wrong(changes, warned):
    assert warned(changes) == warned({})
