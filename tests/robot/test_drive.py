"""The inertia of drives in the forces, and the screw's thread in the lengths."""

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.hexapod import actuator_names
from expdesign.robot import load_robot, robot_from
from expdesign.robot.deviation import apply_deviations, deviations, length_deviation_columns

SCREW = {"screw": {"lead": "5 mm", "inertia": 6.3e-5}}


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(palida, **changes):
    return robot_from(load_run({"name": "n", "robot": {**palida, **changes}}).robot)


def _motion(robot, times, seed=0):
    """Return pose, rate and acceleration of a smooth motion about home, (N, 6) each."""
    rng = np.random.default_rng(seed)
    size = np.repeat([0.04, 0.15], 3) * rng.uniform(0.5, 1, 6)
    speed, phase = rng.uniform(2, 5, 6), rng.uniform(0, 6, 6)
    angle = np.outer(times, speed) + phase
    return (
        robot.home + size * np.sin(angle),
        size * speed * np.cos(angle),
        -size * speed**2 * np.sin(angle),
    )


def _derivatives(function, times, step=2e-4):
    """Return first and second derivative of a function of time, by differences of fourth order."""
    f = [function(times + k * step) for k in (-2, -1, 0, 1, 2)]
    first = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * step)
    second = (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * step**2)
    return first, second


def test_a_drive_resists_the_acceleration_of_its_strut(palida):
    direct, screw = load_robot("palida"), _robot(palida, drive=SCREW)
    times = np.linspace(0, 2, 50)
    states = _motion(direct, times)
    _, second = _derivatives(lambda t: direct.inverse_kinematics(_motion(direct, t)[0]), times)
    mass = 6.3e-5 * (2 * np.pi / 5e-3) ** 2
    more = screw.actuator_forces(*states) - direct.actuator_forces(*states)
    np.testing.assert_allclose(more, mass * second, atol=1e-4 * np.abs(mass * second).max())


# --- on a thread ----------------------------------------------------------------------------------


def _axes(palida, spread=0.3, seed=1):
    """Return axes at the platform that are nearly those at the base."""
    rng = np.random.default_rng(seed)
    return (np.array(palida["alpha_axes"]) + spread * rng.normal(size=(6, 3))).tolist()


@pytest.fixture(scope="module")
def threaded(palida):
    return _robot(palida, drive=SCREW, platform_cardan_axes=_axes(palida))


def _turn(robot, pose):
    """Return δ of each strut, rad, from the frames of its halves: (6,)."""
    about = robot.description
    geometry = about.struts_at(pose)
    found = []
    for u, base, platform in zip(
        geometry.directions,
        about.alpha_axes,
        about.platform_cardan_axes @ geometry.rotation.T,
        strict=True,
    ):
        halves = []
        for first in (base, platform):
            second = np.cross(first, u)
            second /= np.linalg.norm(second)
            halves.append(np.column_stack([second, np.cross(u, second), u]))
        between = halves[0].T @ halves[1]  # about the third axis
        assert between[2, 2] == pytest.approx(1)
        found.append(np.arctan2(between[1, 0], between[0, 0]))
    return np.array(found)


@pytest.mark.parametrize(("thread", "sign"), [("right", 1), ("left", -1)])
def test_a_turn_on_a_thread_is_the_length_less_a_part_of_the_lead(palida, thread, sign):
    """A right-handed screw that turns by δ about the strut's direction moves out by h δ/2π."""
    drive = {"screw": {**SCREW["screw"], "thread": thread}}
    robot = _robot(palida, drive=drive, platform_cardan_axes=_axes(palida))
    poses = _motion(robot, np.linspace(0, 3, 20))[0]
    distances = load_robot("palida").inverse_kinematics(poses)
    moved = distances - robot.inverse_kinematics(poses)
    turns = np.array([_turn(robot, pose) for pose in poses])
    assert np.degrees(np.abs(turns)).max() > 20
    np.testing.assert_allclose(moved, sign * 5e-3 * turns / (2 * np.pi), atol=1e-12)
    np.testing.assert_allclose(robot.forward_kinematics(robot.inverse_kinematics(poses)), poses)


def test_a_platform_that_turns_screws_parallel_struts(palida):
    """With upright struts and axes alike δ is the rotation of the platform about them."""
    points = [[np.cos(a), np.sin(a), 0] for a in np.radians([0, 50, 120, 190, 240, 300])]
    changes = {
        "home": [0, 0, 1, 0, 0, 0],
        "base_joints": points,
        "platform_joints": (np.array(points) * [1, 1, 0] + [0, 0, 0.0]).tolist(),
        "alpha_axes": [[1, 0, 0]] * 6,
        "limits": {},
    }
    # Parallel struts alone are singular: the joints at the base are moved to the sides a little.
    changes["base_joints"] = [
        [x + 0.3 * (-1) ** k * y, y - 0.3 * (-1) ** k * x, 0] for k, (x, y, _) in enumerate(points)
    ]
    robot = _robot(palida, drive=SCREW, platform_cardan_axes=[[1, 0, 0]] * 6, **changes)
    small = 1e-4
    pose = np.array([0, 0, 1, 0, 0, small])
    turned = _turn(robot, pose) - _turn(robot, robot.home)
    assert np.all(turned > 0.5 * small)
    plain = _robot(palida, **changes)
    moved = plain.inverse_kinematics([pose, robot.home]) - robot.inverse_kinematics(
        [pose, robot.home]
    )
    assert np.all(moved[0] > moved[1])


def test_speed_and_acceleration_are_derivatives_of_the_length(threaded):
    times = np.linspace(0, 2, 40)
    motion = threaded.strut_motion(*_motion(threaded, times))
    first, second = _derivatives(
        lambda t: threaded.inverse_kinematics(_motion(threaded, t)[0]), times
    )
    np.testing.assert_allclose(motion.length_rate, first, atol=1e-9 * np.abs(first).max())
    np.testing.assert_allclose(motion.length_acceleration, second, atol=1e-5 * np.abs(second).max())


def test_forces_do_the_work_of_those_without_a_thread(palida, threaded):
    """Of rigid bodies and inertia: virtual work with the derivative of the lengths themselves."""
    friction = ("r_alpha", "r_beta", *actuator_names("r"), *actuator_names("v"))
    parameters = palida["parameters"] | dict.fromkeys(friction, 0)
    screw = _robot(
        palida,
        drive=SCREW,
        platform_cardan_axes=_axes(palida, 1.0),
        parameters=parameters,
    )
    direct = _robot(palida, parameters=parameters)
    states = _motion(direct, np.linspace(0, 2, 20))
    step = 1e-6

    def slope(robot):
        moved = [
            [robot.inverse_kinematics(states[0] + s * axis) for axis in np.eye(6)]
            for s in (-step, step)
        ]
        return np.diff(moved, axis=0)[0] / (2 * step)  # (coordinate, N, strut)

    mass = screw.description.parameters["m_drive"]
    own = mass * screw.strut_motion(*states).length_acceleration
    work = np.einsum("ns,cns->nc", screw.actuator_forces(*states) - own, slope(screw))
    expected = np.einsum("ns,cns->nc", direct.actuator_forces(*states), slope(direct))
    np.testing.assert_allclose(work, expected, atol=1e-7 * np.abs(expected).max())
    assert np.abs(slope(screw) - slope(direct)).max() > 1e-4


def test_a_joint_elsewhere_moves_the_length_on_its_thread(threaded):
    chosen = [each for each in deviations(threaded) if each.group.endswith("_joints")]
    rng = np.random.default_rng(3)
    values = 1e-5 * rng.normal(size=len(chosen))
    times = np.linspace(0, 2, 5)
    state = np.concatenate([*_motion(threaded, times), np.zeros((5, 6))], axis=1)
    columns = length_deviation_columns(threaded, state, times, chosen)
    found = [
        apply_deviations(threaded, chosen, s * values).inverse_kinematics(state[:, :6])
        for s in (-1, 1)
    ]
    np.testing.assert_allclose(columns @ values, (found[1] - found[0]) / 2, atol=1e-12)


def test_axes_have_no_sign(palida, threaded):
    axes = -np.array(_axes(palida)) * [[1], [-1], [2], [1], [-3], [1]]
    other = _robot(palida, drive=SCREW, platform_cardan_axes=axes.tolist())
    pose = threaded.home + np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.1])
    np.testing.assert_allclose(
        other.inverse_kinematics(pose), threaded.inverse_kinematics(pose), atol=1e-15
    )


def test_axes_without_a_screw_or_along_a_strut_are_refused(palida):
    for drive in ("direct", {"gear": SCREW["screw"]}):
        with pytest.raises(InputError) as caught:
            _robot(palida, drive=drive, platform_cardan_axes=_axes(palida))
        assert caught.value.problems[0].key == "robot.platform_cardan_axes"
    axes = _axes(palida)
    robot = load_robot("palida")
    geometry = robot.description.struts_at(robot.home)
    axes[2] = (geometry.directions @ geometry.rotation)[2].tolist()
    with pytest.raises(InputError) as caught:
        _robot(palida, drive=SCREW, platform_cardan_axes=axes)
    assert caught.value.problems[0].key == "robot.platform_cardan_axes[3]"
