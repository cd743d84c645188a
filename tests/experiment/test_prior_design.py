"""Designs with earlier recordings as prior, by plain formulas and by joint estimates."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from estimation.identification import estimate_parameters
from estimation.identification.estimate import identified_robot
from estimation.identification.periods import UnsuitableDataError
from expdesign.cli.app import app
from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.run import robot_yaml
from expdesign.experiment.judging import earlier_recordings, noise_evaluator
from expdesign.experiment.next_motion import (
    NextResult,
    compare_with_repetition,
    executed_designs,
    next_run,
)
from expdesign.experiment.plan import plan_measurement
from expdesign.experiment.precision import experiment_information, predicted_errors
from expdesign.experiment.setup import plan_search
from expdesign.robot import load_robot
from expdesign.runfolder.manifest import Manifest, StageEntry
from expdesign.trajectory import TrajectoryFile, fourier_keys
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory
from tests.tiny_run import tiny_run

FIRST, SECOND = trajectory(seed=4), trajectory(seed=9)
TOLERANCES = {
    "base_joints": "0.1 mm",
    "strut_length": "0.1 mm",
    "force_constant": {"common": "0.5 %", "each": "0.5 %"},
    "gravity": "0.1 deg",
}


def _run(systematic="auto", tolerances=TOLERANCES, robot="palida", **design):
    settings = {"noise": "given", "harmonics": 2, "systematic": systematic}
    settings["estimators"] = ["ml"] if systematic == "auto" else ["gm"]
    stated = {"tolerances": tolerances} if tolerances else {}
    return run(
        settings,
        robot=robot,
        trajectory={"harmonics": 2, "samples": 100},
        experiment={"periods": 5, "sampling": f"{1 / STEP} Hz"},
        design={"starts": 1, "hops": 0, **design},
        **stated,
    )


@pytest.fixture(scope="module", params=["auto", "budget"])
def systematic(request):
    return request.param


@pytest.fixture(scope="module")
def prior(systematic, tmp_path_factory):
    """The robot of an estimate from the first motion."""
    found = estimate_parameters(_run(systematic), measured(FIRST, 1), FIRST)
    path = tmp_path_factory.mktemp(systematic) / "identified-robot.yaml"
    path.write_text(robot_yaml(identified_robot(found, None)), encoding="utf-8")
    return str(path)


def _predicted(config, motion):
    evaluator = noise_evaluator(config)
    whole, total = experiment_information(evaluator, motion, config)
    return predicted_errors(config, evaluator, motion, whole, total)


def test_prediction_is_that_of_the_joint_estimate(systematic, prior):
    """The tolerances of the machine are one block of both recordings."""
    predicted = _predicted(_run(systematic, prior=prior), SECOND)
    data = [measured(FIRST, 1), measured(SECOND, 2)]
    found = estimate_parameters(_run(systematic), data, [FIRST, SECOND]).best
    np.testing.assert_allclose(predicted.std, np.sqrt(np.diag(found.covariance)), rtol=0.01)
    random = np.sqrt(np.diag(found.covariance_random))
    np.testing.assert_allclose(predicted.std_random, random, rtol=0.01)
    # Repeating the motion halves the variance of noise, but not that of the tolerances.
    repeated = _predicted(_run(systematic, prior=prior), FIRST)
    once = _predicted(_run(systematic), FIRST)
    assert np.all(repeated.std > once.std / np.sqrt(2))


def test_judged_information_is_that_of_the_joint_normal_matrix(systematic, prior):
    """In the search, with other unknowns for the deviations, as in the reported criterion."""
    for settings in ({}, {"counts": "noise"}, {"interest": ["mass", "centre"]}, {"known": ["p3"]}):
        config = _run(systematic, prior=prior, **settings)
        plan = plan_search(config)
        evaluator, problem = plan.evaluator, plan.problem
        found = evaluator.value(evaluator.information(SECOND, 200))
        cost = replace(problem.cost, samples=200)
        value = cost.value(problem.variables.pack(SECOND), 1e-9, problem.criterion.levels[0])
        assert cost.criterion_value(value) == pytest.approx(found, rel=1e-7)
        if settings or systematic == "budget":
            continue
        chosen = evaluator.deviating
        units = np.append(np.ones(24), [one.tolerance for one in chosen])
        weight = evaluator.marginal.samples / 200
        whole = evaluator.whole_information(SECOND, 200) * weight
        whole += earlier_recordings(config, evaluator.unknown, chosen)
        whole *= np.multiply.outer(units, units)
        whole += np.diag(np.append(np.zeros(24), np.ones(len(chosen))))
        own = np.linalg.inv(whole)[:24, :24]
        expected = -np.linalg.slogdet(own)[1] - 24 * np.log(weight)
        assert found == pytest.approx(expected, rel=1e-8)


def test_identified_robot_itself_counts_its_tolerances_once(prior):
    """Its own tolerances are those that its recordings left."""
    original = _predicted(_run(prior=prior), SECOND)
    corrected = _predicted(_run(prior=prior, robot=prior, tolerances=None), SECOND)
    np.testing.assert_allclose(corrected.std, original.std, rtol=0.05)


def test_plan_counts_the_earlier_recordings(systematic, prior):
    first = plan_measurement(replace_goals(_run(systematic)), FIRST).goals[0]
    later = plan_measurement(replace_goals(_run(systematic, prior=prior)), FIRST).goals[0]
    # Five periods were measured before.
    assert later.periods == pytest.approx(first.periods - 5, abs=1)

    # They are sufficient for a goal above their own standard deviation.
    for share, reached in ((1.001, True), (0.999, False)):
        config = _run(systematic, prior=prior)
        (goal,) = plan_measurement(replace_goals(config, share * _measured_std(prior)), FIRST).goals
        assert (goal.periods == 0) == reached
        assert goal.reachable


def _measured_std(prior):
    """Return the standard deviation of v1 in an estimate with its tolerances, N s/m."""
    known = load_robot(prior).description.description.identification
    total = np.array(known.covariance_random) + np.array(known.covariance_systematic)
    place = known.parameters.index("v1")
    return float(np.sqrt(total[place, place]))


def replace_goals(config, goal="20 %"):
    return replace(config, run=config.run.model_copy(update={"goals": {"v1": goal}}))


def test_several_priors_add(systematic, prior, tmp_path):
    found = estimate_parameters(_run(systematic), measured(FIRST, 2), FIRST)
    again = tmp_path / "again.yaml"
    again.write_text(robot_yaml(identified_robot(found, None)), encoding="utf-8")
    config = _run(systematic, prior=[prior, str(again)])
    first, second, both = (
        earlier_recordings(each, ROBOT.parameter_names, ())
        for each in (_run(systematic, prior=prior), _run(systematic, prior=str(again)), config)
    )
    np.testing.assert_allclose(both, first + second)
    file = tmp_path / "run.yaml"
    file.write_text(resolved_yaml(config), encoding="utf-8")
    assert load_run(file).run.design == config.run.design
    with pytest.raises(InputError, match="count twice"):
        _run(systematic, prior=[prior, prior])


def test_an_estimate_with_a_prior_contains_its_recordings(systematic, prior, tmp_path):
    """It counts with neither the prior nor its recordings, and tolerances do not count twice."""
    section = {"noise": "given", "harmonics": 2, "prior_from": "robot"}
    section |= {"estimators": ["gm"], "systematic": "none"}
    data = measured(SECOND, 2)
    found = estimate_parameters(run(section, robot=prior), data, SECOND)
    after, apart = tmp_path / "after.yaml", tmp_path / "apart.yaml"
    after.write_text(robot_yaml(identified_robot(found, None)), encoding="utf-8")
    known = load_robot(after).description.description.identification
    assert known.recordings == (data.fingerprint, measured(FIRST, 1).fingerprint)
    for priors in ([prior, str(after)], [str(after), prior]):
        with pytest.raises(InputError, match="contain the same recording"):
            _run(systematic, prior=priors, robot=prior, tolerances=None)
    with pytest.raises(UnsuitableDataError, match="recording 2 is in the prior"):
        estimate_parameters(run(section, robot=prior), [data, measured(FIRST, 1)], [SECOND, FIRST])
    # Its own estimate begins with the tolerances that the first one left.
    own = _run(systematic, robot=prior, tolerances=None)
    apart.write_text(robot_yaml(identified_robot(estimate_parameters(own, data, SECOND), None)))
    first, second = (
        _predicted(_run(systematic, prior=priors, robot=prior, tolerances=None), SECOND).std
        for priors in ([prior, str(apart)], [str(apart), prior])
    )
    np.testing.assert_allclose(first, second, rtol=1e-9)
    three = [measured(FIRST, 1), data, measured(SECOND, 3)]
    joint = estimate_parameters(_run(systematic), three, [FIRST, SECOND, SECOND]).best
    np.testing.assert_allclose(first, np.sqrt(np.diag(joint.covariance)), rtol=0.03)


def test_refusals(prior):
    with pytest.raises(InputError, match="2 priors"):
        _run(prior=[prior, prior], parameters=["p10"])
    tolerances = {**TOLERANCES, "delay": "0.1 ms"}
    with pytest.raises(InputError, match="does not contain delay"):
        _predicted(_run(tolerances=tolerances, prior=prior), SECOND)


@pytest.fixture
def folder(systematic, prior, tmp_path):
    """A run folder with an estimate."""
    config = _run(systematic)
    (tmp_path / "identified-robot.yaml").write_bytes(Path(prior).read_bytes())
    (tmp_path / "run.yaml").write_text(resolved_yaml(config), encoding="utf-8")
    return tmp_path


def test_next_run_is_that_of_the_folder_with_its_prior(systematic, folder):
    config = next_run([folder])
    assert config.run.name == "case-next"
    assert config.run.design == _run(systematic, prior=[str(folder)]).run.design
    assert config.run.experiment == _run(systematic).run.experiment


def test_next_run_counts_the_priors_of_the_last_one(systematic, prior, folder, tmp_path):
    """Once, although they are named again, and not if the estimate contains their recordings."""
    place = tmp_path / "second"
    place.mkdir()
    known = load_robot(prior).description.description.identification
    text = Path(prior).read_text(encoding="utf-8").replace("run: case", "run: second")
    text = text.replace(known.recordings[0], "of the second run")
    (place / "identified-robot.yaml").write_text(text, encoding="utf-8")
    text = resolved_yaml(_run(systematic, prior=[str(folder)]))
    (place / "run.yaml").write_text(text, encoding="utf-8")
    expected = _run(systematic, prior=[str(place), prior]).run.design.priors
    assert next_run([place]).run.design.priors == expected
    assert next_run([folder, place]).run.design.priors == expected[::-1]
    assert executed_designs(place) == []
    for each in (folder, place):
        TrajectoryFile(**fourier_keys(SECOND)).write(each)
    sources = {"run.yaml": "", "m.csv": "", str(folder / "design.json"): "", "design.json": ""}
    entry = StageEntry("done", "", 0.0, "", made_from=sources)
    Manifest.new({}, "").with_stage("estimate", entry).write(place)
    assert executed_designs(place) == [folder / "design.json", place / "design.json"]
    assert next_run([place]).run.design.priors == expected[:1]
    # The last motion was designed by the run of its folder.
    other = _run(systematic).with_section("trajectory", harmonics=3)
    (folder / "run.yaml").write_text(resolved_yaml(other), encoding="utf-8")
    assert next_run([place]).run.trajectory.harmonics == 2
    assert next_run([place], folder / "design.json").run.trajectory == other.run.trajectory


def test_gain_of_the_next_motion_and_of_the_last_one_repeated(folder):
    config = next_run([folder])
    found = compare_with_repetition(config, SECOND, FIRST)
    assert found.repeated_periods == 5
    rows = {one.quantity: one for one in found.gains}
    assert {"mass", "centre_z", "p1", "v6"} <= set(rows)
    for motion, std in ((SECOND, "std_next"), (FIRST, "std_repeated")):
        stds = [getattr(rows[name], std) for name in ROBOT.parameter_names]
        np.testing.assert_allclose(stds, _predicted(config, motion).std, rtol=1e-9)
    machine = load_robot(folder / "identified-robot.yaml")
    known = machine.description.description.identification
    total = np.array(known.covariance_random) + np.array(known.covariance_systematic)
    measured_before = [rows[name].std_measured for name in ROBOT.parameter_names]
    np.testing.assert_allclose(measured_before, np.sqrt(np.diag(total)), rtol=1e-6)
    shares = [one.share_next for one in found.gains if one.parameter]
    assert found.next_percent == pytest.approx(100 * np.exp(np.mean(np.log(shares))))
    assert 50 < found.next_percent < found.repeated_percent < 100


def test_known_parameters_of_a_run_stay_known(folder):
    config = _run(parameters=["p10", "p9"])
    (folder / "run.yaml").write_text(resolved_yaml(config), encoding="utf-8")
    design = next_run([folder]).run.design
    assert design.parameters is None
    assert set(design.known) == set(ROBOT.parameter_names) - {"p10", "p9"}


@pytest.mark.parametrize(
    ("change", "words"),
    [({"sweep": {"design.seed": [0, 1]}}, "several designs"), (None, "run.yaml is missing")],
)
def test_folders_without_a_next_motion(change, words, tmp_path):
    if change is not None:
        text = resolved_yaml(run({}, **change))
        (tmp_path / "run.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        next_run([tmp_path])


@pytest.mark.slow
def test_command_designs_and_compares(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with (tmp_path / "tiny.yaml").open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(tiny_run(estimate={"estimators": ["gm"]}), stream)
    commands = [["run", "tiny.yaml"], ["next", "runs/tiny", "--json"]]
    made = [CliRunner().invoke(app, arguments) for arguments in commands]
    assert [one.exit_code for one in made] == [0, 0], made[-1].output
    stated = json.loads(made[1].stdout)
    assert stated["folder"] == str(tmp_path / "runs/tiny-next")
    found = NextResult.read(tmp_path / "runs/tiny-next")
    assert found.next_percent == stated["next_percent"] < 100
    refused = CliRunner().invoke(app, ["next", "runs/tiny", "--out", "runs/tiny"])
    assert isinstance(refused.exception, InputError)
