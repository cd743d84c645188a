"""Lists of joints in JSON, YAML, CSV and MATLAB files of several layouts."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from expdesign.configuration import InputError
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.schema import validate
from expdesign.machines.importing import MachineDescription, machine_from_answers, read_machine
from tests.machines.machines_of import asked
from tests.machines.test_matlab import ring

BASE = ring(0.45, 0, 8)
PLATFORM = np.roll(ring(0.25, 60, 12, -0.05), 1, axis=0)
HOME = [0.0, 0.0, 0.7]


def _points(points):
    return [dict(zip("xyz", point, strict=True)) for point in points.tolist()]


def _rows(names, *ends):
    """Return CSV with one line for each joint."""
    table = [
        f"{name}{j};{x};{y};{z}"
        for name, points in zip(names, ends, strict=True)
        for j, (x, y, z) in enumerate(points.tolist(), 1)
    ]
    return "\n".join(["joint;x [mm];y [mm];z [mm]", *table])


def _columns(unit, *points):
    """Return CSV with one line for each strut."""
    head = [f"{end}_{axis}{unit}" for end in ("base", "platform") for axis in "xyz"]
    table = np.hstack(points).tolist()
    return "\n".join([",".join(head), *(",".join(map(str, row)) for row in table)])


def _named(*ends):
    return "height: 0.7\n" + "".join(
        f"{name}_{j}: {point}\n"
        for name, points in zip("ab", ends, strict=True)
        for j, point in enumerate(points.tolist(), 1)
    )


LISTS = {"basePoints": BASE.tolist(), "topPoints": PLATFORM.tolist(), "height": 0.7, "unit": "m"}
OBJECTS = {
    "units": "mm",
    "h": 700,
    "lower": {"joints": _points(1e3 * BASE)},
    "upper": {"joints": _points(1e3 * PLATFORM)},
}
LEGS = [{"fixed": a, "moving": b} for a, b in zip(BASE.tolist(), PLATFORM.tolist(), strict=True)]
COORDINATES = {
    "base": dict(zip("xyz", BASE.T.tolist(), strict=True)),
    "platform": dict(zip("xyz", PLATFORM.T.tolist(), strict=True)),
    "height": 0.7,
}
TEXTS = {
    "lists.json": json.dumps(LISTS),
    "objects.json": json.dumps(OBJECTS),
    "struts.json": json.dumps({"height": 0.7, "legs": LEGS}),
    "named.yaml": _named(BASE, PLATFORM),
    "coordinates.yml": json.dumps(COORDINATES),
    "reversed.yaml": "\n".join(
        _named(BASE, PLATFORM).splitlines()[:7] + _named(BASE, PLATFORM).splitlines()[:6:-1]
    ),
    "long names.json": json.dumps(
        {
            f"{a}{'9' * 5000}_{j}": p
            for a, e in zip("ab", (BASE, PLATFORM), strict=True)
            for j, p in enumerate(e.tolist(), 1)
        }
        | {"height": 0.7}
    ),
    "quantity.yaml": _named(BASE, PLATFORM).replace("0.7", "700 mm"),
    "over the base.json": json.dumps(LISTS | {"topPoints": (PLATFORM + HOME).tolist()}),
    "struts.csv": _columns("", BASE, PLATFORM + HOME),
    "millimetres.csv": _columns(" [mm]", 1e3 * BASE, 1e3 * (PLATFORM + HOME)),
    "joints.csv": _rows(("base", "top"), 1e3 * BASE, 1e3 * (PLATFORM + HOME)),
    "comma.csv": _rows(("base", "top"), 1e3 * BASE, 1e3 * (PLATFORM + HOME)).replace(".", ","),
    "height in a row.csv": _rows(("base", "top"), 1e3 * BASE, 1e3 * PLATFORM).strip()
    + "\nheight;;;700 mm\n",
    "height of every joint.csv": "\n".join(
        f"{line};{'700 mm' if number else 'height'}"
        for number, line in enumerate(
            _rows(("base", "top"), 1e3 * BASE, 1e3 * PLATFORM).splitlines()
        )
    ),
    "height in a column.csv": "\n".join(
        f"{line},{'0.7' if number else 'height'}"
        for number, line in enumerate(_columns("", BASE, PLATFORM).strip().splitlines())
    ),
}
WITH_UNIT = {
    "lists.json",
    "over the base.json",
    "objects.json",
    "millimetres.csv",
    "joints.csv",
    "comma.csv",
    "height in a row.csv",
    "height of every joint.csv",
}
STRUCT = {"Aa": BASE, "Ab": PLATFORM + HOME, "Bb": PLATFORM, "L": 0.7 * np.ones(6)}
MATRICES = {
    "older struct": {"stewart": STRUCT},
    "struct with a height": {"stewart": {"Aa": BASE.T, "Bb": PLATFORM.T, "H": 0.7}},
    "plain matrices": {"A": BASE.T, "B": PLATFORM.T, "h": 0.7, "R": np.eye(3)},
    "one letter differs": {"Az": BASE, "Bz": PLATFORM, "h": 0.7},
    "homogeneous": {"B": np.vstack([BASE.T, np.ones(6)]), "P": np.vstack([PLATFORM.T, np.ones(6)])}
    | {"h": 0.7},
    "millimetres": {"base_mm": 1e3 * BASE, "platform_mm": 1e3 * PLATFORM, "height": 700.0},
}


def _assert_is_the_machine(machine):
    np.testing.assert_allclose(machine.base_joints, BASE, atol=1e-12)
    joints = np.array(machine.platform_joints) + machine.home[:3]
    np.testing.assert_allclose(joints, PLATFORM + HOME, atol=1e-12)


@pytest.mark.parametrize("name", TEXTS)
def test_a_list_of_joints(name, tmp_path):
    (tmp_path / name).write_text(TEXTS[name], encoding="utf-8")
    machine = read_machine("m", [tmp_path / name])
    _assert_is_the_machine(machine)
    assert ("base_joints" in asked(machine)) == (name not in WITH_UNIT)


@pytest.mark.parametrize(
    ("given", "lengths", "unread"),
    [
        ({"min_length": 600, "max_length": 800, "stroke": 200}, [0.6, 0.8], ""),
        ({"min_length": 600, "stroke": 200}, [0.6, 0.8], ""),
        ({"strut_length": ["600 mm", "0.8 m"]}, [0.6, 0.8], ""),
        ({"strut_length": [600, 800], "max_speed": 0.5}, [0.6, 0.8], "max_speed"),
        ({"strut_length": [600, 800], "max_speed": "500 mm/s"}, [0.6, 0.8], "max_speed"),
        ({"stroke": 200}, None, "stroke"),
        ({"min_length": 600, "max_length": 800, "stroke": 300}, [0.6, 0.8], "stroke"),
    ],
)
def test_lengths_of_struts_and_what_is_not_read(given, lengths, unread, tmp_path):
    joints = {"base": (1e3 * BASE).tolist(), "top": (1e3 * PLATFORM).tolist()}
    content = json.dumps(joints | {"height": 700, "unit": "mm"} | given)
    (tmp_path / "m.yaml").write_text(content, encoding="utf-8")
    machine = read_machine("m", [tmp_path / "m.yaml"])
    assert machine.limits.get("strut_length") == (lengths and pytest.approx(lengths))
    said = " ".join(one.text for one in machine.questions)
    assert (f"Not read from the file: {unread}." in said) == bool(unread)


def _machine(platform, tmp_path, in_file=None, stated=None):
    joints = {"base": BASE.tolist(), "top": platform.tolist(), "unit": "m"}
    joints |= {} if in_file is None else {"height": in_file}
    (tmp_path / "m.json").write_text(json.dumps(joints), encoding="utf-8")
    answers = {"name": "m"} | ({} if stated is None else {"home_height": stated})
    document = document_from_mapping(answers)
    located = Located(validate(MachineDescription, document.data, document), document)
    return machine_from_answers(located, read_machine("m", [tmp_path / "m.json"]))


def test_joints_over_the_base_keep_their_place_whoever_states_the_height(tmp_path):
    platform, near = PLATFORM + HOME, 0.68
    in_file = _machine(platform, tmp_path, in_file=near)
    stated = _machine(platform, tmp_path, stated=near)
    for machine in (in_file, stated):
        assert machine.home[2] == pytest.approx(near)
        joints = np.array(machine.platform_joints) + machine.home[:3]
        np.testing.assert_allclose(joints, platform, atol=1e-12)
        assert "platform_joints" in asked(machine)
    assert asked(stated) == asked(in_file)


def test_another_height_moves_the_platform(tmp_path):
    machine = _machine(PLATFORM + HOME, tmp_path, stated=2 * HOME[2])
    joints = np.array(machine.platform_joints)
    np.testing.assert_allclose(joints - joints.mean(axis=0), joints, atol=1e-12)
    assert machine.home[2] == 2 * HOME[2]


@pytest.mark.parametrize("suffix", ["json", "mat"])
@pytest.mark.parametrize("also", ["", "platform"])
def test_sets_of_joints_by_the_names_that_are_given(suffix, also, tmp_path):
    file, unknown = tmp_path / f"m.{suffix}", {"unten": BASE, "oben": PLATFORM, "h": 0.7}
    unknown |= {also: PLATFORM - 1} if also else {}
    if suffix == "mat":
        savemat(file, unknown)
    else:
        file.write_text(json.dumps(unknown, default=np.ndarray.tolist), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_machine("m", [file])
    assert "Name them: --base-joints unten --platform-joints oben" in str(caught.value)
    _assert_is_the_machine(read_machine("m", [file], {"base": "unten", "platform": "oben"}))
    with pytest.raises(InputError, match="0 sets of joints of the base; sets of six points: unten"):
        read_machine("m", [file], {"base": "mitte", "platform": "oben"})


@pytest.mark.parametrize("name", MATRICES)
def test_matrices_of_a_matlab_file(name, tmp_path):
    savemat(tmp_path / "m.mat", MATRICES[name])
    machine = read_machine("m", [tmp_path / "m.mat"])
    _assert_is_the_machine(machine)
    assert "base_joints" in asked(machine)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"lower": BASE.tolist()}, "2 sets of joints of the base; sets of six points: base, top"),
        ({"base": BASE[:5].tolist()}, "0 sets of joints of the base; sets of six points: top"),
        ({"unit": "kg"}, "'1 kg' is a mass, not a length"),
    ],
)
def test_other_lists_are_refused_with_the_sets_that_they_have(changed, said, tmp_path):
    joints = {"base": BASE.tolist(), "top": PLATFORM.tolist()} | changed
    (tmp_path / "m.json").write_text(json.dumps(joints), encoding="utf-8")
    with pytest.raises(InputError, match="allowed") as caught:
        read_machine("m", [tmp_path / "m.json"])
    assert said in str(caught.value)
