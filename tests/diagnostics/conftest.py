"""A small laboratory: PaLiDA on a short trajectory, and its linearised twin for many draws."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from scipy import stats

from estimation.data.measurement import Measurement
from estimation.diagnostics.hypotheses import list_hypotheses
from estimation.diagnostics.joint_system import joint_systems
from estimation.diagnostics.linearisation import CandidateEffects, Signature, linearise
from estimation.diagnostics.residual_covariance import (
    held_out_residual_covariance,
    joint_residual_covariance,
)
from estimation.estimators import Experiment, ParameterPriors, linear_estimate, maximum_likelihood
from estimation.kinematics import fit_motion, pointwise_motion
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import NoiseEstimate, NoiseModel, PeriodSource, fold_recording
from expdesign.configuration.estimate import EstimateSection
from expdesign.robot import load_robot
from expdesign.trajectory import FourierTrajectory
from tests.estimation.cases import given_noise

HARMONICS = 3


def excitation():
    rng = np.random.default_rng(5)
    size = np.array([0.05, 0.05, 0.05, 0.12, 0.12, 0.25])[:, None] / np.arange(1, HARMONICS + 1)
    sine, cosine = size * rng.uniform(-1, 1, (2, 6, HARMONICS))
    centre = [0, 0, -0.654, 0, 0, 0]
    return FourierTrajectory.from_displacements(2 * np.pi * 1.0, centre, sine, cosine)


@dataclass(frozen=True)
class Laboratory:
    """Simulated experiments; `samples` per period, `periods`, noise of the lengths scaled."""

    samples: int
    periods: int
    length_scale: float = 1.0

    @cached_property
    def robot(self):
        return load_robot("palida")

    @cached_property
    def knowledge(self):
        return ParameterPriors.of(self.robot, EstimateSection())

    @cached_property
    def trajectory(self):
        return excitation()

    @property
    def noise(self):
        given = self.robot.description.noise
        return given_noise(given.force_covariance, given.length_covariance * self.length_scale**2)

    def measure(self, seed, *, cogging=None, delay=0.0, parameters=None, samples=None):
        """Measure; a number of samples per period that is not whole keeps the periods apart."""
        rng = np.random.default_rng(seed)
        count = self.samples if samples is None else samples
        step = self.trajectory.period / count
        rows = int(np.floor(self.periods * count))
        time = np.arange(rows) * step
        lengths = self.robot.inverse_kinematics(self.trajectory.sample(time).pose)
        late = self.trajectory.sample(time - delay)
        forces = self.robot.actuator_forces(late.pose, late.rate, late.acceleration, parameters)
        if cogging is not None:
            amplitude, pitch, phase = (np.asarray(part, dtype=float) for part in cogging)
            late_lengths = self.robot.inverse_kinematics(late.pose)
            forces = forces + amplitude * np.sin(2 * np.pi * late_lengths / pitch + phase)
        lengths = lengths + _normal(rng, self.noise.lengths.covariance, rows)
        forces = forces + _normal(rng, self.noise.forces.covariance, rows)
        return Measurement(time, lengths, forces, step)

    def experiment(self, data, noise=None):
        record = fold_recording(data, self.trajectory.omega, PeriodSource.DESIGN)
        model = noise if noise is not None else estimated(record)
        start = HarmonicMotion.of(self.trajectory)
        fit = fit_motion(self.robot, record, model.lengths.as_white(), HARMONICS, start=start)
        return Experiment.from_fit(self.robot, record, model, fit)

    def pointwise(self, data):
        record = fold_recording(data, self.trajectory.omega, PeriodSource.DESIGN)
        motion = pointwise_motion(self.robot, record)
        return Experiment.from_points(self.robot, record, estimated(record), motion)

    def estimate(self, experiments, estimator="gm"):
        if estimator != "ml":
            return linear_estimate(self.robot, experiments, self.knowledge, estimator)
        gm = linear_estimate(self.robot, experiments, self.knowledge, "gm")
        return maximum_likelihood(self.robot, experiments, self.knowledge, gm)


def estimated(record):
    return NoiseModel(record.forces.scatter, record.lengths.scatter)


def _normal(rng, covariance, rows):
    return rng.standard_normal((rows, 6)) @ np.linalg.cholesky(covariance).T


class LinearTwin:
    """The laboratory's experiment linearised at the truth: residuals drawn without any fit.

    Lengths are noisy enough for the motion's error to show in the forces.
    """

    def __init__(self, laboratory):
        self.lab = laboratory
        noise = laboratory.noise
        self.experiment = laboratory.experiment(laboratory.measure(0), noise)
        k = len(laboratory.knowledge.names)
        self.zero = NormalEquations(0.0, np.zeros((k, k)), np.zeros(k))
        self.part = linearise(
            laboratory.robot,
            self.experiment,
            laboratory.robot.parameters,
            laboratory.knowledge.free,
            self.experiment.fit.motion,
        )
        # The linear law is what is tested: unknown signs of friction are no part of the draws.
        none = self.part.sign_errors[:, :0]
        self.part = replace(self.part, sign_errors=none, sign_precision=np.zeros(0))
        self.estimates = {"gm": laboratory.estimate([self.experiment], "gm")}
        self.freedom = float((laboratory.periods - 1) * laboratory.samples)

    def system(self, part, *, known=None, held_out=False):
        noise = self.lab.noise
        model = replace(noise, forces=replace(noise.forces, freedom=self.freedom))
        information = self.zero if known is None else known
        none = Signature.none(part)
        return joint_systems([part], [model], information, [none], held_out=held_out)[0]

    def families(self, *, held_out):
        """Return the causes that are looked for at the truth."""
        lab, motion = self.lab, self.experiment.fit.motion
        suspects = CandidateEffects(
            lab.robot, self.experiment, motion, lab.robot.parameters, self.part
        )
        return list_hypotheses(suspects, lab.knowledge.names, held_out=held_out)

    def law(self, kind):
        if kind == "held out":
            return held_out_residual_covariance(self.part, self.experiment, self.estimates["gm"])
        noise = self.experiment.noise.forces
        return joint_residual_covariance(noise, self.system(self.part).solution)

    def draw(self, rng, kind):
        """Return the linearisation with the residuals that are tested.

        The joint fit takes those of every estimator to the same place.
        """
        lab, part, noise = self.lab, self.part, self.lab.noise
        scale = np.sqrt(lab.periods)
        forces = _normal(rng, noise.forces.covariance, lab.samples) / scale
        lengths = _normal(rng, noise.lengths.covariance, lab.samples) / scale
        scatter = stats.wishart.rvs(self.freedom, noise.forces.covariance, random_state=rng)
        drawn = replace(
            part,
            forces=forces,
            lengths=lengths,
            force_scatter=NoiseEstimate(scatter / self.freedom, self.freedom),
        )
        if kind == "ml":
            return replace(drawn, forces=self.system(drawn).solution.force_residuals())
        inverse = np.linalg.inv(noise.lengths.covariance)
        columns = part.length_columns
        weighted = np.einsum("ij,rjx->rix", inverse, columns)
        normal = np.einsum("rix,riy->xy", weighted, columns)
        motion = np.linalg.solve(normal, np.einsum("rix,ri->x", weighted, lengths))
        rest = forces - part.motion_columns @ motion
        lengths = lengths - columns @ motion
        if kind == "held out":
            covariance = self.estimates["gm"].covariance
            wrong = np.linalg.cholesky(covariance) @ rng.standard_normal(len(covariance))
        else:
            inner = np.eye(6) if kind == "ls" else np.linalg.inv(noise.forces.covariance)
            weighted = np.einsum("ij,rjk->rik", inner, part.regressors)
            normal = np.einsum("rik,ril->kl", weighted, part.regressors)
            wrong = np.linalg.solve(normal, np.einsum("rik,ri->k", weighted, rest))
        drawn = replace(drawn, forces=rest - part.regressors @ wrong, lengths=lengths)
        if kind == "held out":
            return drawn
        return replace(drawn, forces=self.system(drawn).solution.force_residuals())


@pytest.fixture(scope="session")
def laboratory():
    return Laboratory(samples=200, periods=4)


@pytest.fixture(scope="session")
def sharp():
    """Return a laboratory whose lengths show the sign of every friction force."""
    return Laboratory(samples=200, periods=4, length_scale=0.01)


@pytest.fixture(scope="session")
def twin():
    return LinearTwin(Laboratory(samples=120, periods=4, length_scale=10.0))


@pytest.fixture(scope="session")
def sound(laboratory):
    """Return a sound experiment and its ML estimate."""
    experiment = laboratory.experiment(laboratory.measure(1))
    return experiment, laboratory.estimate([experiment], "ml")
