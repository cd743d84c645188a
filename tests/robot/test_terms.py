"""Terms: the blocks of the regressor, and one that no file of the package knows."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from estimation.identification import estimate
from estimation.measurement_model.prediction import force_kernel
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism import catalogue
from expdesign.mechanism.catalogue import DEFAULT, TERMS, known_parameters, terms_named
from expdesign.mechanism.graph import Friction
from expdesign.mechanism.term import (
    STRUT_SPEED,
    Columns,
    Constant,
    Parameter,
    Term,
    parameters_of,
    per_actuator,
)
from expdesign.robot import robot_from
from expdesign.robot.batch import BatchFunction
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
    folder = Path(catalogue.__file__).parent / "terms"
    assert set(TERMS) == {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert len(known_parameters()) == len(parameters_of(tuple(TERMS.values())))


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
        ([], "terms", "no list", None),
        ("struts", "terms", "no list", None),
        ([{"struts": {"pitch": 1}}], "terms.struts.pitch", "pitch", None),
        ([{"struts": 1}], "terms", "no mapping", None),
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
    found = estimate(run, measured(trajectory(), robot=robot))
    for estimator in ("gm", "ml"):
        one = found.estimates[estimator]
        assert np.max(np.abs(one.values - robot.parameters) / one.std) < 5


# --- terms to come --------------------------------------------------------------------------------


def _stribeck_columns(instant):
    ratio = instant.kinematic["strut_speed"] / instant.constants["velocity"]
    return Columns(along=ca.diag(instant.signs[STRUT_SPEED] * ca.exp(-(ratio**2))))


STRIBECK = Term(
    name="stribeck",
    meaning="friction of the actuators that falls with the speed",
    parameters=per_actuator(
        Parameter("s", "N", "static friction beyond the dry one", lower=0, default=0.0)
    ),
    columns=_stribeck_columns,
    rates=(STRUT_SPEED,),
    constants=(Constant("velocity", "m/s", "speed at which it has fallen to 1/e"),),
)
LOADED = Term(
    name="loaded",
    meaning="friction of the actuators as a share of their load",
    parameters=(Parameter("m", "1", "share of the load", lower=0, default=0.0),),
    columns=lambda instant: Columns(along=instant.signs[STRUT_SPEED] * ca.fabs(instant.load)),
    rates=(STRUT_SPEED,),
)


@pytest.fixture
def more_terms(monkeypatch):
    for term in (STRIBECK, LOADED):
        monkeypatch.setitem(TERMS, term.name, term)


@pytest.fixture
def stribeck(palida, more_terms):
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
    kernel = BatchFunction("slope", [graph.state], [graph.machine, graph.parameters], [slope])
    states = _states(robot)
    (found,) = kernel(np.concatenate(states, axis=1), robot.machine, p)
    ends = [stribeck(0.4 + step).actuator_forces(*states, p) for step in (1e-6, -1e-6)]
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.usefixtures("more_terms")
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


@pytest.mark.usefixtures("more_terms")
@pytest.mark.parametrize(
    ("given", "text"),
    [
        ("stribeck", "missing"),
        ({"stribeck": {"velocity": "50 mm"}}, "a length, not a speed"),
        ({"stribeck": {"velocety": 1}}, "velocety"),
        ({"stribeck": {"velocity": {"value": 1, "estimated": True}}}, "velocity.*is no constant"),
        ({"stribeck": {"velocity": {"value": 1, "estimate": "yes"}}}, "velocity.*is no constant"),
    ],
)
def test_constants_that_cannot_be(palida, given, text):
    with pytest.raises(InputError, match=text):
        load_run({"name": "n", "robot": {**palida, "terms": [*DEFAULT, given]}})


@pytest.mark.usefixtures("more_terms")
def test_a_term_may_take_the_load_of_the_actuators(palida):
    names = [*DEFAULT, "loaded"]
    robot = _robot(palida, terms=names, parameters=palida["parameters"])
    states = _states(robot)
    # What bears on the actuators without friction, by the robot that has none.
    rigid = _robot(palida, terms=["struts", "rigid_platform"])
    speed = robot.strut_motion(*states).length_rate
    expected = np.sign(speed) * np.abs(rigid.actuator_forces(*states))
    np.testing.assert_allclose(robot.regressor(*states)[:, :, 24], expected, rtol=1e-10)


@pytest.mark.usefixtures("more_terms")
def test_slopes_to_the_state_with_constants_and_load(palida):
    names = [*DEFAULT, {"stribeck": {"velocity": 0.4}}, "loaded"]
    extra = {f"s{j}": 4.0 for j in range(1, 7)} | {"m": 0.1}
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
