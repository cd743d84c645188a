"""A recording at rest is told from a motion, and cut where its noise can be seen."""

import numpy as np
import pytest

from estimation.data.measurement import Measurement
from estimation.processing import PeriodError
from estimation.processing.hum import mains_frequencies
from estimation.processing.rest import at_rest, omega_at_rest
from tests.estimation.cases import ROBOT, measured, trajectory

HOME = ROBOT.inverse_kinematics(ROBOT.home)
SIZE = 1e-4


def resting(noise, step=0.001):
    time = step * np.arange(len(noise))
    return Measurement(time, HOME + noise, np.zeros((len(noise), 6)), step)


def remembering(memory, rows=4000, seed=0):
    """Return noise of which each sample is so much of the one before."""
    drawn = SIZE * np.random.default_rng(seed).normal(size=(rows, 6))
    for k in range(1, rows):
        drawn[k] += memory * drawn[k - 1]
    return drawn


@pytest.mark.parametrize("memory", [-0.5, 0.0, 0.7])
@pytest.mark.parametrize("drift", [0.0, 20 * SIZE])
@pytest.mark.parametrize("resolution", [None, 2 * SIZE, 100 * SIZE])
def test_noise_and_drift_are_rest(memory, drift, resolution):
    noise = remembering(memory) + drift * np.linspace(0, 1, 4000)[:, None]
    data = resting(noise)
    if resolution is not None:
        data = resting(np.round((HOME + noise) / resolution) * resolution - HOME)
    assert at_rest(data)


@pytest.mark.parametrize("share", [0.01, 1.0])
def test_a_motion_is_not(share):
    moving = measured(trajectory(), length_scale=0.1)
    home = moving.lengths.mean(axis=0)
    small = Measurement(
        moving.time, home + share * (moving.lengths - home), moving.forces, moving.step
    )
    assert not at_rest(small)
    one = resting(remembering(0.0))
    one.lengths[:, 3] += 0.05 * np.sin(one.time)
    assert not at_rest(one)


@pytest.mark.parametrize(
    ("rows", "step"), [(60, 0.01), (700, 0.002), (10_000, 0.001), (5000, 1e-4)]
)
def test_parts_are_whole_samples_away_from_the_mains(rows, step):
    data = resting(remembering(0.0, rows), step)
    length = 2 * np.pi / omega_at_rest(data) / step
    assert length == pytest.approx(round(length), abs=1e-9)
    parts = rows // round(length)
    assert 3 <= parts <= 10
    assert parts * round(length) > 0.85 * rows
    mains = np.array(list(mains_frequencies(1 / step)))
    turns = length * step * mains
    if len(mains) and rows > 600:
        assert np.min(np.abs(turns - np.round(turns))) * parts > 0.3


def test_too_short():
    with pytest.raises(PeriodError, match="60 or more"):
        omega_at_rest(resting(remembering(0.0, 59)))
