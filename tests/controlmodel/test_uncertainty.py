"""Standard deviations of the forces, by Monte Carlo."""

import numpy as np
import pytest

from estimation.uncertainty.forces import by_actuator, force_uncertainty
from expdesign.configuration.tolerances import Identification
from expdesign.robot import load_robot
from tests.estimation.cases import trajectory

DRAWS = 4000


def _covariance(rng, scale):
    root = rng.normal(size=(24, 24)) * 0.01 * scale[:, None]
    return root @ root.T


@pytest.fixture(scope="module")
def known():
    robot, rng = load_robot("palida"), np.random.default_rng(2)
    random, systematic = (_covariance(rng, size * robot.scales) for size in (1.0, 0.5))
    identification = Identification(
        run="r",
        estimator="ml",
        verdict="accepted",
        parameters=robot.parameter_names,
        covariance_random=random.tolist(),
        covariance_systematic=systematic.tolist(),
    )
    return robot, identification, random, systematic


def test_the_standard_deviation_is_that_of_forces_with_drawn_parameters(known):
    robot, identification, random, systematic = known
    found = force_uncertainty(robot, identification, trajectory())
    rng, motion = np.random.default_rng(3), trajectory().sample(found.time[::40])
    for covariance, stated in ((random + systematic, found.std), (random, found.std_random)):
        drawn = rng.multivariate_normal(robot.parameters, covariance, DRAWS)
        regressors = robot.regressor(motion.pose, motion.rate, motion.acceleration)
        spread = np.std(np.einsum("nij,dj->dni", regressors, drawn), axis=0)
        # 60 values, each with a relative standard deviation of 1/√(2 DRAWS).
        np.testing.assert_allclose(spread / stated[::40], 1.0, atol=4.5 / np.sqrt(2 * DRAWS))


def test_the_numbers_of_an_actuator_are_those_of_its_column(known):
    robot, identification, *_ = known
    found = force_uncertainty(robot, identification, trajectory())
    rows = by_actuator(found, robot)
    assert [row.actuator for row in rows] == list(range(1, 7))
    for row, std, random, forces in zip(
        rows, found.std.T, found.std_random.T, found.forces.T, strict=True
    ):
        assert row.largest == max(std) >= row.rms > row.rms_random > 0
        assert row.rms == pytest.approx(np.linalg.norm(std) / np.sqrt(len(std)))
        assert row.rms_random == pytest.approx(np.linalg.norm(random) / np.sqrt(len(random)))
        assert row.largest_force == max(abs(forces))
