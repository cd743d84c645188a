import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.configuration.geometry import JointRing
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files

ROOT_3 = 3**0.5


def _robot(tmp_path, **joints):
    text = robot_files()["linuxcnc"].read_text(encoding="utf-8")
    _, _, rest = text.partition("platform: symmetric")
    rest, _, _ = rest.partition("limits:")
    lines = [f"{key}: {value}" for key, value in joints.items()]
    path = tmp_path / "robot.yaml"
    path.write_text(
        "\n".join(["name: n", "home: [0, 0, 400 mm, 0, 0, 0]", *lines, rest]), encoding="utf-8"
    )
    return path


BASE = "{radius: 300 mm, half_angle: 10 deg, pairs: 1-2}"


def test_points_computed_by_hand():
    ring = JointRing(radius="2 m", half_angle="30 deg", pairs="1-2", z="5 mm")
    expected = [
        *([ROOT_3, -1], [ROOT_3, 1], [0, 2], [-ROOT_3, 1]),  # at -30°, 30°, 90°, 150°
        *([-ROOT_3, -1], [0, -2]),  # at 210°, 270°
    ]
    np.testing.assert_allclose(np.array(ring.points)[:, :2], expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(np.array(ring.points)[:, 2], 0.005)


def test_the_other_pairs_computed_by_hand():
    ring = JointRing(radius=1, half_angle=0, pairs="2-3")
    meets = [(0.5, -ROOT_3 / 2), (0.5, ROOT_3 / 2), (-1, 0)]
    expected = [meets[0], meets[1], meets[1], meets[2], meets[2], meets[0]]
    np.testing.assert_allclose(np.array(ring.points)[:, :2], expected, rtol=0, atol=1e-15)


@given(
    radius=st.floats(1e-3, 10),
    half=st.floats(0, 59.9),
    rotation=st.floats(-360, 360),
    pairs=st.sampled_from([("1-2", 0), ("2-3", 1)]),
)
@settings(max_examples=20, deadline=None)
def test_every_ring_has_three_pairs(radius, half, rotation, pairs):
    word, first = pairs
    ring = JointRing(
        radius=radius, half_angle=f"{half} deg", pairs=word, rotation=f"{rotation} deg"
    )
    points = np.array(ring.points)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius)
    shifted = np.roll(points, -first, axis=0)
    apart = np.linalg.norm(shifted[1::2] - shifted[::2], axis=1)
    np.testing.assert_allclose(apart, 2 * radius * np.sin(np.radians(half)), atol=1e-12 * radius)
    middle = points[0] + points[1]  # in the direction of the rotation, whatever the pairs are
    wanted = np.array([np.cos(np.radians(rotation)), np.sin(np.radians(rotation)), 0])
    np.testing.assert_allclose(np.cross(middle, wanted), 0, atol=1e-12 * radius)
    assert middle @ wanted > 0
    turned = points[:2, :2] @ np.array([[-0.5, ROOT_3 / 2], [-ROOT_3 / 2, -0.5]])
    np.testing.assert_allclose(points[2:4, :2], turned, atol=1e-12 * radius)


def test_a_robot_file_takes_circles_in_place_of_points(tmp_path):
    platform = "{radius: 150 mm, half_angle: 10 deg, pairs: 2-3, rotation: 5 deg, z: -20 mm}"
    robot = load_robot_description(_robot(tmp_path, base_joints=BASE, platform_joints=platform))
    assert robot.base_joints.shape == (6, 3)
    angle = np.radians(5 - 50)
    first = [0.15 * np.cos(angle), 0.15 * np.sin(angle), -0.02]
    np.testing.assert_allclose(robot.platform_joints[0], first)
    assert isinstance(robot.description.base_joints[0], tuple)  # resolved: the points themselves


def test_the_circles_of_the_docs_are_those_of_palida():
    palida = load_robot_description("palida")
    base = JointRing(radius="450 mm", half_angle="8 deg", pairs="1-2")
    platform = JointRing(radius="85 mm", half_angle="8 deg", pairs="2-3", z="104 mm")
    np.testing.assert_allclose(base.points, palida.base_joints, atol=1e-9)
    np.testing.assert_allclose(platform.points, palida.platform_joints, atol=1e-9)
