import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.configuration import InputError, load_run
from expdesign.configuration.geometry import JointRing
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files
from expdesign.machines.machine import MachineDraft, Question, format_quantity
from expdesign.machines.writing import write_files
from expdesign.robot import robot_from


def _ring(radius, half_angle, pairs, **more):
    return JointRing(radius=radius, half_angle=f"{half_angle} deg", pairs=pairs, **more)


def _written(machine, folder):
    files = write_files(machine, folder)
    configuration = load_run(files.run)
    robot_from(configuration.robot)
    return files, configuration


def test_a_machine_of_which_nothing_is_known_passes(tmp_path):
    files, configuration = _written(MachineDraft("unknown"), tmp_path)
    assert all(text.startswith("assumed, to be checked") for text in configuration.warnings)
    assert configuration.robot.name == configuration.run.name == "unknown"
    text = files.robot.read_text(encoding="utf-8")
    lines = text.splitlines()
    assert {"bodies", "parameters"} <= set(files.assumed)
    parts = text.partition("\nbodies:\n")[2].partition("\n\n")[0].splitlines()
    assert [line.split(":")[0].strip() for line in parts] == [
        "ring",
        "stator",
        "slider",
        "platform",
    ]
    assert all(line.endswith("# assumed") for line in parts)
    for key in set(files.assumed) - {"bodies", "parameters"}:
        (stands,) = (n for n, line in enumerate(lines) if line.strip().startswith(f"{key}:"))
        assert "assumed" in lines[stands], key
        assert lines[stands - 1].strip().startswith("# ? "), key
    assert max(map(len, lines)) <= 120


@pytest.mark.parametrize("name", robot_files())
def test_what_is_known_comes_back_to_the_last_bit(name, tmp_path):
    known = load_robot_description(name)
    description = known.description
    machine = MachineDraft(
        name,
        source=description.description,
        base_joints=description.base_joints,
        platform_joints=description.platform_joints,
        home=description.home,
        gravity=description.gravity,
        alpha_axes=description.alpha_axes,
        platform_joint_axes=description.platform_joint_axes,
        limits=description.limits,
        parameters=description.parameters,
        force_std=description.noise.force_std or (1.0,) * 6,
        length_std=(1e-5 / 3,) * 6,
    )
    _, configuration = _written(machine, tmp_path)
    robot = configuration.robot
    for key in ("base_joints", "platform_joints", "home", "gravity", "alpha_axes"):
        np.testing.assert_array_equal(getattr(robot, key), getattr(known, key))
    assert robot.parameters == known.parameters
    assert robot.description.noise.length_std == machine.length_std
    assert robot.description.description.split() == description.description.split()
    for key, limit in known.limits.items():
        np.testing.assert_array_equal(robot.limits[key].lower, limit.lower)
        np.testing.assert_array_equal(robot.limits[key].upper, limit.upper)


@given(
    base=st.floats(0.05, 5),
    share=st.floats(0.3, 0.9),
    half=st.tuples(st.floats(0, 25), st.floats(0, 25)),
    height=st.floats(0.4, 2),
    side=st.sampled_from([-1, 1]),
)
@settings(max_examples=8, deadline=None)
def test_circles_are_where_they_are_said_to_be(tmp_path_factory, base, share, half, height, side):
    machine = MachineDraft(
        "circles",
        base_joints=_ring(base, half[0], "1-2"),
        platform_joints=_ring(share * base, half[1], "2-3"),
        home=(0, 0, side * height * base, 0, 0, 0),
    )
    _, configuration = _written(machine, tmp_path_factory.mktemp("circles"))
    robot = configuration.robot
    assert not [text for text in configuration.warnings if "inconsistent" in text]
    # By the law of cosines: all struts are alike, between directions 60° − h1 − h2 apart.
    apart = math.radians(60 - half[0] - half[1])
    across = (1 + share**2 - 2 * share * math.cos(apart)) * base**2
    expected = math.hypot(math.sqrt(across), height * base)
    np.testing.assert_allclose(robot.struts_at(robot.home).lengths, expected, rtol=1e-12)


def test_joints_without_symmetry_make_a_general_platform(tmp_path):
    joints = np.add(_ring(0.2, 10, "2-3").points, [0.01, -0.02, 0.03])
    machine = MachineDraft(
        "tilted",
        base_joints=_ring(0.4, 10, "1-2"),
        platform_joints=tuple(map(tuple, joints.tolist())),
        home=(0, 0, 0.5, 0.05, 0, 0),
        moved_mass=20.0,
    )
    _, configuration = _written(machine, tmp_path)
    assert all(text.startswith("assumed, to be checked") for text in configuration.warnings)
    p = configuration.robot.parameters
    assert configuration.robot.platform == "general"
    # The middle of all masses is that of the joints.
    np.testing.assert_allclose(
        [p["sx"], p["sy"], p["p9"]], p["p10"] * np.array([0.01, -0.02, 0.03]), rtol=1e-3
    )


def test_a_home_that_nobody_told_is_in_the_middle_of_the_stroke(tmp_path):
    machine = MachineDraft(
        "lifted",
        base_joints=_ring(0.4, 10, "1-2"),
        platform_joints=_ring(0.2, 10, "2-3", z=-0.1),
        limits={"strut_length": [0.7, 0.9], "actuator_force": 200.0},
    )
    files, configuration = _written(machine, tmp_path)
    robot = configuration.robot
    np.testing.assert_allclose(robot.struts_at(robot.home).lengths, 0.8, atol=5e-3)
    assert {"home", "parameters"} <= set(files.assumed)
    assert not {"strut_length", "actuator_force", "base_joints"} & set(files.assumed)


def test_components_that_nobody_told_are_assumed_each_for_itself(tmp_path):
    files, configuration = _written(
        MachineDraft("x", limits={"position": {"x": [-0.2, 0.3]}}), tmp_path
    )
    position = configuration.robot.limits["position"]
    assert (position.lower[0], position.upper[0]) == (-0.2, 0.3)
    assert np.all(np.isfinite(position.lower))
    assert {"position.y", "position.z"} <= set(files.assumed)
    assert not {"position", "position.x"} & set(files.assumed)
    lines = files.robot.read_text(encoding="utf-8").splitlines()
    (stands,) = (n for n, line in enumerate(lines) if line.startswith("  position:"))
    assert lines[stands].endswith("y, z assumed")
    assert lines[stands - 1].startswith("  # ? ")


def test_questions_of_the_source_stand_where_they_belong(tmp_path):
    machine = MachineDraft(
        "asked",
        source="A file\nof a controller: # not a comment",
        questions=(
            Question("limits.strut_length", "Is ±1000 a limit?"),
            Question("noise.force_std", "Which current sensor?"),
            Question("", "Which controller?"),
            Question("elsewhere", "What of it?\nrobot: palida"),
        ),
    )
    files, configuration = _written(machine, tmp_path)
    text = files.robot.read_text(encoding="utf-8")
    assert configuration.robot.description.description.endswith("# not a comment")
    assert text.index("Which controller?") < text.index("\nname:")
    assert text.index("Is ±1000") < text.index("  strut_length:") < text.index("  strut_speed:")
    assert text.index("\nnoise:") < text.index("Which current sensor?") < text.index("  force_std:")
    assert "# ? elsewhere: What of it? robot: palida\n" in text


@pytest.mark.parametrize(
    ("known", "key"),
    [
        ({"base_joints": _ring(0.3, 10, "1-2")}, "platform_joints"),
        ({"platform_joints": _ring(0.3, 10, "1-2")}, "base_joints"),
        ({"home": (0, 0, 0, 0, 0, 0)}, "home"),  # all struts in one plane
        ({"limits": {"strut_length": [0.5, 0.4]}}, "limits.strut_length"),
        (
            {"limits": {"strut_length": [0.5, 0.6]}, "home": (0, 0, 0.3, 0, 0, 0)},
            "limits.strut_length",
        ),
        ({"limits": {"strut_speeds": 1}}, "limits.strut_speeds"),
        ({"force_std": (-1.0,) * 6}, "noise.force_std[1]"),
        ({"parameters": {"p11": 1.0}}, "parameters.p11"),
        ({"home": (0, 0, math.nan, 0, 0, 0)}, "home[3]"),
        (
            {"home": (0, 0, 0.3, 0, math.pi / 2, 0)},
            "home",
        ),  # a base on its side
    ],
)
def test_what_does_not_fit_together_is_told_and_nothing_is_written(tmp_path, known, key):
    with pytest.raises(InputError) as caught:
        write_files(replace(MachineDraft("wrong"), **known), tmp_path)
    assert key in [problem.key for problem in caught.value.problems]
    assert all(problem.file is None for problem in caught.value.problems)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("there", ["known.yaml", "known-run.yaml"])
def test_what_is_there_is_not_written_over(tmp_path, there):
    (tmp_path / there).write_text("mine", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        write_files(MachineDraft("known"), tmp_path)
    assert caught.value.problems[0].file == tmp_path / there
    assert [path.name for path in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text(encoding="utf-8") == "mine"


@given(value=st.floats(-1e6, 1e6), unit=st.sampled_from(["m", "rad", "N", "m/s", "m/s^2", "1"]))
@settings(max_examples=60, deadline=None)
def test_a_number_is_written_so_that_it_comes_back(value, unit):
    from expdesign.configuration.quantity import quantity_in
    from tests.docs.pages import parse

    assert quantity_in(unit).parse(parse(format_quantity(value, unit))) == value
