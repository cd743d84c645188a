import math
import pickle

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.robot import RobotDescription, load_robot_description, resolve_robot


@pytest.fixture
def resolve():
    """Resolve a robot given as a mapping."""

    def resolved(mapping):
        document = document_from_mapping(mapping)
        return resolve_robot(Located(RobotDescription.model_validate(mapping), document))

    return resolved


@pytest.fixture
def refused(resolve):
    """Return the problems of resolving a robot."""

    def problems(mapping):
        with pytest.raises(InputError) as caught:
            resolve(mapping)
        return caught.value.problems

    return problems


def test_arrays_and_their_shapes():
    robot = load_robot_description("palida")
    shapes = {
        "home": (6,),
        "gravity": (3,),
        "base_joints": (6, 3),
        "platform_joints": (6, 3),
        "alpha_axes": (6, 3),
        "platform_joint_axes": (6, 3),
    }
    for name, shape in shapes.items():
        array = getattr(robot, name)
        assert array.shape == shape
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    for limit in robot.limits.values():
        assert not limit.lower.flags.writeable
        assert limit.lower.shape == limit.upper.shape
    assert robot.parameter_names[9:13] == ("p10", "r_alpha", "r_beta", "r1")
    assert robot.source.name == "palida.yaml"


def test_a_robot_can_be_sent_to_another_process():
    robot = load_robot_description("linuxcnc")
    copied = pickle.loads(pickle.dumps(robot))
    assert copied.parameters == robot.parameters
    np.testing.assert_array_equal(copied.base_joints, robot.base_joints)


def test_default_alpha_axes_are_horizontal_and_radial(robot_mapping, resolve):
    robot_mapping["alpha_axes"] = None
    robot_mapping["base_joints"] = [[x, y, 0.1] for x, y, _ in robot_mapping["base_joints"]]
    robot = resolve(robot_mapping)
    expected = robot.base_joints * [1, 1, 0] / 0.45
    np.testing.assert_allclose(robot.alpha_axes, expected, atol=1e-15)


def test_given_axes_are_normalised(robot_mapping, resolve):
    robot_mapping["alpha_axes"] = [[0, 0, 5]] * 6
    robot_mapping["platform_joint_axes"] = [[0, -3, 4]] * 6
    robot = resolve(robot_mapping)
    np.testing.assert_array_equal(robot.alpha_axes, [[0, 0, 1]] * 6)
    np.testing.assert_allclose(robot.platform_joint_axes, [[0, -0.6, 0.8]] * 6, atol=1e-16)


def test_default_platform_joint_axes_are_the_struts_at_home(robot_mapping, resolve):
    robot_mapping["home"] = [0.01, 0.02, -0.66, 0.1, -0.2, 0.3]
    robot_mapping["platform_joint_axes"] = None
    robot = resolve(robot_mapping)
    cx, sx, cy, sy, cz, sz = (f(a) for a in (0.1, -0.2, 0.3) for f in (math.cos, math.sin))
    rotation = (
        np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    )
    for a, b, axis in zip(
        robot.base_joints, robot.platform_joints, robot.platform_joint_axes, strict=True
    ):
        strut = robot.home[:3] + rotation @ b - a
        np.testing.assert_allclose(rotation @ axis, strut / np.linalg.norm(strut), atol=1e-14)


def test_general_platform_without_its_parameters_takes_zeros(robot_mapping, resolve):
    robot_mapping["platform"] = "general"
    robot = resolve(robot_mapping)
    assert robot.parameter_names[9:15] == ("p10", "sx", "sy", "Ixy", "Ixz", "Iyz")
    assert [robot.parameters[name] for name in ("sx", "sy", "Ixy", "Ixz", "Iyz")] == [0.0] * 5
    assert robot.description.parameters["sx"] == 0.0


def test_general_parameters_of_a_symmetric_platform(run_mapping, the_problem):
    run_mapping["robot"]["parameters"]["Ixy"] = 0.1
    problem = the_problem(run_mapping)
    assert "Ixy" in problem.message
    assert "platform: general" in problem.message


@pytest.mark.parametrize("missing", ["name", "home", "base_joints", "platform_joints"])
def test_required_keys(run_mapping, the_problem, missing):
    del run_mapping["robot"][missing]
    problem = the_problem(run_mapping)
    assert problem.message == f"the key '{missing}' is missing"
    assert problem.key == f"robot.{missing}"


def test_required_parameters(run_mapping, problems_of):
    for name in ("p1", "r_beta", "v6"):
        del run_mapping["robot"]["parameters"][name]
    assert [p.key for p in problems_of(run_mapping)] == [
        f"robot.parameters.{name}" for name in ("p1", "r_beta", "v6")
    ]


def test_optional_keys_may_be_left_out(robot_mapping, resolve):
    for name in ("gravity", "alpha_axes", "platform_joint_axes", "platform", "noise", "limits"):
        del robot_mapping[name]
    del robot_mapping["description"]
    robot = resolve(robot_mapping)
    assert robot.gravity.tolist() == [0, 0, -9.81]
    assert robot.noise is None
    assert [limit.key for limit in robot.limits.values() if not limit.is_default] == []
    assert robot.characteristic_length == pytest.approx(np.hypot(0.085, 0.104))
    (said,) = [w for w in robot.warnings if "characteristic_length" in w]
    assert "0.1343 m" in said


def test_empty_limits_are_the_default_ones(robot_mapping, resolve):
    robot_mapping["limits"] = None
    assert list(resolve(robot_mapping).limits) == ["rotation"]
    robot_mapping["limits"] = {"rotation": "none"}
    assert list(resolve(robot_mapping).limits) == ["attitude"]
    robot_mapping["limits"] = {"rotation": "none", "tilt": "20 deg"}
    assert list(resolve(robot_mapping).limits) == ["tilt"]


def test_angles_of_home_take_degrees(run_mapping, problems_of, robot_mapping, resolve):
    robot_mapping["home"] = ["10 mm", 0, "-654 mm", "5 deg", 0, 0]
    assert resolve(robot_mapping).home[3] == math.radians(5)
    run_mapping["robot"]["home"] = ["5 deg", 0, -0.654, "5 mm", 0, 0]
    assert [p.key for p in problems_of(run_mapping)] == ["robot.home[1]", "robot.home[4]"]


def test_parameters_take_units(robot_mapping, resolve):
    robot_mapping["parameters"]["p10"] = "16307 g"
    robot_mapping["parameters"]["v1"] = "20.602 N s/m"
    robot = resolve(robot_mapping)
    assert robot.parameters["p10"] == 16.307
    assert robot.parameters["v1"] == 20.602


# --- geometry that cannot be used ---------------------------------------------------------------


def _circle(radius, height, offset=0.0):
    angles = np.radians(60 * np.arange(6) + offset)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(6, height)])


@pytest.mark.parametrize("offset", [0.0, 30.0, 17.0])
def test_equally_spaced_joints_on_two_circles_are_singular(robot_mapping, refused, offset):
    robot_mapping["base_joints"] = _circle(0.45, 0.0).tolist()
    robot_mapping["platform_joints"] = _circle(0.2, 0.0, offset).tolist()
    robot_mapping["alpha_axes"] = None
    problems = refused(robot_mapping)
    assert any("singular at home" in p.message for p in problems)
    assert all(p.key in ("home", "alpha_axes") or "alpha" in p.key for p in problems)


def test_platform_in_the_plane_of_the_base_is_singular(robot_mapping, refused):
    robot_mapping["home"] = [0, 0, -0.104, 0, 0, 0]
    (problem,) = refused(robot_mapping)
    assert "singular at home" in problem.message
    assert "condition number" in problem.message


def test_strut_without_length(robot_mapping, refused):
    robot_mapping["home"] = [0, 0, 0, 0, 0, 0]
    robot_mapping["base_joints"][3] = robot_mapping["platform_joints"][3]
    (problem,) = refused(robot_mapping)
    assert problem.message.startswith("strut 4 has no length at home")


def test_axis_along_a_strut(robot_mapping, refused):
    robot_mapping["alpha_axes"] = [[0, 0, 1]] * 6
    robot_mapping["platform_joints"][1][:2] = robot_mapping["base_joints"][1][:2]
    (problem,) = refused(robot_mapping)
    assert problem.key == "alpha_axes[2]"
    assert "along the strut at home" in problem.message


def test_base_joint_on_the_z_axis_needs_an_axis(robot_mapping, refused, resolve):
    robot_mapping["base_joints"][4] = [0, 0, 0.2]
    robot_mapping["alpha_axes"] = None
    (problem,) = refused(robot_mapping)
    assert problem.key == "base_joints[5]"
    assert "z axis" in problem.message
    robot_mapping["alpha_axes"] = [[1, 0, 0]] * 6
    assert resolve(robot_mapping).alpha_axes[4].tolist() == [1, 0, 0]


@pytest.mark.parametrize("size", [1e300, 1e-300, 1.7e308])
def test_absurd_sizes_are_refused_without_a_numerical_warning(robot_mapping, refused, size):
    robot_mapping["base_joints"] = (np.array(robot_mapping["base_joints"]) * size).tolist()
    assert refused(robot_mapping)


# --- what is legal but odd ----------------------------------------------------------------------


def test_asymmetric_geometry_of_a_symmetric_platform(robot_mapping, resolve):
    robot_mapping["platform_joints"][0][0] += 0.01
    (warning,) = [w for w in resolve(robot_mapping).warnings if "sums" in w]
    for name in ("Σ bx =", "Σ bx·by =", "Σ bx·bz ="):
        assert name in warning
    assert "Σ by =" not in warning
    robot_mapping["platform"] = "general"
    assert not any("sums" in w for w in resolve(robot_mapping).warnings)


def test_joints_rounded_to_a_hundredth_of_a_millimetre_are_symmetric(robot_mapping, resolve):
    """Nobody can do anything about it, and the forces do not change by more than 1e-4."""
    joints = np.round(np.array(robot_mapping["platform_joints"]), 5)
    joints[0] += [1e-5, -1e-5, 0]
    robot_mapping["platform_joints"] = joints.tolist()
    assert not any("sums" in w for w in resolve(robot_mapping).warnings)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"p1": -0.1}, "p1 = -0.1 is not positive"),
        ({"p10": 0.0}, "p10 = 0 is not positive"),
        ({"r3": -1.0}, "r3 = -1 is negative"),
        ({"v2": -1.0}, "v2 = -1 is negative"),
        ({"p2": 2.0}, "p2 = 2 exceeds p3"),
        ({"p2": -2.0}, "p1 + p2 = -1.995 is negative"),
        ({"p8": 1.0}, "no body has the platform's mass"),
        ({"p9": 3.0}, "no body has the platform's mass"),
    ],
)
def test_inconsistent_parameters_are_a_warning(robot_mapping, resolve, changed, says):
    robot_mapping["parameters"] |= {"p2": 0.94, **changed}
    warnings = resolve(robot_mapping).warnings
    assert any(says in w for w in warnings), warnings


def test_consistent_parameters_are_no_warning(robot_mapping, resolve):
    robot_mapping["parameters"]["p2"] = 0.94
    assert resolve(robot_mapping).warnings == ()


def test_products_of_inertia_count(robot_mapping, resolve):
    robot_mapping["platform"] = "general"
    robot_mapping["parameters"] |= {"p2": 0.94, "Ixy": 0.2}
    (warning,) = resolve(robot_mapping).warnings
    assert "no body" in warning
