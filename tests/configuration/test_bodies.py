"""`bodies`: what they make of CAD's numbers, and what is no body."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.bodies import Bodies, BodyDescription, bodies_in_words
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.term import scales_of
from expdesign.mechanism.terms.rigid_platform import GENERAL

STRUT = {
    "ring": {"mass": 0.6, "inertia": [0.0019, 0.0012, 0.0014]},
    "stator": {"mass": 9, "centre": [0, 0, "64 mm"], "inertia": [0.05, 0.049, 0.0028]},
    "slider": {"mass": 2.5, "centre": [0, 0, "-520 mm"], "inertia": [0.175, 0.175, 0.0003]},
}
PLATFORM = {"mass": 1.3, "centre": [0, 0, 0.106], "inertia": [0.0092, 0.0088, 0.0146]}


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(palida, bodies, leave_out="p", **changes):
    """Return PaLiDA with bodies, without the parameters that begin so."""
    kept = {k: v for k, v in palida["parameters"].items() if not k.startswith(leave_out)}
    return load_run(
        {"name": "n", "robot": {**palida, "bodies": bodies, "parameters": kept, **changes}}
    ).robot


def _points(body, seed=0, count=8):
    """Return masses and places (n, 3) that have a body's mass, centre and inertia about it."""
    moments, axes = np.linalg.eigh(np.array(body["matrix"]))
    squares = np.sum(moments) / 2 - moments
    arms = np.sqrt(np.maximum(3 * squares / body["mass"], 0)) * axes
    places = np.concatenate([arms.T, -arms.T]) + body["centre"]
    return np.full(6, body["mass"] / 6), places


def test_the_parameters_are_sums_over_the_masses(palida):
    """Every body as six point masses, and the model page's sums over them."""
    robot = _robot(palida, {**STRUT, "platform": PLATFORM}, platform="general")
    strut = {}
    for name, body in STRUT.items():
        given = {"centre": [0, 0, 0], **body}
        centre = [
            float(str(v).removesuffix(" mm")) * (1e-3 if "mm" in str(v) else 1)
            for v in given["centre"]
        ]
        strut[name] = _points(
            {"mass": body["mass"], "centre": centre, "matrix": np.diag(body["inertia"])}
        )

    def inertia(name, axis):
        masses, places = strut[name]
        return masses @ np.sum(np.delete(places, axis, axis=1) ** 2, axis=1)

    along = inertia("stator", 2) + inertia("slider", 2)
    p = robot.parameters
    assert p["p1"] == pytest.approx(inertia("ring", 0) + along)
    assert p["p2"] == pytest.approx(inertia("stator", 0) + inertia("slider", 0) - along)
    assert p["p3"] == pytest.approx(inertia("stator", 1) + inertia("slider", 1))
    assert p["p4"] == pytest.approx(9 * 0.064)
    assert p["p5"] == pytest.approx(-2.5 * 0.52)
    masses, places = _points({**PLATFORM, "matrix": np.diag(PLATFORM["inertia"])})
    masses = np.concatenate([masses, np.full(6, 2.5)])
    places = np.concatenate([places, robot.platform_joints])
    for name, axis in (("p6", 0), ("p7", 1), ("p8", 2)):
        across = np.delete(places, axis, axis=1)
        assert p[name] == pytest.approx(masses @ np.sum(across**2, axis=1))
    assert p["p9"] == pytest.approx(masses @ places[:, 2])
    assert p["p10"] == pytest.approx(1.3 + 6 * 2.5)
    assert p["Ixz"] == pytest.approx(-(masses * places[:, 0]) @ places[:, 2], abs=1e-12)


def test_a_frame_of_its_own_changes_nothing_of_a_body(palida):
    rng = np.random.default_rng(0)
    turn = Rotation.from_euler("XYZ", [0.3, -0.5, 1.1])
    origin = np.array([0.1, -0.2, 0.05])
    spread = rng.normal(size=(3, 3))
    matrix = np.trace(spread @ spread.T) * np.eye(3) - spread @ spread.T
    centre, mass = np.array([0.02, 0.01, 0.2]), 3.0
    inner_centre = turn.inv().apply(centre - origin)
    inner = turn.inv().as_matrix() @ matrix @ turn.as_matrix()
    about_origin = inner + mass * (
        inner_centre @ inner_centre * np.eye(3) - np.outer(inner_centre, inner_centre)
    )

    def six(m):
        return [m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]]

    place = {"origin": origin.tolist(), "rotation": [0.3, -0.5, 1.1]}
    forms = [
        {"mass": mass, "centre": centre.tolist(), "inertia": six(matrix)},
        {"mass": mass, "centre": inner_centre.tolist(), "inertia": six(inner), **place},
        {
            "mass": mass,
            "centre": inner_centre.tolist(),
            "inertia": six(about_origin),
            "about": "origin",
            **place,
        },
    ]
    made = [_robot(palida, {"platform": form, **STRUT}, platform="general") for form in forms]
    for robot in made[1:]:
        for name, value in made[0].parameters.items():
            assert robot.parameters[name] == pytest.approx(value, abs=1e-12), name


def test_bodies_that_are_fixed_to_each_other_are_one(palida):
    halves = [{"mass": 0.65, "centre": [x, 0, 0.106]} for x in (-0.1, 0.1)]
    whole = {"mass": 1.3, "centre": [0, 0, 0.106], "inertia": [0, 0.013, 0.013]}
    payload = {"mass": 2.0, "centre": [0, 0, 0.2]}
    one = _robot(palida, {**STRUT, "platform": whole, "payload": payload})
    for bodies in ({"platform": halves, "payload": payload}, {"platform": [*halves, payload]}):
        other = _robot(palida, {**STRUT, **bodies})
        for name, value in one.parameters.items():
            assert other.parameters[name] == pytest.approx(value, abs=1e-15), name


def test_a_part_that_is_not_given_leaves_its_parameters_to_be_given(palida):
    rest = {
        k: v for k, v in palida["parameters"].items() if k not in ("p1", "p2", "p3", "p4", "p5")
    }
    robot = _robot(palida, STRUT, parameters=rest)
    assert robot.parameters["p10"] == palida["parameters"]["p10"]
    assert robot.parameters["p4"] == pytest.approx(9 * 0.064)
    with pytest.raises(InputError) as caught:
        _robot(palida, STRUT)
    keys = {problem.key for problem in caught.value.problems}
    assert keys == {f"robot.parameters.p{k}" for k in range(6, 11)}


def test_a_parameter_that_is_given_counts_before_the_bodies(palida):
    bodies = {**STRUT, "platform": PLATFORM}
    kept = {k: v for k, v in palida["parameters"].items() if k[0] in "rv"}
    robot = _robot(palida, bodies, parameters=kept | {"p10": "20 kg"})
    assert robot.parameters["p10"] == 20
    about = robot.description.bodies
    text = bodies_in_words(about, robot.platform_joints, robot.parameters)
    assert "p10 = 16.3 kg" in text
    assert text.endswith("overrides p10")
    others = {name: value + 1 for name, value in robot.parameters.items()}
    assert "16.3" not in bodies_in_words(about, robot.platform_joints, others)
    assert bodies_in_words(None, robot.platform_joints, robot.parameters) == ""
    assert robot.parameters["p9"] != palida["parameters"]["p9"]


def test_what_is_resolved_is_read_again(palida, tmp_path):
    bodies = {**STRUT, "platform": {**PLATFORM, "rotation": ["10 deg", 0, 0]}}
    kept = {k: v for k, v in palida["parameters"].items() if k[0] in "rv"}
    mapping = {**palida, "bodies": bodies, "parameters": kept}
    run = load_run({"name": "n", "robot": mapping})
    path = tmp_path / "run.yaml"
    path.write_text(resolved_yaml(run), encoding="utf-8")
    again = load_run(path)
    assert again.robot.description == run.robot.description
    assert again.robot.parameters == run.robot.parameters


@pytest.mark.parametrize(
    ("bodies", "part"),
    [
        ({**STRUT, "platform": {**PLATFORM, "centre": [0.05, 0, 0]}}, "general"),
        ({**STRUT, "slider": {**STRUT["slider"], "centre": [0.02, 0, -0.5]}}, "bodies.slider"),
        (
            {**STRUT, "stator": {**STRUT["stator"], "inertia": [0.05, 0.05, 0.03, 0, 0.01, 0]}},
            "bodies.stator",
        ),
        ({**STRUT, "ring": {**STRUT["ring"], "centre": [0, 0, 0.05]}}, "bodies.ring"),
    ],
)
def test_what_the_model_does_not_have_is_told(palida, bodies, part):
    made = ("p1", "p2", "p3", "p4", "p5")
    kept = {k: v for k, v in palida["parameters"].items() if k not in made}
    clean = _robot(palida, {**STRUT, "platform": PLATFORM}, parameters=kept)
    robot = _robot(palida, bodies, parameters=kept)
    told = set(robot.warnings) - set(clean.warnings)
    assert len([text for text in told if part in text]) == 1


@pytest.mark.parametrize("about", ["centre", "origin"])
def test_a_mass_in_a_point_is_a_body(palida, about):
    x, y, z = 0.31, -0.17, 0.73
    squares = [y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z]
    squares = [3.1 * value for value in squares]
    inertia = squares if about == "origin" else [0, 0, 0]
    mass = {"mass": 3.1, "centre": [x, y, z], "inertia": inertia, "about": about}
    robot = _robot(palida, {**STRUT, "payload": mass}, platform="general")
    made = robot.description.bodies.part("payload")
    assert made.inertia[np.triu_indices(3)] == pytest.approx(
        np.array([squares[k] for k in (0, 3, 4, 1, 5, 2)]), rel=1e-12
    )


def test_rounded_moments_of_a_thin_plate_are_a_body():
    """The sum of two is the third: by less than a thousandth they may miss it."""
    assert BodyDescription(mass=3, inertia=[0.01234, 0.01235, 0.0247]).mass == 3
    with pytest.raises(ValueError, match="cannot have this inertia"):
        BodyDescription(mass=3, inertia=[0.0123, 0.0123, 0.0247])


def test_rounded_joints_and_centres_are_symmetric_enough(palida):
    joints = np.round(palida["platform_joints"], 5) + 1e-5 * np.eye(6, 3)
    bodies = {**STRUT, "platform": {**PLATFORM, "centre": [1e-6, 0, 0.106]}}
    robot = _robot(palida, bodies, platform_joints=joints.tolist())
    assert not [text for text in robot.warnings if "symmetric" in text]


def test_sums_over_symmetric_joints_are_zero_and_not_rounding_errors():
    angles = np.deg2rad(np.array([0, 20, 120, 140, 240, 260]) + 13)
    joints = np.stack([0.3 * np.cos(angles), 0.3 * np.sin(angles), np.full(6, 0.05)], axis=1)
    platform = BodyDescription(mass=12, centre=(0, 0, 0.07), inertia=[0.24, 0.24, 0.4])
    slider = BodyDescription(mass=1.7, centre=(0, 0, -0.5))
    found = Bodies(platform=(platform,), slider=(slider,)).parameters(joints)
    lateral = ("sx", "sy", "Ixy", "Ixz", "Iyz")
    assert all(found[name] == 0 for name in lateral)
    parameters = [one for one in GENERAL.parameters if one.name in lateral]
    scales = scales_of(parameters, np.array([-2e-15, 1e-16, 0.0, 0.1, 1e-17]), 12.0, 0.3, 9.81)
    np.testing.assert_allclose(scales, [3.6, 3.6, 1.08, 0.1, 1.08])
