"""Quantities of interest, known parameters and tasks, by plain formulas of F⁻¹."""

import numpy as np
import pytest
from typer.testing import CliRunner

from expdesign.cli.app import app
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.experiment.setup import plan_search, probe_motion
from expdesign.motion.benchmark import motion_of_run
from expdesign.robot.derived import derived_quantities

SAMPLES = 200


def _run(**design):
    return load_run({"name": "x", "robot": "palida", "design": {"starts": 1, "hops": 0, **design}})


@pytest.fixture(scope="module")
def motion():
    return probe_motion(plan_search(_run()), 0)


@pytest.fixture(scope="module")
def covariance(motion):
    return np.linalg.inv(plan_search(_run()).evaluator.information(motion, SAMPLES))


def _value(motion, **design):
    """The reported criterion; that of the search for sharp friction is the same."""
    plan = plan_search(_run(**design))
    evaluator, problem = plan.evaluator, plan.problem
    found = evaluator.value(evaluator.information(motion, SAMPLES))
    level = problem.criterion.levels[0]
    cost = problem.cost.value(problem.variables.pack(motion), 1e-9, level)
    assert problem.cost.criterion_value(cost) == pytest.approx(found, rel=1e-8)
    return found, evaluator.robot


def test_others_are_unknown(motion, covariance):
    names = ["p10", "p3"]
    found, robot = _value(motion, interest=names)
    at = [robot.parameter_names.index(name) for name in names]
    own = covariance[np.ix_(at, at)]
    assert found == pytest.approx(-np.linalg.slogdet(own)[1], rel=1e-9)
    found, _ = _value(motion, interest=names, criterion="a", scaling="nominal")
    assert found == pytest.approx(np.sum(np.diag(own) / robot.scales[at] ** 2), rel=1e-9)


def test_known_parameters_are_held(motion, covariance):
    found, robot = _value(motion, interest=["p10"], known=["p1", "v2"])
    information = np.linalg.inv(covariance)
    kept = [k for k, name in enumerate(robot.parameter_names) if name not in ("p1", "v2")]
    own = np.linalg.inv(information[np.ix_(kept, kept)])
    place = kept.index(robot.parameter_names.index("p10"))
    assert found == pytest.approx(-np.log(own[place, place]), rel=1e-8)


def test_forces_along_a_task(motion, covariance):
    """The mean of tr A C Aᵀ over the circle: the variance of the predicted forces."""
    run = _run(interest={"task": "circle"}, criterion="a")
    found, robot = _value(motion, interest={"task": "circle"}, criterion="a")
    circle = motion_of_run(run, run.run.design.interest.task, robot.home, "task")
    regressors = robot.regressor(*circle.sample(circle.sample_times(300)))
    expected = np.einsum("nij,jk,nik->", regressors, covariance, regressors) / 300
    assert found == pytest.approx(expected, rel=1e-3)


def test_derived_quantities_by_their_jacobian(motion, covariance):
    for groups, criterion in ((["mass", "centre", "inertia"], "d"), (["gravity", "mass"], "a")):
        found, robot = _value(motion, interest=groups, criterion=criterion)
        derived = derived_quantities(robot)
        rows = [k for k, one in enumerate(derived.quantities) if one.group in groups]
        own = derived.jacobian[rows] @ covariance @ derived.jacobian[rows].T
        # Holding forces at home follow from fewer combinations of parameters.
        expected = np.trace(own) if criterion == "a" else -np.linalg.slogdet(own)[1]
        assert found == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    "interest",
    ["all", ["mass", "p10"], {"task": {"motion": "circle", "radius": "50 mm"}}, {"task": "a.json"}],
)
def test_resolved_run_reads_the_same(interest, tmp_path):
    run = _run(interest=interest, criterion="a")
    file = tmp_path / "run.yaml"
    file.write_text(resolved_yaml(run), encoding="utf-8")
    assert load_run(file).run.design == run.run.design


def test_a_task_without_motion_or_file_is_refused_by_check(tmp_path):
    file = tmp_path / "run.yaml"
    design = "{criterion: a, interest: {task: cirle}}"
    file.write_text(f"{{name: n, robot: palida, design: {design}}}", encoding="utf-8")
    found = CliRunner().invoke(app, ["check", str(file)])
    assert isinstance(found.exception, InputError)
    assert "did you mean 'circle'" in found.exception.problems[0].message
    assert found.exception.problems[0].key == "design.interest.task"


def test_check_states_that_the_others_count_as_known(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("{name: n, robot: palida, design: {parameters: [p10]}}", encoding="utf-8")
    found = CliRunner().invoke(app, ["check", str(file)])
    assert "design.parameters: all others count as known" in found.output


@pytest.mark.parametrize(
    ("design", "message"),
    [
        ({"interest": {"task": "circle"}}, "mean variance"),
        ({"interest": ["p10"], "parameters": ["p3"]}, "states its own"),
        ({"known": ["p10"], "parameters": ["p3"]}, "one of the two"),
        ({"interest": []}, "nothing is of interest"),
        ({"interest": ["p99"]}, "p9"),
        ({"interest": ["motor_inertia"]}, "do not determine"),
        ({"interest": ["p10"], "known": ["p10"]}, "known parameters determine"),
    ],
)
def test_refusals(design, message):
    with pytest.raises(InputError, match=message):
        plan_search(_run(**design))
