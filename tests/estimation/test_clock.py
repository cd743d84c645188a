import dataclasses

import numpy as np
import pytest

from estimation.identification.periods import clock_error
from estimation.kinematics import fit_motion
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseEstimate, PeriodSource, fold_recording
from tests.estimation.cases import ROBOT, measured, trajectory

PRECISE = 0.02
DELTA = PRECISE**2 * ROBOT.description.noise.length_covariance
OFF = 2e-5
DRAWS = 12


def found(seed, periods):
    """Return the error of a clock that is off, and its std, from single precise samples."""
    motion = trajectory()
    data = measured(motion, seed, periods=periods, length_scale=PRECISE)
    data = dataclasses.replace(data, time=data.time / (1 + OFF), step=data.step / (1 + OFF))
    record = fold_recording(data, motion.omega, PeriodSource.DESIGN, average=False)
    fit = fit_motion(
        ROBOT, record, NoiseEstimate(DELTA, np.inf, "given"), 2, start=HarmonicMotion.of(motion)
    )
    return clock_error(ROBOT, record, fit.motion, DELTA)


def test_the_slope_is_the_clocks_error():
    """Also of few periods, where the fit takes up much of t l̇(t)."""
    scores = []
    for periods in (2, 3, 6):
        errors, (std, *_) = zip(*(found(seed, periods) for seed in range(DRAWS)), strict=True)
        assert 3.5 * std / np.sqrt(DRAWS) < 0.1 * OFF
        assert np.mean(errors) == pytest.approx(OFF, abs=3.5 * std / np.sqrt(DRAWS))
        scores.append((np.array(errors) - OFF) / std)
    # Of so many draws together the spread is known to an eighth.
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1, abs=0.4)


def test_one_period_tells_nothing():
    assert found(0, 1) == (0.0, np.inf)
