"""From a design over the controller's table to parameters: as precise as the design predicts."""

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_limits

from estimation.data.reading import read_measurement
from estimation.identification import estimate_parameters
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.configuration import DataSection
from expdesign.information.fisher import information_matrix, parameter_covariance
from tests.estimation.cases import PERIODS, ROBOT, run, trajectory
from tests.export.written import SAMPLING, written

REPETITIONS = 120
IDENTIFIED = 0.5


def predicted():
    """Return F⁻¹ over the samples and periods of the experiment, along the design."""
    motion = trajectory()
    states = motion.sample(motion.sample_times(round(motion.period * SAMPLING)))
    regressors = ROBOT.regressor(states.pose, states.rate, states.acceleration)
    information = information_matrix(regressors, ROBOT.description.noise.force_covariance)
    return parameter_covariance(PERIODS * information, ROBOT.parameter_names)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Return a table of the small motion with the segments that are found for it."""
    return written(tmp_path_factory.mktemp("table") / "table.trj", format="xps-pvt")


@pytest.mark.slow
def test_an_xps_table_is_as_good_as_its_design(table):
    configuration = run({"noise": "given"}, experiment={"periods": PERIODS, "sampling": SAMPLING})
    twin = Twin.of(configuration, table)
    knowledge = parameter_priors(configuration, ROBOT)
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


def test_the_window_of_a_recording_of_the_whole_motion(table, tmp_path):
    """What is recorded from rest to rest is cut to the window that the table marks."""
    begin, end = table.window
    duration = table.executed.motion.duration
    # The recording goes on for more than a period after the machine has come to rest.
    times = np.arange(round((duration + 3) * SAMPLING)) / SAMPLING
    moving = np.hstack(table.executed.smoothed(np.minimum(times, duration)).states)
    moving[times > duration, 6:] = 0
    noise = ROBOT.description.noise
    rng = np.random.default_rng(5)
    lengths, forces = (
        values + rng.normal(size=(len(times), 6)) @ np.linalg.cholesky(covariance).T
        for values, covariance in (
            (ROBOT.inverse_kinematics(moving[:, :6]), noise.length_covariance),
            (ROBOT.actuator_forces(*np.split(moving, 3, axis=1)), noise.force_covariance),
        )
    )
    columns = ["t", *(f"{name}{j}" for name in "qQ" for j in range(1, 7))]
    recording = pd.DataFrame(np.column_stack([times, lengths, forces]), columns=columns)
    recording.to_csv(tmp_path / "whole.csv", index=False)
    window = DataSection.model_validate({"start": begin, "end": end})
    data = read_measurement(tmp_path / "whole.csv", window, ROBOT)
    assert len(data.time) == PERIODS * 200
    result = estimate_parameters(run({"estimators": ["gm"], "noise": "given"}), data, trajectory())
    assert not [warning for warning in result.warnings if "incomplete" in warning]
    found = result.estimates["gm"]
    errors = found.values - ROBOT.parameters
    chi_square = errors @ np.linalg.solve(found.covariance, errors)
    assert chi_square < 24 + 4 * np.sqrt(2 * 24)
    # Without the end, the rest behind the periods is found and left out, with a warning.
    whole = read_measurement(
        tmp_path / "whole.csv", DataSection.model_validate({"start": begin}), ROBOT
    )
    cut = estimate_parameters(run({"estimators": ["gm"], "noise": "given"}), whole, trajectory())
    assert [warning for warning in cut.warnings if "rests are left out" in warning]
    errors = cut.estimates["gm"].values - ROBOT.parameters
    chi_square = errors @ np.linalg.solve(cut.estimates["gm"].covariance, errors)
    assert chi_square < 24 + 4 * np.sqrt(2 * 24)
