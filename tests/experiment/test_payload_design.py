"""A design for what has changed on an identified machine, judged once more by the joint problem."""

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import expdesign
from expdesign.cli.app import app
from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.robot import RobotDescription, as_general
from expdesign.experiment import DesignResult
from expdesign.experiment.setup import plan_search
from expdesign.runfolder.manifest import Manifest, entry, file_hash
from expdesign.stages.execution import view_result
from expdesign.stages.registry import DesignStage
from expdesign.stages.stage import Workspace
from results.figures.design import convergence_figure
from results.render.terminal import print_view

PLATFORM = ("p6", "p7", "p8", "p9", "p10", "sx", "sy", "Ixy", "Ixz", "Iyz")


@pytest.fixture(scope="module")
def loaded(tiny, few_limits):
    """The tiny run for a payload, on a machine whose parameters are known to some percent."""
    robot = as_general(RobotDescription.model_validate(few_limits)).model_dump()
    names = tuple(robot["parameters"])
    rng = np.random.default_rng(0)
    size = np.array([abs(value) or 0.1 for value in robot["parameters"].values()])
    spread = 0.03 * size[:, None] * rng.normal(size=(len(size), 60)) / np.sqrt(60)
    known = {
        "run": "first",
        "estimator": "gm",
        "verdict": "accepted",
        "parameters": names,
        "covariance_random": (spread @ spread.T).tolist(),
        "covariance_systematic": np.zeros((len(names),) * 2).tolist(),
        "deviations": [{"name": "delay", "tolerance": 1e-3, "value": 0, "std": 1e-3}],
        "response": rng.normal(size=(len(names), 1)).tolist(),
    }
    machine = {**robot, "identification": known}
    section = {"parameters": "payload", "prior": machine, "max_iterations": 6}
    return load_run(tiny(robot=robot, design=section, experiment={"periods": 4}))


@pytest.fixture(scope="module")
def result(loaded):
    return expdesign.design(loaded)


def _covariance(result, regressors, prior_share):
    """Return what the joint problem of payload and machine leaves of the payload, (10, 10)."""
    run, robot = result.configuration.run, result.robot
    known = np.array(run.design.prior.identification.covariance_random) / prior_share
    noise = np.linalg.cholesky(robot.description.noise.force_covariance)
    white = np.linalg.solve(noise, regressors).reshape(-1, regressors.shape[2])
    size = np.linalg.norm(white, axis=0)
    white = white / size
    places = [robot.parameter_names.index(name) for name in result.parameter_names]
    machine = np.linalg.inv(np.linalg.cholesky(known / np.multiply.outer(1 / size, 1 / size)))
    rows = np.block([[white[:, places], white], [np.zeros((len(machine), len(places))), machine]])
    inverse = np.linalg.pinv(rows)[: len(places)]
    return inverse @ inverse.T / np.multiply.outer(size[places], size[places])


def test_what_is_reported_is_that_of_the_joint_problem(result):
    """By least squares on the columns of both, without any Schur complement."""
    assert set(result.parameter_names) == set(PLATFORM)
    run = result.configuration.run
    trajectory, samples = result.trajectory, run.trajectory.samples
    regressors = result.robot.regressor(*trajectory.sample(trajectory.sample_times(samples)))
    reference = run.experiment.periods * run.experiment.sampling / run.trajectory.frequency[1]
    found = _covariance(result, regressors, samples / reference)
    np.testing.assert_allclose(np.linalg.inv(result.information), found, rtol=1e-6, atol=1e-12)
    expected = -np.linalg.slogdet(found)[1]
    assert result.criterion_value == pytest.approx(expected, abs=1e-6)
    assert result.log_det_information == pytest.approx(expected, abs=1e-6)


def test_predicted_std_counts_the_whole_experiment_and_the_whole_prior(result):
    run = result.configuration.run
    trajectory, count = result.trajectory, round(result.samples_per_period)
    regressors = result.robot.regressor(*trajectory.sample(trajectory.sample_times(count)))
    periods = run.experiment.periods
    found = _covariance(result, np.tile(regressors, (periods, 1, 1)), 1.0)
    std = [result.experiment.std[name] for name in result.parameter_names]
    np.testing.assert_allclose(std, np.sqrt(np.diag(found)), rtol=1e-6)


def test_a_better_known_machine_promises_a_better_known_payload(result, loaded):
    machine = loaded.run.design.prior
    known = machine.identification
    better = tuple(tuple(x / 100 for x in row) for row in known.covariance_random)
    identification = known.model_copy(update={"covariance_random": better})
    run = loaded.with_section(
        "design", prior=machine.model_copy(update={"identification": identification})
    )
    evaluator = plan_search(run).evaluator
    value = evaluator.value(evaluator.information(result.trajectory, result.samples))
    assert value > result.criterion_value + 1


def test_what_tolerances_did_to_the_earlier_estimate_is_counted(result):
    """The delay is exact now: the payload is off by what the machine was off by before."""
    evaluator = plan_search(result.configuration).evaluator
    trajectory, samples = result.trajectory, result.samples
    regressors = result.robot.regressor(*trajectory.sample(trajectory.sample_times(samples)))
    white = np.linalg.solve(np.linalg.cholesky(evaluator.covariance), regressors)
    rows = white.reshape(-1, regressors.shape[2])
    (moved,) = evaluator.marginal.moved.values()
    expected = evaluator.marginal.gain(rows.T @ rows, samples) @ (rows.T @ (rows @ moved))
    assert list(result.systematic) == list(result.parameter_names)
    np.testing.assert_allclose([*result.systematic.values()], np.abs(expected), rtol=1e-6)


@pytest.mark.slow
def test_what_is_judged_has_one_name_wherever_it_is_told(result, tmp_path, capsys):
    """It is S, log det F of the same motion being another number."""
    run = result.configuration
    work = Workspace(result.configuration, tmp_path)
    print_view(view_result(DesignStage(), result, work), Console(width=200))
    said = capsys.readouterr().out
    result.write(tmp_path)
    (tmp_path / "run.yaml").write_text(resolved_yaml(run), encoding="utf-8")
    # A report repeats what is judged only of files that a manifest names.
    files = [tmp_path / "design.json", *tmp_path.glob("tables/*.csv")]
    stages = {"design": entry("done", "", 0.0, "", tmp_path, files)}
    Manifest({}, {}, "", stages, run_file=file_hash(tmp_path / "run.yaml")).write(tmp_path)
    status = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert status.exit_code == 0, status.output
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (said, page):
        assert "log det S" in text
        assert "log det F" not in text
    figure = convergence_figure.draw(DesignResult.read(tmp_path))
    assert figure.axes[0].get_ylabel().startswith("log det S")
