"""A small PaLiDA experiment that takes some 50 ms to estimate: two harmonics, 200 samples."""

import numpy as np

from estimation.data.measurement import Measurement
from estimation.estimators import ParameterEstimate
from estimation.identification.estimate import identified_model
from estimation.identification.result import EstimateFile
from estimation.processing import NoiseEstimate, NoiseModel
from expdesign.configuration import load_run
from expdesign.robot import load_robot
from expdesign.trajectory import FourierTrajectory

ROBOT = load_robot("palida")
STEP = 0.005
PERIODS = 5


def run(estimate=None, **sections):
    return load_run({"name": "case", "robot": "palida", "estimate": estimate or {}, **sections})


def given_noise(forces, lengths):
    """Return the noise of known covariances."""
    return NoiseModel(*(NoiseEstimate(each, np.inf, "given") for each in (forces, lengths)))


def trajectory(samples=200, step=STEP, harmonics=2, seed=4):
    """Return a lively motion within reach whose period is `samples` steps."""
    rng = np.random.default_rng(seed)
    sizes = np.array([0.08, 0.08, 0.06, 0.15, 0.15, 0.5])[:, None] / np.arange(1, harmonics + 1)
    return FourierTrajectory.from_displacements(
        2 * np.pi / (samples * step),
        ROBOT.home,
        sizes * rng.choice([-1, 1], sizes.shape) * rng.uniform(0.4, 0.7, sizes.shape),
        sizes * rng.choice([-1, 1], sizes.shape) * rng.uniform(0.4, 0.7, sizes.shape),
    )


def measured(
    motion,
    seed=0,
    *,
    robot=ROBOT,
    periods=PERIODS,
    step=STEP,
    force_scale=1.0,
    length_scale=1.0,
    times=None,
):
    """Return what an ideal machine measures, with the robot's noise times the scales."""
    count = round(periods * motion.period / step)
    grid = np.arange(count) * step if times is None else times
    rng = np.random.default_rng(seed)
    noise = robot.description.noise
    states = motion.sample(grid)
    lengths = robot.inverse_kinematics(states.pose)
    forces = robot.actuator_forces(states.pose, states.rate, states.acceleration)
    lengths = lengths + length_scale * _draws(rng, noise.length_covariance, len(grid))
    forces = forces + force_scale * _draws(rng, noise.force_covariance, len(grid))
    return Measurement(grid, lengths, forces, step)


def _draws(rng, covariance, count):
    return rng.normal(size=(count, 6)) @ np.linalg.cholesky(covariance).T


def read_estimate(folder, robot):
    """Return the best estimate of a run folder."""
    return identified_model(EstimateFile.read(folder), folder / EstimateFile.FILE, robot)


def made_up(values, spread):
    """Return an estimate with these values and standard deviations, (m,), or covariance, (m, m)."""
    count = len(values)
    covariance = spread
    if np.ndim(spread) < 2:
        covariance = np.diag(np.broadcast_to(spread, count) ** 2)
    return ParameterEstimate(
        estimator="gm",
        values=np.asarray(values, dtype=float),
        covariance=covariance,
        covariance_forces=covariance,
        covariance_kinematics=None,
        freedom=np.full(count, np.inf),
        colour=np.ones(count),
        influences=(),
        motions=(),
        cost=0.0,
        iterations=1,
        converged=True,
        status="",
        seconds=0.0,
    )
