"""One hexapod written for MuJoCo, Gazebo and ROS: numbers first, then their ways to say them."""

import numpy as np
from scipy.spatial.transform import Rotation


def ring(radius, half_angle, middle):
    degrees = [middle + 120 * (j // 2) + half_angle * (2 * (j % 2) - 1) for j in range(6)]
    angles = np.radians(degrees)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(6)])


BASE = np.add(ring(0.5, 10, 0), [0, 0, 0.04])
PLATFORM = np.roll(ring(0.3, 12, 60), 1, axis=0) - [0, 0, 0.02]
POSITION = np.array([0.02, -0.03, 0.7])
TILTED = Rotation.from_euler("XYZ", [4, -3, 6], degrees=True)
HEADS = POSITION + TILTED.apply(PLATFORM)
LENGTHS = np.linalg.norm(HEADS - BASE, axis=1)
STROKE = (-0.11, 0.13)
FORCE = 350.0
PLATE, PAYLOAD = 7.5, 4.25


def _frame(along):
    """Return the rotation that has z along a strut, and x horizontal."""
    z = along / np.linalg.norm(along)
    x = np.cross([0, 0, 1.0], z)
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))


FRAMES = [_frame(along) for along in HEADS - BASE]


def text(numbers):
    return " ".join(repr(float(number)) for number in np.ravel(numbers))


def _orientation(j):
    """Return the orientation of a strut: every strut has another way to say it."""
    turned = FRAMES[j]
    x, y, z, w = turned.as_quat()
    vector = turned.as_rotvec()
    matrix = turned.as_matrix()
    return (
        f'quat="{text(2 * np.array([w, x, y, z]))}"',
        f'axisangle="{text([*vector, np.degrees(np.linalg.norm(vector))])}"',
        f'euler="{text(turned.as_euler("XYZ", degrees=True))}"',
        f'xyaxes="{text([*(3 * matrix[:, 0]), *(matrix[:, 1] + matrix[:, 0])])}"',
        f'zaxis="{text(matrix[:, 2])}"',
        f'quat="{text([w, x, y, z])}"',
    )[j]


def mjcf():
    """Return the model for MuJoCo; angles in degrees, half of the loops closed by sites."""
    legs, loops, sites, motors = [], [], [], []
    for j in range(6):
        place = f'pos="{text(BASE[j])}"'
        half = float(LENGTHS[j]) / 2
        leg = (
            f'<body name="lower{j}" {{}}><joint axis="1 0 0"/><joint axis="0 2 0"/>'
            f'<geom size="0.01" mass="0.5"/>'
            f'<body name="upper{j}" pos="0 0 {half!r}"><joint name="slide{j}" class="drive"/>'
            f'<geom size="0.01" mass="0.25"/><site name="head{j}" pos="0 0 {half!r}"/>'
            "</body></body>"
        )
        if j == 5:
            leg = f"<frame {place}><frame {_orientation(j)}>{leg.format('')}</frame></frame>"
        legs.append(leg.format(f"{place} {_orientation(j)}"))
        sites.append(f'<site name="joint{j}" pos="{text(PLATFORM[j])}"/>')
        if j % 2:
            loops.append(f'<connect site1="head{j}" site2="joint{j}"/>')
        else:
            loops.append(f'<connect body1="upper{j}" body2="platform" anchor="0 0 {half!r}"/>')
        motors.append(f'<motor joint="slide{j}" gear="{FORCE!r}" ctrlrange="-1 1"/>')
    x, y, z, w = TILTED.as_quat()
    low, high = (end + 0.5 for end in STROKE)
    return (
        '<mujoco model="bench"><compiler angle="degree"/><option gravity="0 0 -9.8"/>'
        f'<default><default class="drive"><joint type="slide" axis="0 0 1" ref="0.5" '
        f'range="{low!r} {high!r}"/></default></default>'
        f'<worldbody><body name="platform" pos="{text(POSITION)}" quat="{text([w, x, y, z])}">'
        f'<freejoint/><geom size="0.1" mass="{PLATE}"/>{"".join(sites)}'
        f'<body name="payload" pos="0 0 0.1"><geom size="0.1" mass="{PAYLOAD}"/></body></body>'
        f"{''.join(legs)}</worldbody><equality>{''.join(loops)}</equality>"
        f"<actuator>{''.join(motors)}</actuator></mujoco>"
    )


def sdf():
    """Return the model for Gazebo: cardan joints, slides and ball joints, base fixed to the world.

    The slides of even struts are written from the platform's side, downwards.
    """
    parts = []
    for j in range(6):
        angles = FRAMES[j].as_euler("xyz")
        up = f"0 0 {float(LENGTHS[j]) / 2!r} 0 0 0"
        parts.append(
            f'<link name="lower{j}"><pose>{text([*BASE[j], *angles])}</pose></link>'
            f'<link name="upper{j}"><pose relative_to="lower{j}">{up}</pose></link>'
            f'<joint name="cardan{j}" type="universal"><parent>base</parent><child>lower{j}</child>'
            "<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>"
            f'<joint name="ball{j}" type="ball"><pose relative_to="platform">'
            f"{text([*PLATFORM[j], 0, 0, 0])}</pose>"
            f"<parent>upper{j}</parent><child>platform</child></joint>"
        )
        ends = ("upper", "lower") if j % 2 else ("lower", "upper")
        axis = "0 0 -1" if j % 2 else "0 0 1"
        parts.append(
            f'<joint name="slide{j}" type="prismatic"><parent>{ends[0]}{j}</parent>'
            f"<child>{ends[1]}{j}</child><axis><xyz>{axis}</xyz><limit><lower>{STROKE[0]}</lower>"
            f"<upper>{STROKE[1]}</upper><effort>{FORCE}</effort><velocity>0.4</velocity></limit>"
            "</axis></joint>"
        )
    pose = text([*POSITION, *np.degrees(TILTED.as_euler("xyz"))])
    return (
        '<sdf version="1.9"><model name="bench"><link name="base"/>'
        '<joint name="ground" type="fixed"><parent>world</parent><child>base</child></joint>'
        f'<link name="platform"><pose degrees="true">{pose}</pose>'
        f"<inertial><mass>{PLATE}</mass></inertial></link>{''.join(parts)}</model></sdf>"
    )


URDF = ("loops", "gazebo", "one leg", "floating", "open")
"""Ways to say where the platform is."""


def urdf(way):
    """Return the model for ROS: legs with serial cardan joints; each leg ends in a link."""
    frames = [text(frame.as_euler("xyz")) for frame in FRAMES]
    parts = ['<link name="base"/>']
    for j in range(6):
        half = float(LENGTHS[j]) / 2
        chain = (
            ("cross", "base", "continuous", f'xyz="{text(BASE[j])}" rpy="{frames[j]}"', "1 0 0"),
            ("lower", f"cross{j}", "revolute", "", "0 2 0"),
            ("upper", f"lower{j}", "prismatic", f'xyz="0 0 {half!r}"', "0 0 1"),
            ("tip", f"upper{j}", "fixed", f'xyz="0 0 {half!r}"', "1 0 0"),
        )
        for child, parent, kind, origin, axis in chain:
            parts.append(
                f'<link name="{child}{j}"/><joint name="to-{child}{j}" type="{kind}">'
                f'<parent link="{parent}"/><child link="{child}{j}"/><origin {origin}/>'
                f'<axis xyz="{axis}"/><limit lower="{STROKE[0]}" upper="{STROKE[1]}" '
                f'effort="{FORCE}" velocity="0.4"/></joint>'
            )
    mass = f'<inertial><mass value="{PLATE}"/></inertial>'
    angles = text(TILTED.as_euler("xyz"))
    if way == "floating":
        parts.append(
            f'<link name="plate">{mass}</link><joint name="free" type="floating">'
            f'<parent link="base"/><child link="plate"/>'
            f'<origin xyz="{text(POSITION)}" rpy="{angles}"/></joint>'
        )
    elif way != "open":
        # A ball joint of three hinges, the last of which carries the plate.
        turned = FRAMES[0].inv() * TILTED
        away = text(turned.apply(-PLATFORM[0]))
        last = f'xyz="{away}" rpy="{text(turned.as_euler("xyz"))}"'
        for child, parent, origin, axis in (
            ("ball-x", "tip0", "", "1 0 0"),
            ("ball-y", "ball-x", "", "0 1 0"),
            ("ball-z", "ball-y", "", "0 0 1"),
            ("plate", "ball-z", last, ""),
        ):
            kind = "continuous" if axis else "fixed"
            parts.append(
                f'<link name="{child}">{"" if axis else mass}</link>'
                f'<joint name="to-{child}" type="{kind}"><parent link="{parent}"/>'
                f'<child link="{child}"/><origin {origin}/>'
                + (f'<axis xyz="{axis}"/></joint>' if axis else "</joint>")
            )
    for j in range(1, 6):
        if way == "loops":
            parts.append(
                f'<loop_joint name="loop{j}" type="spherical"><link1 link="tip{j}"/>'
                f'<link2 link="plate" xyz="{text(PLATFORM[j])}"/></loop_joint>'
            )
        elif way == "gazebo":
            parts.append(
                f'<gazebo><joint name="loop{j}" type="ball"><parent>tip{j}</parent>'
                f"<child>plate</child><pose>{text(PLATFORM[j])} 0 0 0</pose></joint></gazebo>"
            )
    return f'<robot name="bench">{"".join(parts)}</robot>'
