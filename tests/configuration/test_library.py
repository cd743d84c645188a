from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files, run_files

ROBOTS = ("dehaeze", "linuxcnc", "mathworks", "palida", "rubin")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    return load_robot_description(request.param)


def _home(robot):
    return robot.struts_at(robot.home)


def test_what_ships():
    assert tuple(robot_files()) == ROBOTS
    assert {"palida", "palida-quick"} <= set(run_files())


@pytest.mark.parametrize("name", run_files())
def test_runs_that_ship_load_without_a_robot_of_their_own(name):
    configuration = load_run(name)
    assert configuration.run.name == name
    assert configuration.run.stages[0] == "design"


def test_the_main_job():
    run = load_run("palida").run
    assert run.trajectory.harmonics == 5
    assert run.trajectory.frequency == (0.1, 0.6)
    assert run.trajectory.samples == 200
    assert run.trajectory.controller_period == 0.001
    assert (run.design.criterion, run.design.search, run.design.seed) == ("d", "hopping", 0)
    assert run.workers == 2


def test_every_robot_states_source_and_assumptions(robot):
    assert "ssumed" in robot.description.description
    assert "ource" in robot.description.description
    assert robot.noise.force_covariance is not None
    assert robot.noise.length_covariance is not None


def test_every_robot_is_symmetric_and_consistent(robot):
    assert robot.platform == "symmetric"
    odd = [w for w in robot.warnings if "p2 = 0.947 exceeds p3" not in w]
    assert odd == []


@pytest.mark.parametrize(
    ("name", "length", "tolerance"),
    [
        ("palida", 0.67616233648, 1e-11),
        ("linuxcnc", 29.7466 * 0.0254, 2e-5),
        ("rubin", 0.493, 1e-4),
        ("mathworks", np.sqrt(9 + 1 - 6 * np.cos(np.radians(47.5)) + 4), 1e-12),
        ("dehaeze", 0.11648, 1e-5),
    ],
)
def test_lengths_at_home(name, length, tolerance):
    lengths = _home(load_robot_description(name)).lengths
    np.testing.assert_allclose(lengths, length, atol=tolerance, rtol=0)


def test_condition_at_home():
    robot = load_robot_description("palida")
    assert _home(robot).condition(0.1) == pytest.approx(2.4011, abs=1e-4)


def test_home_is_well_inside_every_limit(robot):
    """In plain NumPy, independent of the symbolic limits."""
    home = _home(robot)
    limits = robot.limits
    values = {
        "strut_length": home.lengths,
        "beta": np.arcsin(np.sum(home.directions * robot.alpha_axes, axis=1)),
        "alpha": np.zeros(6),
        "position": robot.home[:3],
        "rotation": robot.home[3:],
        "tilt": np.arccos(home.rotation[2, 2]),
        "jacobian_condition": home.condition(robot.characteristic_length),
        "actuator_force": _static_forces(robot, home),
        "strut_speed": np.zeros(6),
        "strut_acceleration": np.zeros(6),
    }
    assert set(limits) - {"strut_clearance"} <= set(values)
    for key, limit in limits.items():
        if key != "strut_clearance":
            width = np.where(
                np.isfinite(limit.upper - limit.lower), limit.upper - limit.lower, limit.upper
            )
            assert np.all(values[key] > limit.lower + 0.1 * width), key
            assert np.all(values[key] < limit.upper - 0.1 * width), key


def _static_forces(robot, home):
    """Forces that hold the robot still: gravity of platform, sliders and stators."""
    p, arms = robot.parameters, home.joints - robot.home[:3]
    jacobian = np.hstack([home.directions, np.cross(arms, home.directions)])
    force = -p["p10"] * robot.gravity
    moment = np.cross(home.rotation @ [0, 0, p["p9"]], -robot.gravity)
    for arm, u, length in zip(arms, home.directions, home.lengths, strict=True):
        at_joint = -(p["p4"] + p["p5"]) / length * (robot.gravity - u * (u @ robot.gravity))
        force = force + at_joint
        moment = moment + np.cross(arm, at_joint)
    return np.linalg.solve(jacobian.T, np.concatenate([force, moment]))


def test_static_force_of_palida():
    robot = load_robot_description("palida")
    np.testing.assert_allclose(_static_forces(robot, _home(robot)), -28.43257579, atol=1e-7)


def test_cardan_angle_of_palida_at_home():
    robot = load_robot_description("palida")
    sines = np.sum(_home(robot).directions * robot.alpha_axes, axis=1)
    np.testing.assert_allclose(np.degrees(np.arcsin(sines)), -35.106, atol=1e-3)


def test_shared_joints():
    assert load_robot_description("linuxcnc").shared_joint_pairs == ((0, 5), (1, 2), (3, 4))
    for name in set(ROBOTS) - {"linuxcnc"}:
        assert load_robot_description(name).shared_joint_pairs == ()


def test_struts_keep_their_clearance_at_home(robot):
    home = _home(robot)
    shared = robot.shared_joint_pairs
    steps = np.linspace(0, 1, 201)[:, None]
    axes = [
        a + steps * length * u
        for a, length, u in zip(robot.base_joints, home.lengths, home.directions, strict=True)
    ]
    distances = [
        np.min(np.linalg.norm(axes[i][:, None] - axes[j], axis=2))
        for i in range(6)
        for j in range(i + 1, 6)
        if (i, j) not in shared
    ]
    limit = robot.limits["strut_clearance"]
    assert limit.lower.shape == (15,)
    assert min(distances) > 1.1 * limit.lower[0]


def test_palida_has_the_geometry_and_the_values_that_were_published_with_it():
    robot = load_robot_description("palida")
    azimuths = [120 * k + 8 * s for k in range(3) for s in (-1, 1)]
    base = [[0.45 * np.cos(np.radians(a)), 0.45 * np.sin(np.radians(a)), 0] for a in azimuths]
    np.testing.assert_allclose(robot.base_joints, base, atol=1e-15)
    azimuths = [120 * k + 52 * s for k in range(3) for s in (-1, 1)]
    platform = [
        [0.085 * np.cos(np.radians(a)), 0.085 * np.sin(np.radians(a)), 0.104] for a in azimuths
    ]
    np.testing.assert_allclose(robot.platform_joints, platform, atol=1e-15)
    variances = np.diag(robot.noise.force_covariance)
    np.testing.assert_allclose(variances, [412.8, 375.4, 883.0, 371.9, 547.2, 970.9], rtol=1e-3)
    assert robot.noise.force_covariance[0, 3] == pytest.approx(0.125 * 20.32 * 19.28)
    assert robot.noise.length_covariance[5, 0] == pytest.approx(0.3e-8)
    assert list(robot.parameters.values()) == [
        *(0.005, 0.947, 0.943, 0.579, -1.299, 0.240, 0.240, 0.123, 1.698, 16.307),
        *(0.420, 0.862, 11.958, 2.597, 14.794, 4.988, 3.451, 5.392),
        *(20.602, 20.538, 14.218, 25.279, 26.050, 23.137),
    ]


def test_rubin_moves_as_published():
    limits = load_robot_description("rubin").limits
    assert np.all(limits["strut_speed"].upper == 0.0005)
    np.testing.assert_allclose(limits["strut_length"].upper - limits["strut_length"].lower, 0.0282)


def test_files_are_package_data_next_to_the_module():
    import expdesign.library

    folder = Path(expdesign.library.__file__).parent
    assert sorted(p.stem for p in (folder / "robots").iterdir()) == list(ROBOTS)


def test_inverse_jacobian_is_the_change_of_the_lengths(robot):
    """Turned about the TCP and moved by hand, the joints give the lengths' derivatives."""
    pose = robot.home + np.array([0.01, -0.02, 0.01, 0.1, -0.05, 0.2])
    struts, step = robot.struts_at(pose), 1e-6
    arms = struts.joints - pose[:3]
    moved = [np.tile(axis, (6, 1)) for axis in np.eye(3)]
    turned = [np.cross(axis, arms) for axis in np.eye(3)]
    columns = [_slope(robot, struts.joints, velocity, step) for velocity in moved + turned]
    scale = np.max(np.abs(struts.inverse_jacobian))
    np.testing.assert_allclose(
        np.transpose(columns), struts.inverse_jacobian, rtol=0, atol=1e-7 * scale
    )
    np.testing.assert_allclose(struts.lengths, _lengths(robot, struts.joints), rtol=1e-14)


def _slope(robot, joints, velocity, step):
    ahead, behind = (_lengths(robot, joints + s * velocity) for s in (step, -step))
    return (ahead - behind) / (2 * step)


def _lengths(robot, joints):
    return np.linalg.norm(joints - robot.base_joints, axis=1)
