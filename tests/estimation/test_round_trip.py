"""From a design over the controller's table to parameters: as precise as the design predicts."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from estimation.identification.estimate import parameter_knowledge, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.information.fisher import information_matrix, parameter_covariance
from tests.estimation.cases import PERIODS, ROBOT, run, trajectory
from tests.export.written import SAMPLING, written

REPETITIONS = 200
IDENTIFIED = 0.5


def predicted():
    """Return F⁻¹ over the samples and periods of the experiment, along the design."""
    motion = trajectory()
    states = motion.sample(motion.sample_times(round(motion.period * SAMPLING)))
    regressors = ROBOT.regressor(states.pose, states.rate, states.acceleration)
    information = information_matrix(regressors, ROBOT.description.noise.force_covariance)
    return parameter_covariance(PERIODS * information, ROBOT.parameter_names)


@pytest.mark.slow
def test_an_xps_table_is_as_good_as_its_design(tmp_path):
    table = written(tmp_path / "table.trj", format="xps-pvt")
    configuration = run({"noise": "given"}, experiment={"periods": PERIODS, "sampling": SAMPLING})
    twin = Twin.of(configuration, table)
    knowledge = parameter_knowledge(configuration, ROBOT)
    found = []
    with threadpool_limits(limits=1, user_api="blas"):
        for number in range(1, REPETITIONS + 1):
            # The design as `estimate --design` takes it, not as the table enters it.
            experiment = prepare_experiment(
                configuration, ROBOT, twin.measurement(number), trajectory()
            )
            found.append(run_estimators(ROBOT, [experiment], knowledge, ("gm",))["gm"].values)
    covariance = predicted()
    std = np.sqrt(np.diag(covariance))
    identified = std < IDENTIFIED * np.abs(ROBOT.parameters)
    assert identified.sum() >= 20
    std = std[identified]
    errors = (np.array(found) - ROBOT.parameters)[:, identified] / std
    # The mean of K draws of the squared, correlated errors is uncertain by this; half of it in
    # their root.
    correlation = covariance[np.ix_(identified, identified)] / np.multiply.outer(std, std)
    uncertain = np.sqrt(2 / (REPETITIONS - 1) * np.mean(correlation**2)) / 2
    assert 3 * uncertain < 0.07
    assert 0.93 < np.sqrt(np.mean(errors.var(axis=0, ddof=1))) < 1.07
    assert 0.93 < np.sqrt(np.mean(errors**2)) < 1.07
    # A bias of all parameters together: chi-square of the mean error.
    mean = errors.mean(axis=0)
    chi_square = REPETITIONS * mean @ np.linalg.solve(correlation, mean)
    assert chi_square < identified.sum() + 4 * np.sqrt(2 * identified.sum())
