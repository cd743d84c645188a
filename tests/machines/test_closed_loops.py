"""Models of MuJoCo and Gazebo, whose loops are closed, as hexapods."""

import re

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from expdesign.configuration import InputError
from expdesign.machines.assumed import complete_machine
from expdesign.machines.importing import read_machine
from expdesign.machines.mechanism_graph import read_xml
from expdesign.machines.readers.mjcf import Attributes, rigid_body
from expdesign.robot import load_robot
from tests.machines import simulated as bench
from tests.machines.machines_of import asked, lengths
from tests.multibody.machine import Bodies, Geometry
from tests.multibody.machine import mjcf as machine_of_the_forces

WRITTEN = {"mjcf": (bench.mjcf, ".xml"), "sdf": (bench.sdf, ".sdf")}


def read(folder, content, suffix=".xml"):
    file = folder / f"model{suffix}"
    file.write_text(content)
    return read_machine("model", [file])


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    return {title: read(folder, write(), suffix) for title, (write, suffix) in WRITTEN.items()}


@pytest.mark.parametrize("title", WRITTEN)
def test_joints_home_and_limits_are_those_that_were_written(title, machines):
    machine = machines[title]
    np.testing.assert_allclose(machine.base_joints, bench.BASE, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, bench.PLATFORM, atol=1e-12)
    np.testing.assert_allclose(machine.home[:3], bench.POSITION, atol=1e-12)
    np.testing.assert_allclose(np.degrees(machine.home[3:]), [4, -3, 6], atol=1e-12)
    ends = bench.LENGTHS[:, None] + np.array(bench.STROKE)
    np.testing.assert_allclose(machine.limits["strut_length"], ends, atol=1e-12)
    assert machine.limits["actuator_force"] == bench.FORCE
    first = [frame.as_matrix()[:, 0] for frame in bench.FRAMES]
    if title == "sdf":
        np.testing.assert_allclose(machine.alpha_axes, first, atol=1e-12)
        assert machine.limits["strut_speed"] == 0.4
        assert machine.moved_mass == bench.PLATE
    else:
        # The direction of z alone leaves x of strut 5 open.
        others = np.delete(machine.alpha_axes, 4, 0)
        np.testing.assert_allclose(others, first[:4] + first[5:], atol=1e-12)
        assert machine.gravity == (0, 0, -9.8)
        assert machine.moved_mass == bench.PLATE + bench.PAYLOAD


@pytest.mark.parametrize("way", bench.URDF)
def test_legs_of_a_urdf_model_meet_the_platform(way, tmp_path):
    """By loops of two extensions, on one leg, floating, or as open ends of the legs alone."""
    machine = read(tmp_path, bench.urdf(way), ".urdf")
    np.testing.assert_allclose(machine.base_joints, bench.BASE, atol=1e-12)
    turned = Rotation.from_euler("XYZ", machine.home[3:])
    heads = machine.home[:3] + turned.apply(machine.platform_joints)
    np.testing.assert_allclose(heads, bench.HEADS, atol=1e-9)
    ends = bench.LENGTHS[:, None] + np.array(bench.STROKE)
    np.testing.assert_allclose(machine.limits["strut_length"], ends, atol=1e-9)
    assert (machine.limits["actuator_force"], machine.limits["strut_speed"]) == (bench.FORCE, 0.4)
    first = [frame.as_matrix()[:, 0] for frame in bench.FRAMES]
    np.testing.assert_allclose(machine.alpha_axes, first, atol=1e-12)
    if way == "open":
        assert {"home", "moved_mass"} <= asked(machine)
        np.testing.assert_allclose(np.mean(machine.platform_joints, axis=0), 0, atol=1e-12)
    else:
        assert machine.moved_mass == bench.PLATE
        np.testing.assert_allclose(machine.platform_joints, bench.PLATFORM, atol=1e-9)


def _fixed_link(parent, child, content=""):
    return (
        f'<link name="{child}">{content}</link><joint name="to-{child}" type="fixed">'
        f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0.03 0 0.05"/></joint>'
    )


@pytest.mark.parametrize("way", bench.URDF)
def test_frames_and_tools_that_are_fixed_to_links_change_no_geometry(way, tmp_path):
    """A sensor on one leg is no platform, and a tool on the plate moves no TCP."""
    content, mass = bench.urdf(way), '<inertial><mass value="0.7"/></inertial>'
    parts = _fixed_link("upper2", "sensor") + _fixed_link("tip3", "encoder")
    if way != "open":
        parts += _fixed_link("plate", "tool", mass)
    plain = read(tmp_path, content, ".urdf")
    machine = read(tmp_path, content.replace("</robot>", f"{parts}</robot>"), ".urdf")
    for name in ("base_joints", "platform_joints", "home", "alpha_axes", "limits"):
        assert getattr(machine, name) == getattr(plain, name), name
    if way != "open":
        assert machine.moved_mass == pytest.approx(bench.PLATE + 0.7)


def test_a_plate_that_is_fixed_to_the_last_joint_of_one_leg_is_the_platform(tmp_path):
    """Each leg ends in the hinges of its ball joint, which the tip carries."""
    hinges = ""
    for j in range(6):
        for parent, letter, axis in ((f"tip{j}", "x", "1 0 0"), (f"x{j}", "y", "0 1 0")):
            hinges += (
                _fixed_link(parent, f"{letter}{j}")
                .replace("0.03 0 0.05", "0 0 0")
                .replace('type="fixed">', f'type="continuous"><axis xyz="{axis}"/>')
            )
    plate = _fixed_link("y2", "plate", '<inertial><mass value="9"/></inertial>')
    content = bench.urdf("open").replace("</robot>", f"{hinges}{plate}</robot>")
    machine = read(tmp_path, content, ".urdf")
    assert machine.moved_mass == 9
    heads = machine.home[:3] + Rotation.from_euler("XYZ", machine.home[3:]).apply(
        machine.platform_joints
    )
    np.testing.assert_allclose(heads, bench.HEADS, atol=1e-9)


def test_parallel_legs_with_open_ends_give_the_base_and_the_strokes_only(tmp_path):
    upright = re.sub(r' rpy="[^"]*"', "", bench.urdf("open"))
    machine = read(tmp_path, upright, ".urdf")
    assert machine.platform_joints is None
    np.testing.assert_allclose(machine.base_joints, bench.BASE, atol=1e-12)
    assert machine.limits["strut_speed"] == 0.4
    with pytest.raises(InputError, match="legs are parallel and their ends open") as caught:
        complete_machine(machine)
    assert "--platform-joints" in str(caught.value)


def test_slides_on_the_base_itself_are_refused_with_what_the_model_has(tmp_path):
    """Legs that cannot turn are another machine, whatever the platform is."""
    legs = "".join(
        f'<link name="leg{j}"/><joint name="slide{j}" type="prismatic"><parent link="base"/>'
        f'<child link="leg{j}"/><origin xyz="{x} {y} {z}"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="0.2" effort="800" velocity="0.4"/></joint>'
        for j, (x, y, z) in enumerate(bench.BASE)
    )
    with pytest.raises(InputError, match="allowed") as caught:
        read(tmp_path, f'<robot name="m"><link name="base"/>{legs}</robot>', ".urdf")
    said = " ".join(str(caught.value).split())
    assert "it is fixed to the base; the model has 6 sliding joints" in said
    assert "0 joints that turn" in said


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('<link name="base"/>', '<xacro:leg n="1"/>', "which is not expanded"),
        ('<link name="base"/>', '<link name="tip1"/>', "no name or one that is taken"),
        ('"prismatic"', '"planar"', "the type 'planar' is not read"),
        ('"prismatic"', '"revolute"', "0 sliding joints"),
        ('<child link="upper2"/>', '<child link="tip2"/>', "two joints carry its child"),
        ('<parent link="base"/>', '<parent link="none"/>', "its parent 'none' is no link"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "has no direction"),
        ('<parent link="cross3"/>', '<parent link="tip3"/>', "it carries itself"),
    ],
)
def test_a_urdf_model_that_is_not_read_says_why(old, new, said, tmp_path):
    content = bench.urdf("open")
    assert old in content
    with pytest.raises(InputError, match="allowed") as caught:
        read(tmp_path, content.replace(old, new), ".urdf")
    assert said in str(caught.value)


def test_the_heaviest_body_is_the_platform_where_each_joint_has_a_body_of_its_own(tmp_path):
    """As CAD programs write it: six lugs that are fixed to the plate."""
    text = re.sub(
        r'<site name="joint(.)" pos="([^"]*)"/>',
        r'<body name="lug\1" pos="\2"><geom size="0.01" mass="0.1"/><site name="joint\1"/></body>',
        bench.mjcf(),
    )
    text = re.sub(r'body1="upper(.)" body2="platform"', r'body1="upper\1" body2="lug\1"', text)
    machine = read(tmp_path, text)
    np.testing.assert_allclose(machine.platform_joints, bench.PLATFORM, atol=1e-12)
    np.testing.assert_allclose(machine.home[:3], bench.POSITION, atol=1e-12)
    assert machine.moved_mass == pytest.approx(bench.PLATE + bench.PAYLOAD + 6 * 0.1)


def test_lengths_are_those_of_mujoco(machines):
    model = mujoco.MjModel.from_xml_string(bench.mjcf())
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    first = [model.body(f"lower{j}").jntadr[0] for j in range(6)]
    sites = [model.site(f"joint{j}").id for j in range(6)]
    machine = machines["mjcf"]
    np.testing.assert_allclose(machine.base_joints, data.xanchor[first], rtol=0, atol=1e-12)
    np.testing.assert_allclose(machine.alpha_axes, data.xaxis[first], rtol=0, atol=1e-12)
    rng = np.random.default_rng(7)
    for _ in range(1000):
        position, angles = np.add([0, 0, 0.7], rng.uniform(-0.2, 0.2, 3)), rng.uniform(-0.5, 0.5, 3)
        x, y, z, w = Rotation.from_euler("XYZ", angles).as_quat()
        data.qpos[:7] = [*position, w, x, y, z]
        mujoco.mj_kinematics(model, data)
        expected = np.linalg.norm(data.site_xpos[sites] - data.xanchor[first], axis=1)
        found = lengths(machine, [*position, *angles])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_the_bodies_that_forces_are_tested_with(tmp_path):
    # The platform has three slides and three hinges, and its loops are open where it is written.
    geometry = Geometry.of(load_robot("palida"))
    machine = read(tmp_path, machine_of_the_forces(geometry, Bodies()))
    np.testing.assert_allclose(machine.base_joints, geometry.base_joints, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, geometry.platform_joints, atol=1e-12)
    assert machine.home is None
    assert machine.moved_mass == Bodies().platform.mass
    assert {"home", "limits.strut_length"} <= asked(machine)


def test_bodies_are_those_that_forces_are_tested_with(tmp_path):
    geometry = Geometry.of(load_robot("palida"))
    machine = read(tmp_path, machine_of_the_forces(geometry, Bodies()))
    made = machine.bodies.parameters(np.array(machine.platform_joints))
    expected = Bodies().parameters(geometry.platform_joints)[:10]
    np.testing.assert_allclose([made[f"p{k}"] for k in range(1, 11)], expected, rtol=1e-9)
    assert "bodies" not in asked(machine)


def test_struts_that_differ_have_their_mean_and_a_question(tmp_path):
    geometry = Geometry.of(load_robot("palida"))
    text = machine_of_the_forces(geometry, Bodies())
    machine = read(tmp_path, text.replace('mass="9.0"', 'mass="9.6"', 1))
    (stator,) = machine.bodies.stator
    assert stator.mass == pytest.approx(9.1)
    assert "bodies" in asked(machine)


SHAPES = (
    'type="box" size="0.1 0.2 0.3"',
    'type="sphere" size="0.2"',
    'type="cylinder" size="0.1 0.3"',
    'type="capsule" size="0.1 0.3"',
    'type="ellipsoid" size="0.1 0.2 0.3"',
    'type="capsule" fromto="0.1 0 0 0.3 0.2 -0.4" size="0.05"',
    'type="cylinder" fromto="0.1 0 0 0.1 0 -0.4" size="0.05"',
)


CLASSES = (
    '<default><default class="turned"><geom type="box" size="0.1 0.2 0.3" mass="2" '
    'pos="0.1 0.2 0.3" euler="10 20 30"/></default></default>'
)


@pytest.mark.parametrize(
    "content",
    [
        *(f'<geom mass="2" pos="0.1 0.2 0.3" euler="10 20 30" {shape}/>' for shape in SHAPES[:5]),
        *(f'<geom mass="2" {shape}/><geom mass="1" size="0.2"/>' for shape in SHAPES[5:]),
        f'<frame pos="0.1 0 0.2" euler="40 0 0"><geom mass="3" {SHAPES[0]}/></frame>',
        '<geom class="turned"/>',
        '<geom class="turned" pos="0.3 0 0" quat="1 0.5 0.2 0.3"/>',
        '<frame childclass="turned" pos="0.1 0 0.2"><geom/></frame><geom mass="1" size="0.2"/>',
        '<inertial mass="2" pos="0.1 0 0" euler="10 20 30" diaginertia="0.1 0.2 0.25"/>',
        '<inertial mass="2" pos="0.1 0 0" fullinertia="0.1 0.2 0.25 0.01 -0.02 0.03"/>',
    ],
)
def test_masses_and_inertias_are_those_of_mujoco(content, tmp_path):
    place = 'pos="0.3 -0.1 0.2" axisangle="1 2 3 50"'
    world = f"<worldbody><body name='b' {place}>{content}</body></worldbody>"
    _compare_bodies(f"<mujoco>{CLASSES}{world}</mujoco>", tmp_path)


def test_the_total_mass_of_the_compiler_scales_all_bodies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning to a file in the current folder
    text = bench.mjcf().replace("<compiler ", '<compiler settotalmass="40" ')
    model, machine = mujoco.MjModel.from_xml_string(text), read(tmp_path, text)
    held = model.body_mass[model.body("platform").id] + model.body_mass[model.body("payload").id]
    assert machine.moved_mass == pytest.approx(held)
    assert machine.bodies.part("platform").mass == pytest.approx(held)
    inertia = model.body_inertia[model.body("upper0").id][2]
    assert machine.bodies.part("slider").inertia[2, 2] == pytest.approx(inertia)
    unknown = read(tmp_path, text.replace('mass="7.5"', 'density="1000"'))
    assert (unknown.moved_mass, unknown.bodies) == (None, None)


def test_shapes_count_where_the_compiler_says_so(tmp_path):
    inertial = '<inertial mass="2" pos="0.1 0 0" diaginertia="0.1 0.2 0.25"/>'
    world = f'<worldbody><body name="b">{inertial}<geom mass="3" {SHAPES[0]}/></body></worldbody>'
    for choice in ("auto", "true"):
        compiler = f'<compiler inertiafromgeom="{choice}"/>'
        _compare_bodies(f"<mujoco>{compiler}{world}</mujoco>", tmp_path)


def _compare_bodies(text, tmp_path):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    file = tmp_path / "model.xml"
    file.write_text(text)
    root = read_xml(file, "mujoco")
    attributes = Attributes.of(root)
    element = root.first("worldbody").first("body")
    body = rigid_body(element, attributes.place(element), attributes, None)
    axes = data.ximat[1].reshape(3, 3)
    assert body.mass == pytest.approx(model.body_mass[1])
    np.testing.assert_allclose(body.moment / body.mass, data.xipos[1], atol=1e-12)
    expected = axes @ np.diag(model.body_inertia[1]) @ axes.T
    np.testing.assert_allclose(body.about_centre, expected, atol=1e-9)


@pytest.mark.parametrize(
    "actuator",
    [
        '<position joint="slide0" gear="100" forcerange="-2 2" kp="1"/>',
        '<motor joint="slide0" gear="350" ctrlrange="-1 1" forcerange="-0.5 0.5"/>',
        '<motor joint="slide0" gear="350" ctrlrange="-1 1" ctrllimited="false"/>',
        '<motor joint="slide0" gear="-2" ctrlrange="-70 70" ctrllimited="true"/>',
    ],
)
def test_the_largest_force_of_an_actuator_is_that_of_mujoco(actuator, tmp_path):
    text = re.sub(r'<motor joint="slide0"[^>]*/>', actuator, bench.mjcf())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1e9
    mujoco.mj_forward(model, data)
    expected = abs(data.qfrc_actuator[model.joint("slide0").dofadr[0]])
    machine = read(tmp_path, text)
    if expected > 1e8:  # nothing limits it
        assert "limits.actuator_force" in asked(machine)
    else:
        assert machine.limits["actuator_force"][0] == pytest.approx(expected)


def test_a_pose_relative_to_another_frame_is_that_of_the_frame(tmp_path):
    text = bench.urdf("gazebo")
    other = re.sub(
        r"(<parent>(tip\d)</parent><child>plate</child>)<pose>[^<]*",
        r'\1<pose relative_to="\2">0 0 0 0 0 0',
        text,
    )
    found, expected = (read(tmp_path, each, ".urdf") for each in (other, text))
    for name in ("base_joints", "platform_joints"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
    with pytest.raises(InputError, match="relative to 'loop1'"):
        read(tmp_path, other.replace('relative_to="tip1"', 'relative_to="loop1"'), ".urdf")
    moved = bench.sdf().replace(
        "<inertial>", '<inertial><pose relative_to="post">0 0 0 0 0 0</pose>'
    )
    moved = moved.replace(
        "</mass>", "</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
    )
    with pytest.raises(InputError, match="relative to 'post'"):
        read(tmp_path, moved, ".sdf")


def test_links_of_gazebo_are_bodies(tmp_path):
    """The stator's inertia is in a frame of its own, upside down; the plate's has products."""
    own = (
        "<inertial><pose>0 0 0.1 3.14159265358979312 0 0</pose><mass>2</mass>"
        "<inertia><ixx>0.02</ixx><iyy>0.024</iyy><izz>0.005</izz></inertia></inertial>"
    )
    slider = (
        "<inertial><pose>0 0 -0.05 0 0 0</pose><mass>1</mass>"
        "<inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.001</izz></inertia></inertial>"
    )
    text = re.sub(r'(<link name="lower\d"><pose>[^<]*</pose>)', rf"\1{own}", bench.sdf())
    upper = r'(<link name="upper\d"><pose relative_to="lower\d">[^<]*</pose>)'
    text = re.sub(upper, rf"\1{slider}", text)
    plate = "<inertia><ixx>0.2</ixx><iyy>0.2</iyy><izz>0.3</izz><ixy>0.01</ixy></inertia>"
    mass = f"<mass>{bench.PLATE}</mass>"
    text = text.replace(mass, mass + plate)
    machine = read(tmp_path, text, ".sdf")
    (stator,), (platform,) = machine.bodies.stator, machine.bodies.platform
    np.testing.assert_allclose(stator.centre, [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(stator.inertia, [0.02, 0.024, 0.005, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(platform.inertia, [0.2, 0.2, 0.3, 0.01, 0, 0], atol=1e-12)
    # The sliders are written at the middle of struts of six lengths.
    (slider,) = machine.bodies.slider
    middle = -np.mean(bench.LENGTHS) / 2 - 0.05
    assert slider.centre[2] == pytest.approx(middle)
    assert not machine.bodies.ring
    broken = read(tmp_path, text.replace("<izz>0.3<", "<izz>0.9<"), ".sdf")
    assert not broken.bodies.platform
    assert "bodies" in asked(broken)


def test_a_cardan_joint_may_be_two_hinges_of_two_bodies_whose_axes_meet(tmp_path):
    hinges = '<joint axis="1 0 0"/><joint axis="0 2 0"/>'
    content = bench.mjcf()
    apart = content.replace(hinges, '<joint axis="1 0 0" pos="0.2 0 0"/><joint axis="0 2 0"/>')
    np.testing.assert_allclose(read(tmp_path, apart).base_joints, bench.BASE, atol=1e-12)
    # Axes that nearly meet are asked about, others are no cardan joint.
    near = content.replace(hinges, '<joint axis="1 0 0" pos="0 0.002 0"/><joint axis="0 2 0"/>')
    off = content.replace(hinges, '<joint axis="1 0 0" pos="0 0 0.1"/><joint axis="0 2 0"/>')
    assert "base_joints" not in asked(read(tmp_path, content))
    near = near.replace('pos="0 0.002 0"', 'pos="0 0 0.002"')
    assert "base_joints" in asked(read(tmp_path, near))
    with pytest.raises(InputError):
        read(tmp_path, off)


@pytest.mark.parametrize(
    ("title", "old", "new"),
    [
        ("mjcf", '<joint axis="0 2 0"/>', ""),
        ("mjcf", 'type="slide"', 'type="hinge"'),
        ("mjcf", 'axis="0 2 0"', 'axis="0 0 0"'),
        ("mjcf", 'type="slide" axis="0 0 1"', 'type="slide" axis="0 1 1"'),
        ("mjcf", 'body2="platform"', 'body2="plattform"'),
        ("mjcf", 'site2="joint1"', 'site2="joint9"'),
        ("mjcf", 'class="drive"/>', 'class="drives"/>'),
        ("mjcf", 'size="0.1" mass="7.5"', 'size="0.1" mass="heavy"'),
        ("mjcf", 'ref="0.5"', 'ref="nan"'),
        ("mjcf", "<freejoint/>", '<freejoint/><include file="/etc/passwd"/>'),
        ("mjcf", "<equality>", '<equality><weld body1="platform" body2="upper0"/>'),
        ("mjcf", "mujoco", "sdf"),
        ("sdf", "<parent>upper0</parent><child>platform", "<parent>upper0</parent><child>base"),
        ("sdf", 'type="universal"', 'type="screw"'),
        ("sdf", "<parent>base</parent>", "<parent>bass</parent>"),
        ("sdf", 'relative_to="lower0"', 'relative_to="upper0"'),
        ("sdf", "<xyz>1 0 0</xyz>", "<xyz>1 0</xyz>"),
        ("sdf", "<lower>-0.11</lower>", "<lower>low</lower>"),
        ("sdf", 'version="1.9"', ""),
        ("sdf", '<link name="base"/>', '<link name="base"/><link name="base"/>'),
        ("sdf", "<model", "<modell"),
    ],
)
def test_what_is_no_hexapod_is_told_with_its_line(title, old, new, tmp_path):
    write, suffix = WRITTEN[title]
    content = write()
    assert old in content
    changed = content.replace(old, new)
    if old == "<model":
        changed = changed.replace("</model", "</modell")
    with pytest.raises(InputError) as caught:
        read(tmp_path, changed, suffix)
    assert caught.value.problems[0].file == tmp_path / f"model{suffix}"


@pytest.mark.parametrize("text", ["", "<lower/><upper></upper>", "<lower>-inf</lower><effort/>"])
def test_limits_of_joints_that_turn_may_be_empty(text, machines, tmp_path):
    axis = "<xyz>1 0 0</xyz>"
    content = bench.sdf().replace(axis, f"{axis}<limit>{text}</limit>")
    machine = read(tmp_path, content, ".sdf")
    assert machine.limits == machines["sdf"].limits
    np.testing.assert_array_equal(machine.base_joints, machines["sdf"].base_joints)


def test_a_speed_of_no_machine_is_asked_for(machines, tmp_path):
    content = bench.sdf().replace("<velocity>0.4</velocity>", "<velocity>100</velocity>")
    machine = read(tmp_path, content, ".sdf")
    assert "strut_speed" not in machine.limits
    assert asked(machine) - asked(machines["sdf"]) == {"limits.strut_speed"}


def test_a_mechanism_without_slides_is_described_in_its_refusal(tmp_path):
    cranks = bench.sdf().replace('type="prismatic"', 'type="revolute"')
    with pytest.raises(InputError, match="0 sliding joints") as caught:
        read(tmp_path, cranks, ".sdf")
    assert "18 joints that turn" in str(caught.value)
    assert "5 closed loops" in str(caught.value)
    assert "--base-joints" in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "<mujoco>",
        bench.mjcf()[:2000],
        '<!DOCTYPE m [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>',
        '<!DOCTYPE m SYSTEM "file:///etc/passwd"><mujoco/>',
        "<mujoco><worldbody>" + "<body>" * 5000 + "</body>" * 5000 + "</worldbody></mujoco>",
        "<mujoco>\0</mujoco>",
        "<mujoco/>",
    ],
)
def test_damaged_and_hostile_files_are_refused(content, tmp_path):
    with pytest.raises(InputError):
        read(tmp_path, content)


def test_files_of_two_formats_and_unknown_ones_are_refused(tmp_path):
    (tmp_path / "a.xml").write_text(bench.mjcf())
    (tmp_path / "b.sdf").write_text(bench.sdf())
    (tmp_path / "c.step").write_text("")
    for files in (("a.xml", "b.sdf"), ("a.xml", "a.xml"), ("c.step",), ("none.xml",), ()):
        with pytest.raises(InputError):
            read_machine("m", [tmp_path / name for name in files])
    with pytest.raises(InputError):
        read_machine("m", [tmp_path])
