import itertools

import numpy as np
import pytest

from expdesign.robot import ForwardKinematicsError, LimitModel, load_robot
from expdesign.trajectory import FourierTrajectory

ROBOTS = ("palida", "linuxcnc", "rubin", "mathworks", "dehaeze")
LARGEST_TURN = np.pi / 3
INCH = 0.0254


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture(scope="module")
def palida():
    return load_robot("palida")


def test_a_robot_prints_on_one_line(robot):
    text = repr(robot)
    assert text.startswith(f"Robot('{robot.name}', ")
    assert len(text) < 300
    assert "\n" not in text
    assert all(limit.key in text for limit in robot.limits)


def _workspace(robot):
    """Lower and upper ends of the poses that a robot's own position and angle limits admit."""
    limits = {limit.key: limit for limit in robot.limits}
    lower = np.full(6, -LARGEST_TURN)
    upper = np.full(6, LARGEST_TURN)
    lower[:3], upper[:3] = limits["position"].lower, limits["position"].upper
    if "tilt" in limits:
        lower[3:5], upper[3:5] = -limits["tilt"].upper, limits["tilt"].upper
    if "rotation" in limits:
        lower[3:], upper[3:] = limits["rotation"].lower, limits["rotation"].upper
    return lower, upper


def _poses_within_limits(robot, count, seed):
    lower, upper = _workspace(robot)
    rng = np.random.default_rng(seed)
    poses = rng.uniform(lower, upper, (count, 6))
    # Half of them on the edges of the workspace.
    edge = rng.random((count, 6)) < 0.5
    edge[::2] = False
    poses = np.where(edge, np.where(rng.random((count, 6)) < 0.5, lower, upper), poses)
    poses = np.concatenate([poses, list(itertools.product(*zip(lower, upper, strict=True)))])
    states = np.concatenate([poses, np.zeros((len(poses), 12))], axis=1)
    # Forces at rest are no matter of geometry: more poses are tried without their limit.
    model = LimitModel(robot, tuple(k for k in robot.limits if k.key != "actuator_force"))
    return poses[np.all(model.violations(states) <= 1e-12, axis=1)]


def test_forward_of_inverse_is_the_pose_from_home(robot):
    poses = _poses_within_limits(robot, 3000, seed=1)
    assert len(poses) > 200
    found = robot.forward_kinematics(robot.inverse_kinematics(poses))
    np.testing.assert_allclose(found, poses, rtol=0, atol=1e-10)


def test_forward_of_inverse_with_large_turns(palida):
    poses = _poses_within_limits(palida, 2000, seed=2)
    poses = poses[np.abs(poses[:, 5]) > 0.9 * LARGEST_TURN]
    assert len(poses) > 50
    found = palida.forward_kinematics(palida.inverse_kinematics(poses))
    np.testing.assert_allclose(found, poses, rtol=0, atol=1e-10)


def test_forward_kinematics_at_home(robot):
    lengths = robot.inverse_kinematics(robot.home)
    np.testing.assert_allclose(robot.forward_kinematics(lengths), robot.home, rtol=0, atol=1e-12)


def test_forward_kinematics_one_by_one_and_batched_agree(palida):
    poses = _poses_within_limits(palida, 40, seed=3)
    lengths = palida.inverse_kinematics(poses)
    batched = palida.forward_kinematics(lengths)
    single = np.array([palida.forward_kinematics(row) for row in lengths])
    np.testing.assert_allclose(batched, single, rtol=0, atol=1e-12)


def test_forward_kinematics_from_a_guess(palida):
    poses = _poses_within_limits(palida, 40, seed=4)
    lengths = palida.inverse_kinematics(poses)
    near = poses + 1e-3
    for guess in (near, near[0] * 0 + palida.home, list(palida.home)):
        found = palida.forward_kinematics(lengths, guess=guess)
        np.testing.assert_allclose(found, poses, rtol=0, atol=1e-10)
    found = palida.forward_kinematics(lengths[0], guess=near[0])
    assert found.shape == (6,)


@pytest.mark.parametrize(
    "change",
    [
        lambda lengths: 0.1 * lengths,
        lambda lengths: -lengths,
        lambda lengths: lengths * [1, 1, 1, 1, 1, 5],
        lambda lengths: lengths * [1, np.nan, 1, 1, 1, 1],
        lambda lengths: 0 * lengths,
    ],
    ids=["short", "negative", "one strut", "nan", "zero"],
)
def test_lengths_out_of_reach(palida, change):
    lengths = palida.inverse_kinematics(palida.home)
    with pytest.raises(ForwardKinematicsError) as caught:
        palida.forward_kinematics(change(lengths))
    assert caught.value.samples == (0,)


def test_lengths_out_of_reach_name_their_samples(palida):
    poses = _poses_within_limits(palida, 40, seed=5)[:9]
    lengths = palida.inverse_kinematics(poses)
    lengths[[2, 7], 4] *= 4
    with pytest.raises(ForwardKinematicsError, match="2, 7") as caught:
        palida.forward_kinematics(lengths)
    assert caught.value.samples == (2, 7)


def _trajectory(robot, seed):
    lower, upper = _workspace(robot)
    reach = np.minimum(robot.home - lower, upper - robot.home)
    amplitudes = np.random.default_rng(seed).normal(size=(2, 6, 3)) * 0.15 * reach[:, None]
    return FourierTrajectory.from_displacements(2.0, robot.home, *amplitudes)


# Central differences of eighth order: coefficients at ±1, ±2, ±3, ±4 steps.
_FIRST = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
_SECOND = np.array([8 / 5, -1 / 5, 8 / 315, -1 / 560])
_CENTER = -205 / 72


def _differences(function, times, step):
    ahead = [function(times + k * step) for k in (1, 2, 3, 4)]
    behind = [function(times - k * step) for k in (1, 2, 3, 4)]
    both = list(zip(ahead, behind, strict=True))
    first = sum(c * (a - b) for c, (a, b) in zip(_FIRST, both, strict=True)) / step
    second = sum(c * (a + b) for c, (a, b) in zip(_SECOND, both, strict=True))
    return first, (second + _CENTER * function(times)) / step**2


def test_rates_are_the_derivatives_of_the_struts(robot):
    trajectory = _trajectory(robot, seed=6)
    times = np.linspace(0, trajectory.period, 23)

    def motion(at):
        samples = trajectory.sample(at)
        return robot.strut_motion(samples.pose, samples.rate, samples.acceleration)

    here = motion(times)
    for value, rate, acceleration in (
        ("length", here.length_rate, here.length_acceleration),
        ("alpha", here.alpha_rate, None),
        ("beta", here.beta_rate, None),
    ):
        first, second = _differences(lambda at, name=value: getattr(motion(at), name), times, 1e-2)
        np.testing.assert_allclose(
            rate, first, rtol=0, atol=1e-9 * np.max(np.abs(first)), err_msg=value
        )
        if acceleration is not None:
            np.testing.assert_allclose(
                acceleration, second, rtol=0, atol=1e-8 * np.max(np.abs(second))
            )


def test_angles_give_the_strut_direction_in_its_cardan_frame(robot):
    poses = _poses_within_limits(robot, 50, seed=7)
    motion = robot.strut_motion(poses, np.zeros(6), np.zeros(6))
    sa, ca, sb, cb = (f(angle) for angle in (motion.alpha, motion.beta) for f in (np.sin, np.cos))
    local = np.stack([sb, -sa * cb, ca * cb], axis=-1)
    u = np.einsum("jab,njb->nja", robot.cardan_frames, local)
    tips = robot.description.base_joints + motion.length[:, :, None] * u
    # Distances between platform joints, and with them the platform, are those of its drawing.
    joints = robot.description.platform_joints
    for i, j in itertools.combinations(range(6), 2):
        np.testing.assert_allclose(
            np.linalg.norm(tips[:, i] - tips[:, j], axis=1),
            np.linalg.norm(joints[i] - joints[j]),
            rtol=0,
            atol=1e-12 * np.max(motion.length),
        )


def test_alpha_is_zero_at_home(robot):
    motion = robot.strut_motion(robot.home, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(motion.alpha, 0, atol=1e-14)


def test_cardan_frames_are_right_handed(robot):
    frames = robot.cardan_frames
    np.testing.assert_allclose(frames.transpose(0, 2, 1) @ frames, [np.eye(3)] * 6, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-14)
    radial = robot.description.base_joints * [1, 1, 0]
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    np.testing.assert_allclose(frames[:, :, 0], radial, atol=1e-14)


def test_length_jacobian_shapes_and_values(palida):
    poses = _poses_within_limits(palida, 10, seed=8)[:5]
    jacobians = palida.length_jacobian(poses)
    assert jacobians.shape == (5, 6, 6)
    assert palida.length_jacobian(poses[0]).shape == (6, 6)
    for i in range(6):
        step = 1e-6 * np.eye(6)[i]
        slope = palida.inverse_kinematics(poses + step) - palida.inverse_kinematics(poses - step)
        np.testing.assert_allclose(jacobians[:, :, i], slope / 2e-6, rtol=0, atol=1e-8)


BAD_SHAPES = [(), (5,), (7,), (6, 1), (2, 5), (6, 5), (2, 3, 6), (1, 1, 6)]


@pytest.mark.parametrize("shape", BAD_SHAPES, ids=str)
def test_wrong_shapes(palida, shape):
    bad, good = np.zeros(shape), palida.home
    for call in (
        lambda: palida.inverse_kinematics(bad),
        lambda: palida.length_jacobian(bad),
        lambda: palida.forward_kinematics(bad),
        lambda: palida.forward_kinematics(palida.inverse_kinematics(good), guess=bad),
        lambda: palida.strut_motion(bad, good, good),
        lambda: palida.strut_motion(good, bad, good),
        lambda: palida.regressor(good, good, bad),
        lambda: palida.actuator_forces(good, bad, good),
    ):
        with pytest.raises(ValueError, match="shape"):
            call()


def test_lengths_of_batches_that_differ(palida):
    rows = np.tile(palida.home, (3, 1))
    for call in (palida.strut_motion, palida.regressor, palida.actuator_forces):
        with pytest.raises(ValueError, match="rows"):
            call(rows, rows[:2], rows)
    with pytest.raises(ValueError, match=r"guess|broadcast"):
        palida.forward_kinematics(palida.inverse_kinematics(rows), guess=rows[:2])


@pytest.mark.parametrize("shape", [(), (23,), (25,), (24, 1), (2, 24)], ids=str)
def test_parameters_of_wrong_shape(palida, shape):
    with pytest.raises(ValueError, match="24 values"):
        palida.actuator_forces(palida.home, np.zeros(6), np.zeros(6), np.zeros(shape))


def test_empty_batches(palida):
    none = np.zeros((0, 6))
    assert palida.inverse_kinematics(none).shape == (0, 6)
    assert palida.regressor(none, none, none).shape == (0, 6, 24)


def test_large_batches_are_what_their_parts_are(palida):
    poses = np.resize(_poses_within_limits(palida, 200, seed=9), (2500, 6))
    forces = palida.actuator_forces(poses, 0 * poses + 0.1, 0 * poses - 0.2)
    again = palida.actuator_forces(poses[2000:2010], np.full(6, 0.1), np.full(6, -0.2))
    np.testing.assert_array_equal(forces[2000:2010], again)


# --- published numbers ----------------------------------------------------------------------------


def test_linuxcnc_lengths():
    robot = load_robot("linuxcnc")
    np.testing.assert_allclose(robot.home / INCH, [0, 0, 20, 0, 0, 0])
    lengths = robot.inverse_kinematics(robot.home)
    # Its coordinates are printed to three digits: the six lengths differ by as much.
    np.testing.assert_allclose(lengths / INCH, 29.7466, rtol=0, atol=3e-4)
    np.testing.assert_allclose(np.mean(lengths) / INCH, 29.7466, rtol=0, atol=5e-5)


def test_rubin_lengths():
    robot = load_robot("rubin")
    np.testing.assert_allclose(robot.home, 0)
    lengths = robot.inverse_kinematics(robot.home)
    np.testing.assert_allclose(lengths, 0.493, rtol=0, atol=5e-4)
    stroke = next(limit for limit in robot.limits if limit.key == "strut_length")
    np.testing.assert_allclose(stroke.upper - stroke.lower, 2 * 0.0141, rtol=1e-9)
    speed = next(limit for limit in robot.limits if limit.key == "strut_speed")
    np.testing.assert_allclose([-speed.lower, speed.upper], 0.5e-3)


def test_palida_at_home(palida):
    lengths = palida.inverse_kinematics(palida.home)
    np.testing.assert_allclose(lengths, 0.676, rtol=0, atol=5e-4)
    forces = palida.actuator_forces(palida.home, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(forces, -28.4, rtol=0, atol=0.05)
    motion = palida.strut_motion(palida.home, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(np.degrees(motion.beta), -35.1, rtol=0, atol=0.05)


def _on_circle(radius, degrees, height):
    angle = np.radians(degrees)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle + height], axis=1)


def test_palida_joints(palida):
    azimuth = np.array([120 * k + 8 * s for k in range(3) for s in (-1, 1)])
    base = _on_circle(0.45, azimuth, 0.0)
    azimuth = np.array([120 * k + 52 * s for k in range(3) for s in (-1, 1)])
    joints = _on_circle(0.085, azimuth, 0.104)
    np.testing.assert_allclose(palida.description.base_joints, base, atol=1e-14)
    np.testing.assert_allclose(palida.description.platform_joints, joints, atol=1e-14)


def test_mathworks_geometry():
    robot = load_robot("mathworks")
    base, joints = robot.description.base_joints, robot.description.platform_joints
    np.testing.assert_allclose(np.linalg.norm(base, axis=1), 3)
    np.testing.assert_allclose(np.linalg.norm(joints, axis=1), 1)
    np.testing.assert_allclose(robot.home, [0, 0, 2, 0, 0, 0])
    for points, offset in ((base, 2.5), (joints, 10.0)):
        # Every joint is `offset` off one of three directions 120° apart.
        azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        turned = (azimuth + 60 * (offset == 10.0) + 60) % 120 - 60
        np.testing.assert_allclose(np.abs(turned), offset, atol=1e-9)


def test_dehaeze_geometry():
    robot = load_robot("dehaeze")
    azimuth = np.array([120 * k + 10 * s for k in range(3) for s in (-1, 1)])
    base = _on_circle(0.115, azimuth, 0.0)
    joints = _on_circle(0.090, np.array([-50, 50, 70, 170, 190, -70]), 0.0)
    np.testing.assert_allclose(robot.description.base_joints, base, atol=1e-14)
    np.testing.assert_allclose(robot.description.platform_joints, joints, atol=1e-14)
    np.testing.assert_allclose(robot.home, [0, 0, 0.09, 0, 0, 0])


def test_linuxcnc_pairs_share_their_base_joints():
    base = load_robot("linuxcnc").description.base_joints
    for i, j in ((1, 2), (3, 4), (0, 5)):
        np.testing.assert_array_equal(base[i], base[j])
    clearance = next(k for k in load_robot("linuxcnc").limits if k.key == "strut_clearance")
    open_pairs = [
        label
        for label, lower in zip(clearance.labels, clearance.lower, strict=True)
        if np.isinf(lower)
    ]
    assert open_pairs == ["struts 1-6", "struts 2-3", "struts 4-5"]


def test_well_conditioned_at_home(robot):
    limit = next(k for k in robot.limits if k.key == "jacobian_condition")
    state = np.concatenate([robot.home, np.zeros(12)])[None]
    ((condition,),) = LimitModel(robot, (limit,)).values(state)
    assert 1 < condition < 2.5
