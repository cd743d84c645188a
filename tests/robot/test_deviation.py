"""Columns of what is not known exactly, against robots that deviate and motions that are late."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimation.kinematics import signs_along
from estimation.measurement_model import HarmonicMotion
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.term import STRUT_SPEED, Columns, Constant, Parameter, Term
from expdesign.robot import Robot, load_robot
from expdesign.robot.deviation import apply_deviations, deviations, tilt_axes
from tests.columns import deviation_forces, deviation_lengths, predict_forces, predict_lengths

ROBOTS = ("palida", "linuxcnc", "rubin", "mathworks", "dehaeze")
TIMES = np.linspace(0.1, 1.9, 9)

# A(v/v₀)² sign(v): not linear in its constant v₀, which no other term has.
_CURVED = Term(
    name="curved",
    meaning="for this test",
    parameters=(Parameter("curved", "N", "for this test"),),
    columns=lambda instant: Columns(
        along=instant.signs[STRUT_SPEED]
        * (instant.kinematic["strut_speed"] / instant.constants["speed"]) ** 2
    ),
    rates=(STRUT_SPEED,),
    constants=(Constant("speed", "m/s", "for this test"),),
)


def _robot(name, seed):
    """Return a robot with gravity askew and a term that has a constant."""
    about = load_robot(name).description
    rng = np.random.default_rng(seed)
    return Robot(
        dataclasses.replace(
            about,
            gravity=about.gravity + rng.normal(size=3),
            terms=(*about.terms, _CURVED),
            constants=(0.3,),
            parameters={**about.parameters, "curved": 7.0},
        )
    )


def _motion(robot, seed, size=0.05):
    rng = np.random.default_rng(seed)
    table = size * rng.normal(size=(6, 5)) * np.repeat([robot.characteristic_length, 1], 3)[:, None]
    table[:, 0] += robot.home
    return HarmonicMotion(table, 3.0)


def _forces(robot, motion, times, signs):
    return predict_forces(robot, motion, times, signs, robot.parameters)[0] @ (robot.parameters)


@pytest.mark.parametrize(("seed", "name"), list(enumerate(ROBOTS)))
def test_columns_of_the_machine_against_differences(seed, name):
    robot = _robot(name, seed)
    motion = _motion(robot, seed)
    signs = np.random.default_rng(seed).choice(
        [-1.0, 1.0], (len(TIMES), robot.graph.signs.shape[0])
    )
    chosen = [each for each in deviations(robot) if each.of_the_machine]
    forces = deviation_forces(robot, motion, TIMES, signs, robot.parameters, chosen)
    lengths = deviation_lengths(robot, motion, TIMES, chosen)
    assert len(chosen) == 36 + 2 + 1
    for k, each in enumerate(chosen):
        step = 1e-5 * (robot.characteristic_length if each.unit == "m" else 0.1)
        # Nominal parameters of the load are the machine's: they do not deviate.
        far, near = (apply_deviations(robot, [each], np.array([s * step])) for s in (1, -1))
        slope = (_forces(far, motion, TIMES, signs) - _forces(near, motion, TIMES, signs)) / (
            2 * step
        )
        np.testing.assert_allclose(
            forces[:, :, k], slope, rtol=1e-5, atol=1e-5 * np.max(np.abs(forces[:, :, k])) + 1e-9
        )
        apart = [predict_lengths(robot, motion, TIMES)[0] for robot in (far, near)]
        slope = (apart[0] - apart[1]) / (2 * step)
        np.testing.assert_allclose(lengths[:, :, k], slope, atol=1e-6)


def test_columns_of_the_measurement():
    robot = load_robot("palida")
    motion = _motion(robot, 0)
    signs = np.ones((len(TIMES), 18))
    entries = {each.name: each for each in deviations(robot) if not each.of_the_machine}
    forces, step = _forces(robot, motion, TIMES, signs), 1e-6

    def columns(name, **options):
        one = [entries[name]]
        return (
            deviation_forces(robot, motion, TIMES, signs, robot.parameters, one, **options)[..., 0],
            deviation_lengths(robot, motion, TIMES, one, **options)[..., 0],
        )

    for name, of_forces, of_lengths in (
        ("strut_length_3", 0 * forces, np.eye(6)[2] + 0 * forces),
        ("force_constant", forces, 0 * forces),
        ("force_constant_5", forces * np.eye(6)[4], 0 * forces),
        (
            "delay",
            (_forces(robot, motion.delay_by(step), TIMES, signs) - forces) / step,
            0 * forces,
        ),
        # Stamps that run fast: what is stamped t was measured at t (1 − θ).
        (
            "clock",
            (_forces(robot, motion, TIMES * (1 - step), signs) - forces) / step,
            (
                predict_lengths(robot, motion, TIMES * (1 - step))[0]
                - predict_lengths(robot, motion, TIMES)[0]
            )
            / step,
        ),
    ):
        found = columns(name)
        np.testing.assert_allclose(found[0], of_forces, atol=1e-3, rtol=1e-4)
        np.testing.assert_allclose(found[1], of_lengths, atol=1e-5)
    # With the frequency of the recording itself: the same phases, passed faster.
    faster = dataclasses.replace(motion, omega=motion.omega * (1 + step))
    slope = (_forces(robot, faster, TIMES / (1 + step), signs) - forces) / step
    found = columns("clock", own_clock=True)
    np.testing.assert_allclose(found[0], slope, atol=1e-3, rtol=1e-4)
    assert not np.any(found[1])


def test_columns_are_those_asked_for():
    robot = load_robot("palida")
    motion, signs = _motion(robot, 1), np.ones((len(TIMES), 18))
    entries = deviations(robot)
    chosen = [entries[place] for place in (44, 3, 38)]
    whole = deviation_forces(robot, motion, TIMES, signs, robot.parameters, entries)
    some = deviation_forces(robot, motion, TIMES, signs, robot.parameters, chosen)
    np.testing.assert_array_equal(some, whole[:, :, [44, 3, 38]])


@pytest.mark.parametrize("direction", range(6))
def test_moving_the_base_frame_and_the_platform_with_it_changes_nothing(direction):
    """Joints, gravity and pose moved together: the gauge freedom that data cannot see."""
    robot = load_robot("palida")
    # What depends on the directions of the cardan axes, which the entries do not move.
    values = np.where(
        np.isin(robot.parameter_names, ["p1", "p2", "p3", "r_alpha", "r_beta"]),
        0.0,
        robot.parameters,
    )
    motion, entries, step = _motion(robot, 2, 0.03), deviations(robot), 1e-5
    shift, turn = (1.0 * (np.arange(3) == direction), 1.0 * (np.arange(3) == direction - 3))
    theta = np.zeros(len(entries))
    base = robot.description.base_joints
    theta[:18] = (shift + np.cross(turn, base)).ravel()
    tilts = slice(36, 38)
    theta[tilts] = tilt_axes(robot.description.gravity) @ turn

    # Fine enough for the harmonics that turned angles have.
    count = 64
    times = np.arange(count) * 2 * np.pi / motion.omega / count
    poses = motion.at(times).state()[:, :6]

    def moved(amount):
        turned = Rotation.from_rotvec(amount * turn)
        angles = turned * Rotation.from_euler("XYZ", poses[:, 3:])
        place = turned.apply(poses[:, :3]) + amount * shift
        table = np.concatenate([place, angles.as_euler("XYZ")], axis=1)
        spectrum = np.fft.rfft(table, axis=0) / count
        spectrum[1:] *= 2
        return HarmonicMotion(
            np.concatenate(
                [spectrum[:31].real.T[:, :1], -spectrum[1:31].imag.T, spectrum[1:31].real.T], axis=1
            ),
            motion.omega,
        )

    signs = np.ones((count, 18))
    apart = [
        (
            predict_forces(robot, moved(s * step), times, signs, values)[0] @ values,
            predict_lengths(robot, moved(s * step), times)[0],
        )
        for s in (1, -1)
    ]
    by_pose = [(far - near) / (2 * step) for far, near in zip(*apart, strict=True)]
    forces = deviation_forces(robot, motion, times, signs, values, entries) @ theta
    lengths = deviation_lengths(robot, motion, times, entries) @ theta
    assert np.max(np.abs(lengths)) > 0.01
    np.testing.assert_allclose(lengths + by_pose[1], 0, atol=1e-7)
    np.testing.assert_allclose(forces + by_pose[0], 0, atol=1e-4 * np.max(np.abs(forces)))


def test_a_robot_without_gravity_has_nothing_to_tilt():
    about = load_robot("palida").description
    robot = Robot(dataclasses.replace(about, gravity=np.zeros(3)))
    tilts = [each for each in deviations(robot) if each.group == "gravity"]
    motion, signs = _motion(robot, 3), np.ones((len(TIMES), 18))
    columns = deviation_forces(robot, motion, TIMES, signs, robot.parameters, tilts)
    assert columns.shape == (len(TIMES), 6, 2)
    assert not np.any(columns)
    assert not np.any(apply_deviations(robot, tilts, np.array([0.1, 0.2])).description.gravity)


def test_the_axes_of_tilts_turn_with_gravity_and_do_not_swap():
    robot = load_robot("palida")
    tilts = [each for each in deviations(robot) if each.group == "gravity"]
    before = tilt_axes(robot.description.gravity)
    np.testing.assert_allclose(before, [[1, 0, 0], [0, 1, 0]], atol=1e-15)
    for theta in ([0.01, 0.0], [0.0, 0.01], [-0.008, 0.001]):
        after = tilt_axes(apply_deviations(robot, tilts, np.array(theta)).description.gravity)
        np.testing.assert_allclose(after, before, atol=0.011)


LACKING = {"load_friction": {"std": 0.01}, "stribeck": {"std": 2.0, "velocity": 0.05}}


def test_columns_of_lacking_terms_are_those_of_the_terms():
    """With their forces, and with those slopes of the others that they change."""
    about = load_robot("palida").description
    robot = Robot(dataclasses.replace(about, tolerances=RobotTolerances(terms=LACKING)))
    names = [*("load_friction.mu1", "load_friction.mu6"), "stribeck.s2"]
    places = [one.replace(".", "_") for one in names]
    chosen = [each for each in deviations(robot) if each.name in (*places, "base_joint_2_z")]
    moved = apply_deviations(robot, chosen, np.array([1e-3, 3.0, 0.02, -0.01]))
    assert [one.name for one in chosen] == ["base_joint_2_z", "stribeck_s2", *places[:2]]
    whole, motion = moved.extended, _motion(robot, 3)
    signs = signs_along(robot, motion.at(TIMES), np.zeros((len(TIMES), 18)))
    columns = deviation_forces(moved, motion, TIMES, signs, moved.parameters, chosen)
    regressors = predict_forces(whole, motion, TIMES, signs, whole.parameters)[0]
    at = [whole.parameter_names.index(one.partition("_")[2]) for one in ("_s2", "_mu1", "_mu6")]
    np.testing.assert_allclose(columns[:, :, 1:], regressors[:, :, at], rtol=1e-9, atol=1e-12)
    assert not np.any(deviation_lengths(moved, motion, TIMES, chosen[1:]))
    expected = deviation_forces(whole, motion, TIMES, signs, whole.parameters, chosen[:1])
    np.testing.assert_allclose(columns[:, :, :1], expected, rtol=1e-9, atol=1e-9)
