"""Columns of the terms, each against a computation of its own: from positions, and virtual work.

All terms at once, with every limit they add to, are held against sixty digits in `tests/enclosure`.
"""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from estimation.identification import estimate_parameters
from estimation.twin.disturbances import cogging_force
from expdesign.configuration import InputError, load_run
from expdesign.configuration.experiment import Cogging
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.term import Friction
from expdesign.mechanism.terms import DEFAULT, term_definitions
from expdesign.robot import load_robot, robot_from
from tests.estimation.cases import measured, trajectory

PALIDA = load_robot("palida")
PITCH = 0.024
POINTS = {
    "base_x": 0.1,
    "base_y": -0.05,
    "base_z": -1.3,
    "platform_x": 0.02,
    "platform_y": 0.01,
    "platform_z": 0.04,
    "length": 0.7,
}
PLACE = {"x": 0.05, "y": -0.02, "z": 0.11}
SEEDS = st.integers(0, 2**32 - 1)
STEP = 1e-5


@cache
def _mapping():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(terms, platform="symmetric", **parameters):
    names = [term if isinstance(term, str) else next(iter(term)) for term in terms]
    own = {p.name for name in names for p in term_definitions()[name].parameters}
    known = {k: v for k, v in _mapping()["parameters"].items() if k in own}
    changed = {"terms": terms, "platform": platform, "parameters": known | parameters}
    return robot_from(load_run({"name": "n", "robot": _mapping() | changed}).robot)


@cache
def _alone(name, **constants):
    before = [one] if (one := term_definitions()[name].constants_of) else []
    stated = {before[0] if before else name: constants} if constants else name
    return _robot(["rigid_platform", stated, *([name] if before else [])])


def _state(seed):
    rng = np.random.default_rng(seed)
    pose = PALIDA.home + np.repeat([0.05, 0.1], 3) * rng.normal(size=6)
    return pose, rng.normal(size=6), 3 * rng.normal(size=6)


def _lengths(pose):
    turned = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
    tips = pose[:3] + PALIDA.description.platform_joints @ turned.T
    return np.linalg.norm(tips - PALIDA.description.base_joints, axis=1)


def _point(pose, place):
    return pose[:3] + Rotation.from_euler("XYZ", pose[3:]).as_matrix() @ place


def _slope(function, pose):
    return np.stack(
        [(function(pose + s) - function(pose - s)) / (2 * STEP) for s in STEP * np.eye(6)], axis=-1
    )


def _speed(pose, rate):
    return (_lengths(pose + STEP * rate) - _lengths(pose - STEP * rate)) / (2 * STEP)


def _columns(name, seed, **constants):
    robot = _alone(name, **constants)
    count = len(term_definitions()[name].parameters)
    return robot.regressor(*_state(seed))[:, -count:]


# --- actuators ------------------------------------------------------------------------------------


@given(SEEDS)
@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("asymmetric_friction", np.abs),
        ("quadratic_friction", lambda v: np.abs(v) * v),
        ("cubic_friction", lambda v: v**3),
    ],
)
def test_friction_of_the_speed(name, law, seed):
    pose, rate, _ = _state(seed)
    expected = np.diag(law(_speed(pose, rate)))
    np.testing.assert_allclose(_columns(name, seed), expected, rtol=1e-6, atol=1e-8)


@given(SEEDS)
@pytest.mark.parametrize(("name", "order"), [("cogging", 1), ("cogging_second", 2)])
def test_cogging_is_a_series_of_the_length(name, order, seed):
    angle = 2 * np.pi * order * _lengths(_state(seed)[0]) / PITCH
    expected = np.hstack([np.diag(np.sin(angle)), np.diag(np.cos(angle))])
    np.testing.assert_allclose(_columns(name, seed, pitch=PITCH), expected, atol=1e-9)


@cache
def _of_two_directions():
    return _robot(["actuator_friction", "force_offset", "asymmetric_friction"])


@given(SEEDS)
def test_friction_of_two_directions_is_a_sum_of_three_terms(seed):
    """Dry and viscous friction of each direction: what is dry of the asymmetry is an offset."""
    dry, viscous = np.random.default_rng(seed).uniform(1, 20, (2, 2, 6))
    parts = ((dry[0] + dry[1]), (viscous[0] + viscous[1]), dry[0] - dry[1], viscous[0] - viscous[1])
    state = _state(seed)
    speed = _speed(*state[:2])
    forward = dry[0] + viscous[0] * speed
    expected = np.where(speed > 0, forward, -dry[1] + viscous[1] * speed)
    found = _of_two_directions().actuator_forces(*state, np.concatenate(parts) / 2)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_smoothed_asymmetric_friction_is_flat_at_rest():
    """There |v| has a kink, of which an optimiser sees none."""
    robot = _alone("asymmetric_friction")
    graph, values = robot.graph, np.zeros(11)
    forces = graph.regressor_with(Friction.SMOOTH)[:, -6:] @ ca.SX.ones(6)
    both = [forces, ca.jacobian(forces, graph.rate)]
    function = ca.Function("flat", graph.inputs(Friction.SMOOTH), both)
    at_rest = np.concatenate([PALIDA.home, np.zeros(12)])
    force, slope = function(at_rest, robot.machine, values, 0.1, 0.01)
    assert not np.any(force.full())
    assert not np.any(slope.full())
    moving = np.concatenate([PALIDA.home, np.ones(6), np.zeros(6)])
    force, _ = function(moving, robot.machine, values, 0.1, 0.01)
    np.testing.assert_allclose(force.full()[:, 0], np.abs(_speed(PALIDA.home, np.ones(6))))


@given(SEEDS)
def test_friction_along_the_stroke(seed):
    pose, rate, _ = _state(seed)
    speed, offset = _speed(pose, rate), _lengths(pose) - 0.6
    expected = np.hstack([np.diag(offset * np.sign(speed)), np.diag(offset * speed)])
    found = _columns("position_friction", seed, length=0.6)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)


@given(SEEDS)
def test_saturation_grows_with_the_third_power_of_the_load(seed):
    load = _robot(["rigid_platform"]).actuator_forces(*_state(seed))
    found = _columns("force_saturation", seed, force=150)
    np.testing.assert_allclose(found, np.diag(load**3 / 150**2), rtol=1e-9, atol=1e-12)


# --- joints ---------------------------------------------------------------------------------------


def _strut_angles(pose):
    """Return α and β, (6, 2), of the struts' directions in the frames of their cardan joints."""
    turned = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
    tips = pose[:3] + PALIDA.description.platform_joints @ turned.T
    along = tips - PALIDA.description.base_joints
    along /= np.linalg.norm(along, axis=1)[:, None]
    x, y, z = np.einsum("jka,jk->aj", PALIDA.cardan_frames, along)
    return np.stack([np.arctan2(-y, z), np.arcsin(x)], axis=1)


def _relative_rotations(pose):
    """Return the rotations of the platform in the struts' halves, (6, 3, 3)."""
    turn = Rotation.from_euler("XY", _strut_angles(pose))
    halves = PALIDA.cardan_frames @ turn.as_matrix()
    return np.swapaxes(halves, 1, 2) @ Rotation.from_euler("XYZ", pose[3:]).as_matrix()


def _turns(rotations, pose):
    """Return the slopes of the turns of rotations, (…, 3, 6), in the rotated frame."""
    slope = _slope(rotations, pose)
    skew = np.einsum("...ki,...kjc->...ijc", rotations(pose), slope)
    return np.stack([skew[..., 2, 1, :], skew[..., 0, 2, :], skew[..., 1, 0, :]], axis=-2)


def _to_actuators(pose, forces):
    """Return the forces of the actuators, (6, …), by virtual work of the pose's six numbers."""
    return np.linalg.solve(_slope(_lengths, pose).T, forces)


@given(SEEDS)
def test_viscous_joints_by_their_dissipation(seed):
    pose, rate, _ = _state(seed)
    base = _slope(_strut_angles, pose).reshape(12, 6)
    platform = _turns(_relative_rotations, pose).reshape(18, 6)
    expected = _to_actuators(pose, np.stack([b.T @ b @ rate for b in (base, platform)], axis=1))
    found = _columns("passive_viscous_friction", seed)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


# --- the platform ---------------------------------------------------------------------------------


def _turns_of_platform(pose):
    """Return the slope of the platform's turn to the pose, (3, 6), base frame."""
    rotation = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
    return rotation @ _turns(lambda at: Rotation.from_euler("XYZ", at[3:]).as_matrix(), pose)


@given(SEEDS)
def test_wrench_and_drag_by_virtual_work(seed):
    pose, rate, _ = _state(seed)
    moving = np.vstack([np.eye(3, 6), _turns_of_platform(pose)])
    expected = _to_actuators(pose, moving.T)
    size = 1e-7 * np.abs(expected).max()
    np.testing.assert_allclose(_columns("platform_wrench", seed), -expected, atol=size)
    against = expected * np.sign(moving @ rate)
    np.testing.assert_allclose(_columns("platform_drag", seed), against, atol=size)


@given(SEEDS)
def test_a_spring_of_the_platform_by_its_energy(seed):
    rest = np.array([0.03, -0.02, -0.6])

    def energies(pose):
        rotation = Rotation.from_euler("XYZ", pose[3:]).as_matrix()
        moved = 1 - np.diag(rotation)
        return np.concatenate([(pose[:3] - rest) ** 2, [moved @ k for k in 1 - 2 * np.eye(3)]]) / 2

    pose = _state(seed)[0]
    expected = _to_actuators(pose, _slope(energies, pose).T)
    found = _columns("platform_spring", seed, **dict(zip("xyz", rest, strict=True)))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@given(SEEDS)
def test_a_payload_by_virtual_work(seed):
    place = np.array(list(PLACE.values()))
    pose, rate, acceleration = _state(seed)

    def along(t):
        return _point(pose + rate * t + acceleration * t**2 / 2, place)

    step = 1e-4
    inertial = (along(step) - 2 * along(0.0) + along(-step)) / step**2
    force = inertial - PALIDA.description.gravity
    wrench = _slope(lambda at: _point(at, place), pose).T @ force
    expected = np.linalg.solve(_slope(_lengths, pose).T, wrench)
    found = _columns("payload", seed, **PLACE)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


@given(SEEDS)
def test_a_payload_is_a_combination_of_the_general_platform(seed):
    x, y, z = PLACE.values()
    share = {
        "p10": 1,
        "sx": x,
        "sy": y,
        "p9": z,
        "Ixy": -x * y,
        "Ixz": -x * z,
        "Iyz": -y * z,
        "p6": y**2 + z**2,
        "p7": x**2 + z**2,
        "p8": x**2 + y**2,
    }
    platform = _general()
    values = np.array([share[name] for name in platform.parameter_names])
    expected = platform.regressor(*_state(seed)) @ values
    found = _columns("payload", seed, **PLACE)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@cache
def _general():
    return _robot(["rigid_platform"], platform="general")


@given(SEEDS)
def test_a_gravity_compensation_by_virtual_work(seed):
    base, place = (
        np.array([POINTS[f"{end}_{axis}"] for axis in "xyz"]) for end in ("base", "platform")
    )
    pose = _state(seed)[0]

    def distance(at):
        return np.array([np.linalg.norm(_point(at, place) - base)])

    # What pushes the points apart is not asked of the actuators.
    one = np.linalg.solve(_slope(_lengths, pose).T, -_slope(distance, pose)[0])
    expected = np.stack([one, one * (distance(pose)[0] - POINTS["length"])], axis=1)
    found = _columns("gravity_compensation", seed, **POINTS)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_a_point_far_away_is_a_constant_direction():
    """A force upwards on the TCP lifts as much of the weight, wherever the platform is."""
    far = {"base_x": 0, "base_y": 0, "base_z": -1e6, "length": 1e6}
    lifted = _robot([*DEFAULT, {"gravity_compensation": far}], b_force=9.81 * 10)
    light = _mapping()["parameters"]["p10"] - 10
    for seed in range(5):
        pose, still = _state(seed)[0], np.zeros(6)
        expected = _robot([*DEFAULT], p10=light).actuator_forces(pose, still, still)
        found = lifted.actuator_forces(pose, still, still)
        np.testing.assert_allclose(found, expected, atol=1e-4)


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "key", "text"),
    [
        (["cogging_second"], "terms", "takes the constants of 'cogging'"),
        (["cogging_second", {"cogging": {"pitch": 0.02}}], "terms", "takes the constants"),
        (["cogging"], "terms.cogging.pitch", "missing"),
        ([{"cogging": {"pitch": 0}}], "terms.cogging.pitch", "not positive"),
        ([{"stribeck": {"velocity": "-50 mm/s"}}], "terms.stribeck.velocity", "not positive"),
        ([{"cogging": {"pitch": "24 mm/s"}}], "terms.cogging.pitch", "a speed, not a length"),
        ([{"payload": {"w": 1}}], "terms.payload.w", "no constant"),
        (
            [{"gravity_compensation": {"base_x": 0, "base_y": 0, "length": 1}}],
            "terms.gravity_compensation.base_z",
            "missing",
        ),
    ],
)
def test_constants_that_cannot_be(terms, key, text):
    robot = _mapping() | {"terms": [*DEFAULT, *terms]}
    with pytest.raises(InputError) as caught:
        load_run({"name": "n", "robot": robot})
    (problem,) = caught.value.problems
    assert problem.key == f"robot.{key}"
    assert text in problem.message


def test_a_scale_of_a_machine_without_gravity_or_platform():
    terms = ["asymmetric_friction", "cubic_friction", "quadratic_friction"]
    assert np.all(_robot(terms).scales == 1)
    with_platform = _robot(["rigid_platform", *terms])
    mass, length = 16.307, 0.1
    sizes = dict(zip(with_platform.parameter_names, with_platform.scales, strict=True))
    weight, speed = mass * 9.81 / 6, np.sqrt(9.81 * length)
    for order, name in ((1, "a1"), (2, "w1"), (3, "c1")):
        assert sizes[name] == pytest.approx(weight / speed**order)
    still = _mapping() | {"gravity": [0, 0, 0], "terms": ["rigid_platform", *terms]}
    still["parameters"] = {f"p{k}": _mapping()["parameters"][f"p{k}"] for k in range(6, 11)}
    weightless = robot_from(load_run({"name": "n", "robot": still}).robot)
    assert dict(zip(weightless.parameter_names, weightless.scales, strict=True))["c1"] == 1


# --- estimates ------------------------------------------------------------------------------------


def test_asymmetric_friction_and_the_cogging_of_the_twin_are_found():
    """Of the asymmetry, 20 %, the viscous part by its term, the dry one by the offsets.

    Amplitude and phase of `experiment.cogging` as sine and cosine.
    """
    cogging = Cogging(
        amplitude=(0, 3, 12, 8, 5, 0.5), pitch=(PITCH,) * 6, phase=(0, 1.1, -2.0, 0.3, 3.0, -0.4)
    )
    size, phase = np.array(cogging.amplitude), np.array(cogging.phase)
    waves = _numbered("cs", size * np.cos(phase)) | _numbered("cc", size * np.sin(phase))
    known = _mapping()["parameters"]
    apart = {
        f"{new}{j}": 0.2 * known[f"{old}{j}"] for j in range(1, 7) for new, old in ("or", "av")
    }
    terms = [*DEFAULT, "force_offset", "asymmetric_friction", {"cogging": {"pitch": PITCH}}]
    machine, quiet = _robot(terms, **waves), 1e-3
    states = _state(3)
    added = machine.actuator_forces(*states) - PALIDA.actuator_forces(*states)
    expected = cogging_force(_lengths(states[0])[None], cogging)[0]
    np.testing.assert_allclose(added, expected, atol=1e-9)

    machine, motion = _robot(terms, **waves, **apart), trajectory(100, 0.01)
    noise = {
        f"{kind}_covariance": (getattr(PALIDA.description.noise, f"{kind}_covariance") * quiet**2)
        for kind in ("force", "length")
    }
    run = load_run(
        {
            "name": "n",
            "robot": _mapping() | {"terms": terms},
            "noise": {key: value.tolist() for key, value in noise.items()},
            "estimate": {"noise": "given", "harmonics": 2, "estimators": ["gm"]},
        }
    )
    data = measured(motion, robot=machine, step=0.01, force_scale=quiet, length_scale=quiet)
    found = estimate_parameters(run, data, motion).best
    assert np.max(np.abs(found.values - machine.parameters) / found.std) < 5
    for name, value, std in zip(
        machine.parameter_names, machine.parameters, found.std, strict=True
    ):
        assert name not in apart or std < 0.1 * abs(value), name
        assert name not in waves or std < 0.05, name


def _numbered(letters, values):
    return {f"{letters}{j}": float(value) for j, value in enumerate(values, start=1)}
