"""A recording that this code did not make: MuJoCo drives the machine, a logger's file is read."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from expdesign.cli.app import app, run
from tests.blank_figures import blank_figures
from tests.multibody.driven import drive
from tests.multibody.recording import DATA, write_recording
from tests.multibody.test_forces import BODIES, DESIGN, GEOMETRY, ROBOT

SAMPLES, PERIODS = 400, 10


@pytest.fixture(scope="module")
def driven():
    return drive(GEOMETRY, BODIES, DESIGN, SAMPLES)


def test_the_machine_follows_its_design_with_an_error_of_its_own(driven):
    assert driven.gap < 10e-6
    assert 5e-6 < np.sqrt(np.mean(driven.tracking**2)) < 50e-6


@pytest.mark.slow
def test_the_truth_is_among_the_parameters_that_the_recording_speaks_for(driven, tmp_path):
    noise = ROBOT.description.noise
    covariances = (noise.length_covariance, noise.force_covariance)
    write_recording(tmp_path / "log.csv", driven, PERIODS, covariances, seed=1)
    (tmp_path / "design.json").write_text(json.dumps(DESIGN))
    # JSON is YAML, too.
    (tmp_path / "run.yaml").write_text(json.dumps({"name": "lab", "robot": "palida", "data": DATA}))
    given = {"--data": "log.csv", "--design": "design.json", "--out": "out"}
    options = [text for key, name in given.items() for text in (key, str(tmp_path / name))]
    with blank_figures():
        assert run(app, ["estimate", str(tmp_path / "run.yaml"), *options]) == 0
    record = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert record["recordings"][0]["periods"] == PERIODS
    truth = BODIES.parameters(GEOMETRY.platform_joints)
    known = np.array(ROBOT.parameters)
    limit = chi2.ppf(0.999, len(truth))
    for name in ("gm", "ml"):
        found = record["estimators"][name]
        values = np.array([found["values"][parameter] for parameter in ROBOT.parameter_names])
        assert _chi_square(values - truth, found["covariance"]) < limit
        # The data tell the bodies from those of the robot file, which are a little different.
        assert _chi_square(values - known, found["covariance"]) > 3 * limit


def _chi_square(error, covariance):
    return error @ np.linalg.solve(covariance, error)
