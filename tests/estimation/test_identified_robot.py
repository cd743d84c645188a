"""The robot that an estimate found, as a file that every command takes."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimation.estimators import add_prior_response
from estimation.estimators.priors import ParameterPriors
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.calibration import estimated_machine
from estimation.identification.result import EstimationResult
from expdesign.configuration import InputError, load_run
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as FILE
from expdesign.configuration.tolerances import identified_name
from expdesign.robot import load_robot, robot_from
from expdesign.robot.deviation import toleranced_deviations
from tests.estimation.cases import measured, read_estimate, run, trajectory

MOTION = trajectory(100, 0.01)
TOLERANCES = {"base_joints": "0.5 mm", "gravity": "0.5 deg", "delay": "1 ms"}


@pytest.fixture(scope="module", params=["budget", "estimated"])
def written(request, tmp_path_factory):
    """A result, and the folder with its files."""
    section = {"harmonics": 2, "estimators": ["gm", "ml"], "systematic": request.param}
    data = measured(MOTION, 1, step=0.01, length_scale=0.1, force_scale=0.1)
    result = estimate_parameters(run(section, tolerances=TOLERANCES), data, MOTION)
    folder = tmp_path_factory.mktemp(request.param)
    assert folder / FILE in estimation_result(result).write(folder)
    return result, folder


def test_it_is_a_robot_with_the_estimate(written):
    result, folder = written
    robot = load_robot(folder / FILE)
    assert robot.name == "palida-identified"
    np.testing.assert_array_equal(robot.parameters, result.best.values)
    # An estimate of the machine predicts for it, and a second identification adds no name.
    assert read_estimate(folder, robot).estimate.estimator == "ml"
    assert identified_name(robot.name) == robot.name
    assert identified_name("x" * 95) == "x" * 95  # it would be too long for a name
    known = robot.description.description.identification
    np.testing.assert_array_equal(known.covariance_random, result.best.covariance_random)
    np.testing.assert_array_equal(known.covariance_systematic, result.best.covariance_systematic)
    assert (known.run, known.estimator, known.verdict) == ("case", "ml", "not judged")


def test_its_geometry_is_what_was_estimated(written):
    result, folder = written
    robot, before = load_robot(folder / FILE), load_robot("palida")
    found = result.best.systematic
    theta = {one.name: value for one, value in zip(found.deviations, found.values, strict=True)}
    moved = robot.description.base_joints - before.description.base_joints
    expected = [[theta[f"base_joint_{j}_{axis}"] for axis in ("x", "y", "z")] for j in range(1, 7)]
    np.testing.assert_allclose(moved, expected, atol=1e-15)
    left = {one.name: one.tolerance for one in toleranced_deviations(robot)}
    assert left["delay"] == 1e-3
    std = {one.name: std for one, std in zip(found.deviations, found.std, strict=True)}
    for name in theta:
        if name.startswith("base_joint"):
            assert left[name] == pytest.approx(std[name])
    if found.estimated:
        assert np.any(moved)
        turned = robot.description.gravity
        assert np.linalg.norm(turned) == pytest.approx(9.81)
        assert np.any(turned != before.description.gravity)
    else:
        assert not np.any(moved)


def test_its_estimate_does_not_move_it_once_more(written):
    """Predictions for it and for the robot of the run are those of the same machine."""
    _, folder = written
    robots = robot_from(run(tolerances=TOLERANCES).robot), load_robot(folder / FILE)
    first, second = (
        estimated_machine(robot, read_estimate(folder, robot).estimate.systematic)
        for robot in robots
    )
    for name in ("base_joints", "gravity"):
        one, other = (getattr(each.robot.description, name) for each in (first, second))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert first.delay == second.delay  # the recordings have it, whatever the robot is


@pytest.mark.parametrize("inertia", ["0.2 kg", {"m_drive": "0.2 kg"}])
def test_a_tolerance_of_a_lacking_term_stays(inertia, tmp_path):
    section = {"harmonics": 2, "estimators": ["ml"], "noise": "given", "systematic": "estimated"}
    tolerances = {"terms": {"drive_inertia": inertia}}
    data = measured(MOTION, 1, step=0.01)
    result = estimate_parameters(run(section, tolerances=tolerances), data, MOTION)
    estimation_result(result).write(tmp_path)
    robot = load_robot(tmp_path / FILE)
    assert result.best.systematic.std[0] < 0.2
    assert [one.tolerance for one in toleranced_deviations(robot)] == [0.2]
    assert robot.parameter_names == result.priors.names
    # With it, and only so, the forces of the term are predicted.
    saved = read_estimate(tmp_path, robot).estimate
    assert saved.systematic.estimates == result.best.systematic.estimates
    with pytest.raises(InputError, match="has no tolerance: drive_inertia_m_drive"):
        read_estimate(tmp_path, load_robot("palida"))


def test_a_doubtful_verdict_is_repeated_where_it_is_used(written):
    _, folder = written
    configuration = load_run({"name": "next", "robot": str(folder / FILE)})
    assert any("not judged" in warning for warning in configuration.warnings)


def test_a_covariance_of_another_size_is_refused(written, tmp_path):
    _, folder = written
    text = (folder / FILE).read_text(encoding="utf-8").splitlines()
    row = next(n for n, line in enumerate(text) if "covariance_random" in line) + 1
    broken = tmp_path / "robot.yaml"
    broken.write_text("\n".join([*text[:row], *text[row + 1 :]]), encoding="utf-8")
    with pytest.raises(InputError, match="does not fit the parameters"):
        load_robot(broken)


def test_tables_tell_the_budget(written):
    result, folder = written
    record = EstimationResult.read(folder)
    rows = [row for row in record.budget["ml"] if row.parameter == "p10"]
    assert {row.source for row in rows} == {"noise", "base_joints", "gravity", "delay"}
    assert sum(row.share_percent for row in rows) == pytest.approx(100)
    place = result.priors.names.index("p10")
    assert np.linalg.norm([row.std for row in rows]) == pytest.approx(result.best.std[place])
    assert set(record.deviations) == {"gm", "ml"}
    for rows in record.deviations.values():
        assert len(rows) == len(result.best.systematic.deviations)


def test_as_a_prior_it_shares_its_systematic_error(tmp_path):
    """Two recordings one after the other, or both at once: the same estimate, the same shares."""
    tolerances = {"force_constant": {"common": "5 %"}, "strut_length": "0.5 mm"}
    section = {"harmonics": 2, "estimators": ["gm"], "noise": "given"}
    first, second = (measured(MOTION, seed, step=0.01) for seed in (1, 2))
    run_file = run(section, tolerances=tolerances)
    both = estimate_parameters(run_file, [first, second], MOTION)["gm"]
    estimation_result(estimate_parameters(run_file, first, MOTION)).write(tmp_path)
    after = load_run(
        {
            "name": "after",
            "robot": str(tmp_path / FILE),
            "estimate": {**section, "prior_from": "robot"},
        }
    )
    found = estimate_parameters(after, second, MOTION)["gm"]
    # The kinematic share is counted in the prior's weight, in that of the data it is not; samples
    # with uncertain signs of friction have the weights of a first estimate.
    np.testing.assert_array_less(np.abs(found.values - both.values), 3e-4 * both.std)
    place = load_robot("palida").parameter_names.index("p10")
    for each in (found, both):
        # 5 % of all forces is 5 % of the mass, however many recordings there are.
        share = np.sqrt(each.covariance_systematic[place, place]) / each.values[place]
        assert share == pytest.approx(0.05, rel=0.02)
    std = np.sqrt(np.diag(found.covariance_systematic) / np.diag(both.covariance_systematic))
    np.testing.assert_allclose(std, 1, rtol=0.25)
    random = np.sqrt(np.diag(found.covariance_random) / np.diag(both.covariance_random))
    np.testing.assert_allclose(random, 1, rtol=0.15)


def test_as_a_prior_it_is_conditioned_on_what_is_fixed(written):
    """The blocks of its joint covariance say the same as those of the precision."""
    result, folder = written
    robot = load_robot(folder / FILE)
    names, std = robot.parameter_names, result.best.std
    covariance = np.array(robot.description.description.identification.covariance_random)
    held = [names.index(name) for name in ("p10", "r1", "p9")]
    values = robot.parameters[held] + np.array([3.0, -2.0, 0.0]) * std[held]
    fixed = dict(zip(("p10", "r1"), values.tolist(), strict=False)) | {"p9": None}
    knowledge = ParameterPriors.of(robot, EstimateSection(prior_from="robot", fixed=fixed))
    free = np.setdiff1d(np.arange(len(names)), held)
    assert list(np.flatnonzero(knowledge.free)) == list(free)

    unit = np.sqrt(np.diag(covariance))
    correlation = covariance / np.multiply.outer(unit, unit)
    across = correlation[np.ix_(free, held)]
    gain = across @ np.linalg.inv(correlation[np.ix_(held, held)])
    moved = gain @ ((values - robot.parameters[held]) / unit[held])
    assert np.max(np.abs(moved)) > 1
    shift = (knowledge.prior_mean - robot.parameters)[free] / unit[free]
    np.testing.assert_allclose(shift, moved, atol=1e-5)
    left = correlation[np.ix_(free, free)] - gain @ across.T
    found = knowledge.precision * np.multiply.outer(unit[free], unit[free])
    np.testing.assert_allclose(found @ left, np.eye(len(free)), atol=1e-5)

    # What tolerances made of the parameters that are held moves that mean, too.
    earlier = knowledge.prior_estimate
    inverse = np.linalg.inv(2 * found) * np.multiply.outer(unit[free], unit[free])
    influence = SimpleNamespace(
        motion=True, length_gain=True, force_gain=inverse, free=knowledge.free
    )
    inherited = add_prior_response(None, [influence], earlier)
    for one, column in zip(inherited.deviations, inherited.response.T, strict=True):
        at = [each.name for each in earlier.deviations].index(one.name)
        by = earlier.response[:, at] / unit
        # The prior has half of the weight.
        expected = (by[free] - gain @ by[held]) / 2
        np.testing.assert_allclose(column[free] / unit[free], expected, atol=1e-5 * max(abs(by)))
        assert not np.any(column[held])


def test_a_robot_that_was_not_identified_is_no_prior():
    with pytest.raises(InputError, match="was not identified"):
        estimate_parameters(run({"prior_from": "robot"}), measured(MOTION, 1, step=0.01), MOTION)
