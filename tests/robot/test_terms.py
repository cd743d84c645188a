"""Terms: the blocks of the regressor, and one that no file of the package knows."""

import json
import pickle

import casadi as ca
import numpy as np
import pytest

from constraints.plugins import declarations
from estimation.identification import estimate_parameters
from estimation.measurement_model.prediction import force_kernel
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.robot import load_robot_description
from expdesign.evaluation.batch import BatchFunction, Graph
from expdesign.mechanism import terms as terms_package
from expdesign.mechanism.term import STRUT_SPEED, Friction, Term, parameters_of
from expdesign.mechanism.terms import DEFAULT, known_parameters, term_definitions, terms_named
from expdesign.robot import robot_from
from tests.estimation.cases import measured, trajectory

OFFSETS = dict(zip(("o1", "o2", "o3", "o4", "o5", "o6"), (8, -5, 12, -9, 4, 6), strict=True))


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(palida, **changes):
    """Return PaLiDA with changes of its file; only the parameters of the terms are kept."""
    mapping = {**palida, **changes}
    if "parameters" not in changes:
        described = [t if isinstance(t, str) else next(iter(t)) for t in mapping["terms"]]
        kept = {p.name for p in parameters_of(terms_named(described, general=False))}
        mapping["parameters"] = {k: v for k, v in mapping["parameters"].items() if k in kept}
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


def _states(robot, count=20, seed=0):
    rng = np.random.default_rng(seed)
    size = np.repeat([0.05, 0.1], 3)
    pose = robot.home + size * rng.normal(size=(count, 6))
    return pose, rng.normal(size=(count, 6)), 3 * rng.normal(size=(count, 6))


# --- the blocks -----------------------------------------------------------------------------------


def test_every_term_is_declared_once():
    declared = [term.name for term in declarations(Term, terms_package, "TERM", "TERMS")]
    assert sorted(declared) == sorted(set(declared)) == sorted(term_definitions())
    assert len(declared) == 23
    assert len(known_parameters()) == len(parameters_of(tuple(term_definitions().values())))


def test_terms_reach_other_processes():
    assert pickle.loads(pickle.dumps(dict(term_definitions()))) == term_definitions()


def test_the_default_is_listed_in_full(palida):
    assert palida["terms"] == list(DEFAULT)
    unsaid = {key: value for key, value in palida.items() if key != "terms"}
    assert load_run({"name": "n", "robot": unsaid}).robot.terms == _robot(palida).terms


@pytest.mark.parametrize(
    "terms",
    [
        ["actuator_friction", "struts", "rigid_platform", "passive_friction"],
        ["rigid_platform", "struts"],
        ["force_offset", "actuator_friction"],
    ],
)
def test_columns_do_not_depend_on_the_other_terms(palida, terms):
    whole = _robot(palida, terms=[*DEFAULT, "force_offset"])
    robot = _robot(palida, terms=terms)
    columns = [whole.parameter_names.index(name) for name in robot.parameter_names]
    expected = whole.regressor(*_states(whole))[:, :, columns]
    np.testing.assert_allclose(robot.regressor(*_states(robot)), expected, rtol=1e-12, atol=1e-12)


def test_only_rates_that_a_term_uses_have_signs(palida):
    assert _robot(palida, terms=["struts", "rigid_platform"]).graph.signs.numel() == 0
    assert _robot(palida, terms=["actuator_friction"]).graph.rates == (STRUT_SPEED,)
    robot = _robot(palida)
    assert robot.graph.signs.numel() == 18
    jumping = {
        n for n, jumps in zip(robot.parameter_names, robot.graph.jumping, strict=True) if jumps
    }
    assert jumping == {"r_alpha", "r_beta", *(f"r{j}" for j in range(1, 7))}


def _scales(robot):
    return dict(zip(robot.parameter_names, robot.scales, strict=True))


def test_parameters_without_a_nominal_value_are_compared_with_the_machine(palida):
    zero = dict.fromkeys(("p4", "p6", "p9", "r1"), 0.0)
    names = [*DEFAULT, "force_offset"]
    robot = _robot(palida, terms=names, parameters={**palida["parameters"], **zero})
    scales = _scales(robot)
    assert scales["p4"] == scales["p9"] == pytest.approx(16.307 * 0.1)
    assert scales["p6"] == pytest.approx(16.307 * 0.1**2)
    assert scales["r1"] == 1
    assert scales["o3"] == pytest.approx(16.307 * 9.81 / 6)
    assert scales["p5"] == 1.299
    assert _scales(_robot(palida, terms=["struts", "force_offset"]))["o1"] == 1


# --- the robot file -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "key", "text", "nearest"),
    [
        (["struts", "rigid_platfrom"], "terms", "rigid_platfrom", "rigid_platform"),
        (["struts", "struts"], "terms", "twice", None),
        ([], "terms", "not a list", None),
        ("struts", "terms", "not a list", None),
        ([{"struts": {"pitch": 1}}], "terms.struts.pitch", "pitch", None),
        ([{"struts": 1}], "terms", "not a mapping", None),
    ],
)
def test_what_is_no_list_of_terms(palida, terms, key, text, nearest):
    with pytest.raises(InputError) as caught:
        load_run({"name": "n", "robot": {**palida, "terms": terms}})
    (problem,) = caught.value.problems
    assert problem.key == f"robot.{key}"
    assert text in problem.message
    assert problem.nearest == nearest


def test_parameters_are_those_of_the_terms(palida):
    names = ["struts", "rigid_platform", "actuator_friction", "force_offset"]
    parameters = {k: v for k, v in palida["parameters"].items() if k != "v3"} | {"o2": "0.02 kN"}
    with pytest.raises(InputError) as caught:
        load_run({"name": "n", "robot": {**palida, "terms": names, "parameters": parameters}})
    found = {problem.key: problem.message for problem in caught.value.problems}
    assert set(found) == {f"robot.parameters.{name}" for name in ("v3", "r_alpha", "r_beta")}
    assert "passive_friction" in found["robot.parameters.r_beta"]
    parameters = {k: v for k, v in parameters.items() if k[:2] != "r_"} | {"v3": 14}
    robot = _robot(palida, terms=names, parameters=parameters)
    assert robot.description.parameters["o2"] == 20
    assert robot.description.parameters["o3"] == 0


# --- constant forces ------------------------------------------------------------------------------


def test_offsets_are_added_to_the_forces(palida):
    plain = _robot(palida)
    robot = _robot(
        palida, terms=[*DEFAULT, "force_offset"], parameters={**palida["parameters"], **OFFSETS}
    )
    states = _states(robot)
    np.testing.assert_allclose(
        robot.actuator_forces(*states) - plain.actuator_forces(*states),
        np.tile(list(OFFSETS.values()), (20, 1)),
        rtol=0,
        atol=1e-10,
    )


def test_a_model_without_any_sign_is_estimated(palida):
    offsets = ["struts", "rigid_platform", "force_offset"]
    parameters = {k: v for k, v in palida["parameters"].items() if k[0] == "p"} | OFFSETS
    mapping = {**palida, "terms": offsets, "parameters": parameters}
    run = load_run({"name": "n", "robot": mapping, "estimate": {"estimators": ["gm", "ml"]}})
    robot = robot_from(run.robot)
    found = estimate_parameters(run, measured(trajectory(), robot=robot))
    for estimator in ("gm", "ml"):
        one = found.estimates[estimator]
        assert np.max(np.abs(one.values - robot.parameters) / one.std) < 5


# --- friction that depends on speed and load, springs ---------------------------------------------


@pytest.fixture
def stribeck(palida):
    def robot(velocity, **changes):
        terms = [*DEFAULT, {"stribeck": {"velocity": velocity}}]
        return _robot(palida, terms=terms, parameters=palida["parameters"], **changes)

    return robot


def test_a_constant_is_an_input_of_one_graph(stribeck):
    slow, fast = stribeck("50 mm/s"), stribeck(0.4)
    assert slow.graph is fast.graph
    states = _states(slow)
    speed = slow.strut_motion(*states).length_rate
    for robot, velocity in ((slow, 0.05), (fast, 0.4)):
        own = robot.regressor(*states)[:, :, 24:]
        expected = np.sign(speed) * np.exp(-((speed / velocity) ** 2))
        np.testing.assert_allclose(np.einsum("njj->nj", own), expected, rtol=1e-10, atol=1e-300)


def test_the_derivative_to_a_constant_is_there_for_its_estimation(stribeck):
    robot = stribeck({"value": 0.4, "estimate": True})
    (described,) = (t for t in robot.description.description.terms if t.name == "stribeck")
    assert described.constants["velocity"].estimate
    graph, p = robot.graph, np.concatenate([robot.parameters[:24], np.full(6, 5.0)])
    forces = graph.regressor_with(Friction.EXACT) @ graph.parameters
    slope = ca.jacobian(forces, graph.constants)
    kernel = BatchFunction(
        Graph("slope", [graph.state], [graph.machine, graph.parameters], [slope])
    )
    states = _states(robot)
    (found,) = kernel(np.concatenate(states, axis=1), robot.machine, p)
    ends = [stribeck(0.4 + step).actuator_forces(*states, p) for step in (1e-6, -1e-6)]
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-5)


def test_constants_are_written_and_read_again(palida, tmp_path):
    for velocity in (0.05, {"value": 0.05, "estimate": True}):
        terms = [*DEFAULT, {"stribeck": {"velocity": velocity}}]
        run = load_run({"name": "n", "robot": {**palida, "terms": terms}})
        file = tmp_path / "run.yaml"
        file.write_text(resolved_yaml(run), encoding="utf-8")
        again = load_run(file)
        assert again.run.robot.terms == run.run.robot.terms
        assert again.robot.constants == (0.05,)
        json.dumps(run.run.model_dump(mode="json"))


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ("stribeck", "missing"),
        ({"stribeck": {"velocity": "50 mm"}}, "a length, not a speed"),
        ({"stribeck": {"velocety": 1}}, "velocety"),
        ({"stribeck": {"velocity": {"value": 1, "estimated": True}}}, "velocity.*'estimated'"),
        ({"stribeck": {"velocity": {"estimate": True}}}, "velocity.*value"),
        ({"stribeck": {"velocity": {"value": 1, "estimate": "yes"}}}, "velocity.estimate.*yes"),
    ],
)
def test_constants_that_cannot_be(palida, given, text):
    with pytest.raises(InputError, match=text):
        load_run({"name": "n", "robot": {**palida, "terms": [*DEFAULT, given]}})


def test_a_term_may_take_the_load_of_the_actuators(palida):
    names = [*DEFAULT, "load_friction"]
    robot = _robot(palida, terms=names, parameters=palida["parameters"])
    states = _states(robot)
    # What bears on the actuators without friction, by the robot that has none.
    rigid = _robot(palida, terms=["struts", "rigid_platform"])
    speed = robot.strut_motion(*states).length_rate
    expected = np.sign(speed) * np.abs(rigid.actuator_forces(*states))
    own = robot.regressor(*states)[:, :, 24:]
    np.testing.assert_allclose(np.einsum("njj->nj", own), expected, rtol=1e-10)
    assert np.count_nonzero(own) == 6 * len(states[0])


def test_forces_at_other_parameters_take_their_load_there(palida):
    names = [*DEFAULT, "load_friction"]
    robot = _robot(palida, terms=names, parameters=palida["parameters"])
    states = _states(robot)
    values = robot.parameters.copy()
    values[robot.parameter_names.index("p10")] *= 1.5
    values[24:] = 0.05
    changed = dict(zip(robot.parameter_names, values, strict=True))
    expected = _robot(palida, terms=names, parameters=changed).actuator_forces(*states)
    found = robot.actuator_forces(*states, values)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-10)
    assert _robot(palida).with_load_at(robot.parameters[:24]).load_parameters is None


def test_springs_pull_about_their_rest_length(palida):
    terms = [*DEFAULT, {"cable": {"rest_length": "600 mm"}}]
    stiffness = {f"k{j}": 10.0 * j for j in range(1, 7)}
    robot = _robot(palida, terms=terms, parameters=palida["parameters"] | stiffness)
    states = _states(robot)
    lengths = robot.inverse_kinematics(states[0])
    np.testing.assert_allclose(
        robot.actuator_forces(*states) - _robot(palida).actuator_forces(*states),
        (lengths - 0.6) * 10 * np.arange(1, 7),
        rtol=1e-9,
        atol=1e-10,
    )


def test_offsets_take_what_a_rest_length_is_wrong_by(palida):
    """One column is a combination of the others: only the offsets move with the rest length."""
    ends = [
        _robot(
            palida,
            terms=["force_offset", {"cable": {"rest_length": length}}],
            parameters={f"k{j}": 0.0 for j in range(1, 7)},
        )
        for length in (0.5, 0.7)
    ]
    first, second = (robot.regressor(*_states(robot)) for robot in ends)
    moved = first[:, :, 6:] - 0.2 * first[:, :, :6]
    np.testing.assert_allclose(moved, second[:, :, 6:], atol=1e-12)


@pytest.mark.parametrize("estimator", ["gm", "ml"])
def test_the_load_is_that_of_the_estimate(palida, estimator):
    """A nominal mass that is 30 % too small would make the shares 30 % too large."""
    names = [*DEFAULT, "load_friction"]
    shares = {f"mu{j}": 0.1 for j in range(1, 7)}
    machine = _robot(palida, terms=names, parameters=palida["parameters"] | shares)
    light = palida["parameters"] | {"p10": 0.7 * palida["parameters"]["p10"], "p9": 0.0}
    mapping = {**palida, "terms": names, "parameters": light | shares}
    run = load_run({"name": "n", "robot": mapping, "estimate": {"estimators": [estimator]}})
    data = measured(trajectory(), robot=machine, force_scale=0.1, length_scale=0.01)
    found = estimate_parameters(run, data)
    one = found.estimates[estimator]
    errors = (one.values - machine.parameters) / one.std
    assert np.max(np.abs(errors)) < 4.5
    assert np.all(one.std[24:] < 0.1 * 0.3)
    load = found.robot.load_parameters
    assert load is not None
    np.testing.assert_allclose(load, one.values, atol=5 * np.max(one.std))


def test_slopes_to_the_state_with_constants_and_load(palida):
    names = [
        *DEFAULT,
        {"stribeck": {"velocity": 0.4}},
        "load_friction",
        {"cable": {"rest_length": 0.6}},
    ]
    extra = {f"{n}{j}": v for j in range(1, 7) for n, v in (("s", 4.0), ("mu", 0.1), ("k", 50.0))}
    robot = _robot(palida, terms=names, parameters=palida["parameters"] | extra)
    state = np.concatenate(_states(robot, count=3), axis=1)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (3, 18))
    kernel = force_kernel(robot.terms)

    def forces(at):
        regressors, _ = kernel(at, signs, robot.machine, robot.parameters)
        return regressors @ robot.parameters

    _, slope = kernel(state, signs, robot.machine, robot.parameters)
    for column in range(18):
        step = 1e-6 * np.eye(18)[column]
        difference = (forces(state + step) - forces(state - step)) / 2e-6
        np.testing.assert_allclose(slope[:, :, column], difference, rtol=1e-4, atol=1e-3)
