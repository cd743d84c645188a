import numpy as np
import pytest

from estimation.measurement_model import HarmonicMotion
from tests.columns import predict_forces, predict_lengths
from tests.estimation.cases import ROBOT, trajectory

TIMES = np.array([0.0, 0.013, 0.21, 0.4, 0.77, 1.3])
SIGNS = np.random.default_rng(0).choice([-1.0, 1.0], (len(TIMES), 18))


def differences(function, motion):
    """Return central differences of a function of the motion to its ξ."""
    columns = []
    for k in range(motion.unknowns):
        step = np.zeros(motion.unknowns)
        step[k] = 1e-6
        ahead = function(motion.add_step(step))
        behind = function(motion.add_step(-step))
        columns.append((ahead - behind) / 2e-6)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("free", [False, True])
def test_slope_of_the_lengths(free):
    motion = HarmonicMotion.of(trajectory(), free_frequency=free)
    lengths, slope = predict_lengths(ROBOT, motion, TIMES)
    expected = differences(lambda m: predict_lengths(ROBOT, m, TIMES)[0], motion)
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-8)
    poses = motion.trajectory.sample(TIMES).pose
    np.testing.assert_allclose(lengths, ROBOT.inverse_kinematics(poses), atol=1e-14)


@pytest.mark.parametrize("free", [False, True])
def test_slope_of_the_forces_with_held_signs(free):
    motion = HarmonicMotion.of(trajectory(), free_frequency=free)

    def forces(present):
        regressors, _ = predict_forces(ROBOT, present, TIMES, SIGNS, ROBOT.parameters)
        return regressors @ ROBOT.parameters

    _, found = predict_forces(ROBOT, motion, TIMES, SIGNS, ROBOT.parameters)
    expected = differences(forces, motion)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_a_motion_survives_more_harmonics_and_back():
    motion = HarmonicMotion.of(trajectory())
    longer = motion.with_harmonics(7)
    np.testing.assert_allclose(
        longer.trajectory.sample(TIMES).acceleration,
        motion.trajectory.sample(TIMES).acceleration,
        atol=1e-12,
    )
    np.testing.assert_array_equal(longer.with_harmonics(2).table, motion.table)
