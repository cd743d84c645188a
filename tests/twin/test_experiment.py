import itertools
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from estimation.twin import Twin
from estimation.twin.disturbances import Repeated, Shared, experiment_stream, repetition_stream
from expdesign.configuration import InputError, load_run
from expdesign.robot import load_robot, robot_from
from expdesign.trajectory import FourierTrajectory
from tests.twin.examples import TINY, configuration, motion

ROBOT = load_robot("palida")


def model(trajectory, times):
    """Return lengths and A p of a motion, by the robot itself."""
    samples = trajectory.sample(times)
    regressor = ROBOT.regressor(samples.pose, samples.rate, samples.acceleration)
    return ROBOT.inverse_kinematics(samples.pose), regressor @ ROBOT.parameters


# --- without noise: the model itself --------------------------------------------------------------


@pytest.mark.parametrize(("frequency", "whole"), [(0.5, True), (0.6, False), (0.37, False)])
def test_without_noise_it_is_the_model(quiet, frequency, whole):
    found = quiet(frequency=frequency, periods=4, sampling=200)
    assert (found.grid.per_period is not None) == whole
    measured = found.measurement()
    times = np.arange(int(np.ceil(4 / frequency * 200 - 1e-9))) / 200
    np.testing.assert_array_equal(measured.time, times)
    lengths, forces = model(motion(frequency), times)
    np.testing.assert_allclose(measured.lengths, lengths, rtol=0, atol=1e-11)
    np.testing.assert_allclose(measured.forces, forces, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.lengths, lengths, rtol=0, atol=1e-13)
    assert measured.step == 1 / 200
    assert measured.period.max() == 4


def test_blocks_of_samples_do_not_show(quiet):
    found = quiet(frequency=0.6, periods=6, sampling=1000)
    assert len(found.lengths) > 2 * 4096
    lengths, forces = model(motion(0.6), found.grid.times)
    np.testing.assert_array_equal(found.lengths, lengths)
    np.testing.assert_allclose(found.forces, forces, rtol=0, atol=1e-11)


def test_the_friction_is_not_smoothed():
    """Across a reversal the force jumps by the dry friction, however fine the sampling."""
    along_z = FourierTrajectory(
        np.pi, ROBOT.home, [[0.0], [0], [0.1], [0], [0], [0]], np.zeros((6, 1))
    )
    found = Twin.of(configuration(TINY, periods=1, sampling=20_000), along_z)
    reversal = 10_000  # 0.5 s, a quarter of the period
    before, at, after = (
        found.forces[reversal - 1],
        found.forces[reversal],
        found.forces[reversal + 1],
    )
    dry = np.array([ROBOT.description.parameters[f"r{j}"] for j in range(1, 7)])
    jump = np.abs(after - before)
    assert np.all(jump > 1.5 * dry)
    smooth = np.abs(found.forces[reversal + 2] - after)
    assert np.all(smooth < 1e-3 * jump)
    assert np.all(np.abs(at - (before + after) / 2) < 0.51 * jump)


def test_the_tracking_error_moves_lengths_and_forces(quiet):
    found = quiet(periods=2, sampling=200, tracking_error={"position": 1e-3, "angle": 2e-3})
    executed = found.truth.executed
    assert executed.harmonics == 15
    measured = found.measurement()
    lengths, forces = model(executed, measured.time)
    np.testing.assert_allclose(measured.lengths, lengths, atol=1e-11)
    np.testing.assert_allclose(measured.forces, forces, atol=1e-8)
    designed, _ = model(found.truth.design, measured.time)
    assert 1e-4 < np.sqrt(np.mean((lengths - designed) ** 2)) < 1e-2


# --- every disturbance has its signature ----------------------------------------------------------

COGGING = {
    "amplitude": [0, 0, 12, 12, 0, 0],
    "pitch": "30 mm",
    "phase": [0, 0, 0.3, 1.1, 0, 0],
}


def test_cogging_is_periodic_in_the_length_of_its_struts(quiet):
    plain, found = (quiet(periods=2, sampling=500, **e) for e in ({}, {"cogging": COGGING}))
    added = found.measurement().forces - plain.measurement().forces
    lengths = plain.lengths
    assert np.all(np.ptp(lengths[:, 2:4], axis=0) > 0.03)
    for strut, phase in ((2, 0.3), (3, 1.1)):
        expected = 12 * np.sin(2 * np.pi * lengths[:, strut] / 0.03 + phase)
        np.testing.assert_allclose(added[:, strut], expected, atol=1e-9)
        assert np.abs(added[:, strut]).max() == pytest.approx(12, rel=1e-3)
    np.testing.assert_array_equal(added[:, [0, 1, 4, 5]], 0)
    np.testing.assert_array_equal(found.measurement().lengths, plain.measurement().lengths)


def test_drift_grows_from_zero_to_its_size(quiet):
    plain, found = (quiet(periods=6, sampling=100, drift=d) for d in (0, 5e-5))
    first, second = found.measurement(1), found.measurement(2)
    added = first.lengths - plain.measurement(1).lengths
    final = found.truth.disturbances["drift"]["final"]
    np.testing.assert_allclose(np.abs(final), 5e-5, rtol=1e-15)
    np.testing.assert_allclose(added[0], 0, atol=1e-15)
    np.testing.assert_allclose(added[-1], final, rtol=1e-5)
    np.testing.assert_allclose(added[600], final / 2, rtol=1e-9)
    assert np.all(np.diff(added * np.sign(final), axis=0) > -1e-15)
    # It belongs to the experiment, not to the repetition, and the forces know nothing of it.
    np.testing.assert_allclose(second.lengths, first.lengths, atol=1e-10)
    np.testing.assert_array_equal(first.forces, plain.measurement(1).forces)


def test_drifts_of_different_seeds_differ_in_sign():
    found = {tuple(np.sign(_drift(seed))) for seed in range(8)}
    assert len(found) > 1


def _drift(seed):
    run = configuration(TINY, periods=1, sampling=50, drift=1e-5, seed=seed)
    return Twin.of(run, motion()).truth.disturbances["drift"]["final"]


def test_quantisation(twin):
    fine = twin(periods=2, sampling=100)
    coarse = twin(periods=2, sampling=100, quantisation={"length": "5 um", "force": 0.5})
    for name, step in (("lengths", 5e-6), ("forces", 0.5)):
        values = getattr(coarse.measurement(), name)
        np.testing.assert_allclose(values / step, np.round(values / step), rtol=0, atol=1e-6)
        error = values - getattr(fine.measurement(), name)
        assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
        assert np.abs(error).max() > 0.49 * step
        assert abs(error.mean()) < 0.02 * step


def test_quantisation_of_one_channel_only(twin):
    coarse = twin(periods=1, sampling=50, quantisation={"force": 0.5}).measurement()
    np.testing.assert_array_equal(
        coarse.lengths, twin(periods=1, sampling=50).measurement().lengths
    )


def test_outliers(twin):
    share, count = 0.02, 12_000
    sizes = {"length": 3e-3, "force": 200}
    plain = twin(periods=30, sampling=200).measurement()
    hit = twin(periods=30, sampling=200, outliers={"share": share, **sizes}).measurement()
    assert len(hit) == count
    for name, size in (("lengths", 3e-3), ("forces", 200.0)):
        error = getattr(hit, name) - getattr(plain, name)
        wrong = error != 0
        np.testing.assert_allclose(np.abs(error[wrong]), size, rtol=1e-9)
        # Binomial numbers of hits in each channel, of both signs: within five deviations.
        for hits, p in ((wrong, share), (error > 0, share / 2), (error < 0, share / 2)):
            deviation = np.sqrt(count * p * (1 - p))
            assert np.all(np.abs(hits.sum(axis=0) - count * p) < 5 * deviation)
        assert len({tuple(channel) for channel in wrong.T}) == 6


def test_outliers_of_another_repetition_are_others(quiet):
    found = quiet(periods=5, sampling=200, outliers={"share": 0.05, "force": 100})
    first, second = (np.abs(found.measurement(k).forces - found.forces) > 50 for k in (1, 2))
    assert first.sum() > 100
    assert not np.array_equal(first, second)


# --- random streams -------------------------------------------------------------------------------

DISTURBANCES = {
    "tracking_error": {"position": 1e-3},
    "drift": 1e-4,
    "cogging": COGGING,
    "outliers": {"share": 0.01, "force": 100, "length": 1e-3},
}


@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_disturbance_changes_no_draw_of_the_noise(twin, name):
    """Measured minus undisturbed is the noise; it is the same but where an outlier hits."""
    plain = twin(periods=3, sampling=100)
    other = twin(periods=3, sampling=100, **{name: DISTURBANCES[name]})
    for channel in ("lengths", "forces"):
        noise, again = (
            getattr(t.measurement(7), channel) - getattr(t, channel) for t in (plain, other)
        )
        same = np.isclose(again, noise, rtol=0, atol=1e-12 if channel == "lengths" else 1e-9)
        assert same.mean() > 0.97
        assert same.all() or name == "outliers"


def test_what_the_repetitions_share_depends_on_no_other_disturbance(twin):
    alone = twin(periods=1, sampling=50, tracking_error={}, drift=1e-4).truth
    among = twin(periods=2, sampling=80, **DISTURBANCES).truth
    np.testing.assert_array_equal(alone.executed.mu, among.executed.mu)
    np.testing.assert_array_equal(
        alone.disturbances["drift"]["final"], among.disturbances["drift"]["final"]
    )


def test_no_two_streams_are_alike():
    streams = [experiment_stream(1, purpose) for purpose in Shared]
    streams += [
        repetition_stream(1, k, purpose) for k, purpose in itertools.product((1, 2, 3), Repeated)
    ]
    streams += [repetition_stream(2, 1, purpose) for purpose in Repeated]
    draws = np.array([stream.standard_normal(2000) for stream in streams])
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 5 / np.sqrt(2000)


def test_the_streams_are_children_of_the_repetition():
    children = np.random.SeedSequence(4, spawn_key=(9,)).spawn(len(Repeated))
    for purpose, child in zip(Repeated, children, strict=True):
        np.testing.assert_array_equal(
            repetition_stream(4, 9, purpose).random(5), np.random.default_rng(child).random(5)
        )


def test_repetitions_count_from_one(twin):
    with pytest.raises(ValueError, match="count from 1"):
        twin(periods=1, sampling=50).measurement(0)


def test_repetitions_differ_and_are_the_same_again(twin):
    found, again = (twin(periods=1, sampling=50) for _ in range(2))
    for channel in ("lengths", "forces"):
        first, second = (getattr(found.measurement(k), channel) for k in (1, 2))
        assert np.all(first != second)
        np.testing.assert_array_equal(getattr(again.measurement(2), channel), second)
        np.testing.assert_array_equal(getattr(found.measurement(1), channel), first)


def test_a_seed_of_its_own_for_the_repetitions(twin):
    own = twin(periods=1, sampling=50, drift=1e-4, tracking_error={})
    other = twin(periods=1, sampling=50, drift=1e-4, tracking_error={}, seed=99)
    np.testing.assert_array_equal(own.lengths, other.lengths)
    assert np.all(own.measurement().forces != other.measurement().forces)
    assert (own.truth.seeds.repetitions, other.truth.seeds.repetitions) == (1, 99)


# --- in other processes ---------------------------------------------------------------------------


def test_it_can_be_sent_to_a_process(twin):
    found = twin(periods=2, sampling=100, frequency=0.6, **DISTURBANCES)
    again = pickle.loads(pickle.dumps(found))
    for channel in ("time", "lengths", "forces", "period"):
        np.testing.assert_array_equal(
            getattr(again.measurement(3), channel), getattr(found.measurement(3), channel)
        )
    assert again.truth.parameters == found.truth.parameters


SCRIPT = """
import hashlib
from estimation.twin import Twin
from tests.twin.examples import configuration, motion
found = Twin.of(configuration(periods=2, sampling=100, drift=1e-4, tracking_error={}), motion(0.6))
measured = found.measurement(5)
print(hashlib.sha256(measured.lengths.tobytes() + measured.forces.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_every_process_draws_the_same():
    answers = {
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        ).stdout
        for _ in range(2)
    }
    assert len(answers) == 1


def test_a_repetition_costs_only_its_draws(twin, monkeypatch):
    found = twin(frequency=0.6, periods=3, sampling=100)
    monkeypatch.delattr("estimation.twin.experiment.robot_from")
    for name in ("execute_design", "cogging_force", "length_drift"):
        monkeypatch.delattr(f"estimation.twin.disturbances.{name}")
    for k in (1, 2):
        assert found.measurement(k).forces.shape == found.forces.shape


# --- truth and errors -----------------------------------------------------------------------------


def test_truth(twin):
    truth = twin(periods=3, sampling=100, frequency=0.6).truth
    assert tuple(truth.parameters) == ROBOT.parameter_names
    np.testing.assert_array_equal(truth.values_of(ROBOT.parameter_names), ROBOT.parameters)
    assert truth.executed is truth.design
    assert (truth.experiment.samples, truth.robot) == (500, "palida")
    assert truth.experiment.samples_per_period == pytest.approx(500 / 3)
    np.testing.assert_array_equal(truth.force_covariance, ROBOT.description.noise.force_covariance)
    assert truth.disturbances["drift"] is None


def test_a_general_platform():
    run = load_run("palida").run
    robot = run.robot.model_dump(exclude_none=True) | {"platform": "general"}
    robot["parameters"] |= {"sx": 0.1, "sy": -0.2, "Ixy": 0.01, "Ixz": 0.02, "Iyz": 0.0}
    robot["noise"] = configuration(TINY).run.robot.noise.model_dump(exclude_none=True)
    general = load_run({"name": "g", "robot": robot, "experiment": {"periods": 1, "sampling": 50}})
    found = Twin.of(general, motion())
    assert len(found.truth.parameters) == 29
    samples = motion().sample(found.grid.times)
    expected = robot_from(general.robot).actuator_forces(
        samples.pose, samples.rate, samples.acceleration
    )
    np.testing.assert_allclose(found.measurement().forces, expected, atol=1e-9)


@pytest.mark.parametrize("size", [1e200, 1e308])
def test_a_motion_that_the_robot_cannot_make(size):
    wild = FourierTrajectory(np.pi, ROBOT.home, np.full((6, 1), size), np.zeros((6, 1)))
    with pytest.raises(InputError, match="cannot make the motion"):
        Twin.of(configuration(periods=1, sampling=50), wild)
