"""The robot that an estimate found, as a file that every command takes."""

import numpy as np
import pytest

from estimation.identification import estimate
from estimation.identification.identified_robot import FILE
from estimation.identification.record import EstimateRecord
from expdesign.configuration import InputError, load_run
from expdesign.robot import load_robot
from expdesign.robot.deviation import tolerated
from tests.estimation.cases import measured, run, trajectory

MOTION = trajectory(100, 0.01)
TOLERANCES = {"base_joints": "0.5 mm", "gravity": "0.5 deg", "delay": "1 ms"}


@pytest.fixture(scope="module", params=["budget", "estimated"])
def written(request, tmp_path_factory):
    """A result, and the folder with its files."""
    section = {"harmonics": 2, "estimators": ["gm", "ml"], "systematic": request.param}
    data = measured(MOTION, 1, step=0.01, length_scale=0.1, force_scale=0.1)
    result = estimate(run(section, tolerances=TOLERANCES), data, MOTION)
    folder = tmp_path_factory.mktemp(request.param)
    assert folder / FILE in EstimateRecord.of(result).write(folder)
    return result, folder


def test_it_is_a_robot_with_the_estimate(written):
    result, folder = written
    robot = load_robot(folder / FILE)
    np.testing.assert_array_equal(robot.parameters, result.best.values)
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
    left = {one.name: one.std for one in tolerated(robot)}
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
    record = EstimateRecord.read(folder)
    rows = [row for row in record.budget if (row.estimator, row.parameter) == ("ml", "p10")]
    assert {row.source for row in rows} == {"noise", "base_joints", "gravity", "delay"}
    assert sum(row.share_percent for row in rows) == pytest.approx(100)
    place = result.knowledge.names.index("p10")
    assert np.linalg.norm([row.std for row in rows]) == pytest.approx(result.best.std[place])
    assert len(record.deviations) == 2 * len(result.best.systematic.deviations)
