"""Elimination of unknown signs of friction against generalised least squares, dense."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from estimation.diagnostics.hypothesis import periodic_columns, scan_pitches
from estimation.diagnostics.joint_system import joint_systems
from estimation.diagnostics.linearisation import Signature, linearise
from estimation.diagnostics.residual_covariance import (
    held_out_residual_covariance,
    joint_residual_covariance,
)
from estimation.estimators import Experiment
from estimation.estimators.experiment import UNSURE
from estimation.kinematics import fit_motion
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import PeriodSource, fold_recording
from estimation.processing.spectrum import given_filter
from expdesign.robot.deviation import force_jumps
from tests.diagnostics.conftest import HARMONICS, Laboratory

EFFECTS = 5


def _signs(rng, rows):
    """Return errors of the forces at random reversals, (6 R, s), N, and their prior precisions."""
    blocks, precision = [sparse.csr_array((6 * rows, 0))], []
    for _ in range(8):
        length, count = rng.integers(1, 12, 2)
        first = rng.integers(0, rows - length)
        own = rng.normal(size=(length, 6, count)) * 10.0 ** rng.uniform(-1, 2)
        own[:, rng.permutation(6)[: rng.integers(0, 6)]] = 0.0
        whole = np.zeros((rows, 6, count))
        whole[first : first + length] = own
        blocks.append(sparse.csr_array(whole.reshape(6 * rows, count)))
        precision += rng.uniform(1e-3, 1.0, count).tolist()
    return sparse.hstack(blocks, format="csr"), np.array(precision)


def test_a_reversal_that_a_delay_explains_has_no_column():
    """With these stamps the delay takes all of one reversal's variance that is significant."""
    lab = Laboratory(samples=300, periods=6, length_scale=1e-3)
    robot = replace(lab.robot, delay_std=1e-4)
    data = lab.measure(0)
    record = fold_recording(data, lab.trajectory.omega, PeriodSource.DESIGN)
    start = HarmonicMotion.of(lab.trajectory)
    fit = fit_motion(robot, record, lab.noise.lengths.as_white(), HARMONICS, start=start)
    experiment = Experiment.from_fit(robot, record, lab.noise, fit)
    later = record.forces.times + 0.0006250257190926164
    record = replace(record, forces=replace(record.forces, times=later))
    experiment = replace(experiment, recording=record)
    free = np.ones(len(lab.robot.parameters), dtype=bool)
    part = linearise(robot, experiment, lab.robot.parameters, free, fit.motion)
    assert part.sign_errors.shape == (6 * len(part.forces), len(part.sign_precision))
    assert len(part.sign_precision)


class Case:
    """A random experiment, and its fit by generalised least squares with a dense covariance."""

    def __init__(self, twin, seed, coloured):
        rng, part, noise = np.random.default_rng(seed), twin.part, twin.lab.noise
        rows = len(part.forces)
        if coloured:
            phase = np.exp(-2j * np.pi * np.arange(rows // 2 + 1) / rows)
            shape = 1 / np.abs(1 - 0.8 * phase) ** 2
            spectrum = noise.forces.covariance * (shape / np.mean(shape))[:, None, None]
            found = given_filter(noise.forces.covariance, spectrum.astype(complex), rows)
            noise = replace(noise, forces=replace(noise.forces, filter=found))
        else:
            part = replace(part, counts=rng.uniform(1, 5, rows))
        errors, precision = _signs(rng, rows)
        forces = 30 * rng.normal(size=(rows, 6))
        lengths = 1e-3 * rng.normal(size=part.lengths.shape)
        self.part = part = replace(
            part, forces=forces, lengths=lengths, sign_errors=errors, sign_precision=precision
        )
        self.noise = noise
        nothing = Signature.none(part)
        (self.system,) = joint_systems([part], [noise], twin.zero, [nothing], held_out=False)
        self.effects = Signature(
            rng.normal(size=(rows, 6, EFFECTS)),
            1e-4 * rng.normal(size=(*part.lengths.shape, EFFECTS)),
        )
        every = np.eye(6 * rows).reshape(rows, 6, -1)
        self.white = self.system.force_rows(every).reshape(6 * rows, -1)
        self.own = np.linalg.inv(self.white.T @ self.white)
        signs = errors.toarray()
        size = np.sqrt(part.length_counts)[:, None, None] * np.linalg.inv(
            np.linalg.cholesky(noise.lengths.covariance)
        )
        other = np.linalg.inv(sparse.block_diag(np.matmul(size.transpose(0, 2, 1), size)).toarray())
        self.covariance = np.block(
            [
                [self.own + signs / precision @ signs.T, np.zeros((len(self.own), len(other)))],
                [np.zeros((len(other), len(self.own))), other],
            ]
        )
        free = np.pad(part.length_columns, ((0, 0), (0, 0), (int(np.sum(part.free)), 0)))
        self.columns = self.stack(part.columns, free)
        self.inverse = np.linalg.inv(self.covariance)
        information = self.columns.T @ self.inverse @ self.columns
        scale = np.sqrt(np.diag(information))
        self.root = np.linalg.inv(np.linalg.cholesky(information / np.outer(scale, scale))).T
        self.root /= scale[:, None]
        measured = self.stack(forces, lengths)
        step = self.root @ (self.root.T @ (self.columns.T @ (self.inverse @ measured)))
        self.rest = measured - self.columns @ step

    @staticmethod
    def stack(forces, lengths):
        return np.concatenate([each.reshape(-1, *each.shape[2:]) for each in (forces, lengths)])

    def residual_covariance(self):
        """Return Cov(e*) of the forces, (6 R, 6 R), of the whitened rows."""
        forces = slice(len(self.own))
        through = self.white @ self.own @ self.inverse[forces]
        explained = through @ self.columns @ self.root
        return through @ self.covariance @ through.T - explained @ explained.T


@pytest.fixture(scope="module", params=[(0, False), (1, False), (2, True)])
def case(request, twin):
    return Case(twin, *request.param)


def test_tests_of_effects(case):
    z = case.stack(case.effects.forces, case.effects.lengths)
    weighted = case.inverse @ z
    mixed = weighted.T @ case.columns @ case.root
    found = case.system.solution.project(case.effects)
    score = weighted.T @ case.rest
    np.testing.assert_allclose(found.score, score, rtol=1e-6, atol=1e-9 * np.abs(score).max())
    information = z.T @ weighted - mixed @ mixed.T
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(
        found.information / np.outer(scale, scale), information / np.outer(scale, scale), atol=1e-9
    )
    whole = np.sum(case.system.whiten(case.effects) ** 2, axis=0)
    np.testing.assert_allclose(found.whole, whole, rtol=1e-12)


def test_residuals_and_their_covariance(case):
    rows, solved = len(case.part.forces), case.system.solution
    white = case.white @ case.own @ case.inverse[: 6 * rows] @ case.rest
    residuals = case.system.force_rows.unscale(white.reshape(rows, 6))
    size = np.abs(residuals).max()
    np.testing.assert_allclose(solved.force_residuals(), residuals, atol=1e-8 * size)
    law = joint_residual_covariance(case.noise.forces, solved)
    scale = np.kron(np.eye(rows), np.linalg.inv(case.system.force_rows.white))
    expected = scale @ case.residual_covariance() @ scale.T
    sigma = case.noise.forces.covariance
    for channel in range(6):
        own = expected[channel::6, channel::6] / sigma[channel, channel]
        weights = np.linalg.eigvalsh(own)
        np.testing.assert_allclose(np.sort(law.weights(channel)), weights, atol=1e-8)
        for lag in (0, 1, 3):
            trace = np.trace(own, lag) - rows * (lag == 0)
            assert law.lagged_covariance(channel, lag) == pytest.approx(trace, abs=1e-7)
    inverse = np.linalg.inv(sigma)
    total = np.sum(np.kron(np.eye(rows), inverse) * expected)
    assert law.expected_sum(inverse) == pytest.approx(total, rel=1e-9)


def test_effects_included_later(case):
    """Included in the solution or in the system, effects leave the same."""
    solved, system = case.system.solution.with_effects(case.effects), case.system
    again = system.with_effects(case.effects).solution
    scale = np.sqrt(np.diag(again.inverse))
    own, other = (each.inverse / np.outer(scale, scale) for each in (solved, again))
    np.testing.assert_allclose(own, other, atol=1e-8)
    np.testing.assert_allclose(solved.rest, again.rest, atol=1e-8 * np.abs(again.rest).max())
    assert solved.system.columns.shape == again.system.columns.shape


def test_scan_of_pitches(case):
    """A scan is the test of sine and cosine, with and without known effects."""
    solved = case.system.solution
    for known in (solved, solved.with_effects(case.effects)):
        scan = scan_pitches(known, case.part, 2, 1e-3)
        k = len(scan.pitches) // 2
        columns = periodic_columns(case.part, 2, scan.pitches[k], (0.0, 0.0))[:, :, :2]
        expected = known.fit(Signature.of_forces(case.part, columns)).statistic
        assert scan.statistic[k] == pytest.approx(expected, rel=1e-6)


def test_prediction_with_unknown_signs(case, twin):
    """The errors of predicted forces have the variance of the noise, the fit and the signs."""
    experiment = replace(twin.experiment, noise=case.noise)
    part = case.part.apply_filters(case.noise)
    law = held_out_residual_covariance(part, experiment, twin.estimates["gm"])
    scale = np.sqrt(part.counts)[:, None, None]
    signs = case.part.sign_errors.toarray().reshape(*part.forces.shape, -1)
    if case.noise.forces.filter is not None:
        signs = case.noise.forces.filter(signs)
    estimate = twin.estimates["gm"].covariance
    for channel in (0, 4):
        sigma = case.noise.forces.covariance[channel, channel]
        own = part.regressors[:, channel] * scale[:, 0]
        motion = part.motion_columns[:, channel] * scale[:, 0]
        unsure = signs[:, channel] * scale[:, 0]
        added = own @ estimate @ own.T + motion @ experiment.fit.covariance @ motion.T
        expected = np.linalg.eigvalsh(np.eye(len(own)) + (added + unsure @ unsure.T) / sigma)
        np.testing.assert_allclose(np.sort(law.weights(channel)), expected, rtol=1e-6)


@pytest.mark.parametrize("held_out", [False, True])
def test_signs_of_several_experiments_beside_tolerances_and_a_prior(twin, held_out):
    """One dense system that has the signs of all experiments among its unknowns."""
    rng, zero, noise = np.random.default_rng(3), twin.zero, twin.lab.noise
    rows, lengths = len(twin.part.forces), twin.part.lengths

    def columns(count):
        of_lengths = 1e-4 * rng.normal(size=(*lengths.shape, count))
        return Signature(rng.normal(size=(rows, 6, count)), of_lengths)

    parts = []
    for _ in range(3):
        errors, precision = _signs(rng, rows)
        forces, read = 30 * rng.normal(size=(rows, 6)), 1e-3 * rng.normal(size=lengths.shape)
        signs = {"sign_errors": errors, "sign_precision": precision}
        parts.append(replace(twin.part, forces=forces, lengths=read, **signs))
    parameters = len(zero.gradient)
    root = rng.normal(size=(parameters, parameters))
    prior = NormalEquations(0.0, 1e-3 * root @ root.T, rng.normal(size=parameters))
    tolerances, effects = [columns(4) for _ in parts], [columns(3) for _ in parts]
    given, off = rng.uniform(0.5, 2, 4), rng.normal(size=4)
    systems = joint_systems(parts, [noise] * 3, prior, tolerances, held_out=held_out)

    known = parameters + len(given)
    own, others = [], []  # dense columns of each experiment, and their precisions
    for part, tolerance in zip(parts, tolerances, strict=True):
        plain = replace(part, sign_errors=part.sign_errors[:, :0], sign_precision=np.zeros(0))
        (raw,) = joint_systems([plain], [noise], zero, [Signature.none(part)], held_out=False)
        signs = Signature.of_forces(part, part.sign_errors.toarray().reshape(rows, 6, -1))
        motion = raw.columns[:, parameters:]
        own.append(
            [raw, raw.columns[:, :parameters], raw.whiten(tolerance), motion, raw.whiten(signs)]
        )
        others.append(np.r_[np.zeros(motion.shape[1]), part.sign_precision])
    for target, (raw, *_) in enumerate(own):
        used = [target] if held_out else [0, 1, 2]
        ends = np.cumsum([known, *(len(others[each]) for each in used)])
        dense = []
        for each, end, first in zip(used, ends[1:], ends, strict=False):
            _, shared, tolerated, *rest = own[each]
            whole = np.zeros((len(shared), ends[-1]))
            whole[:, :known] = np.hstack([shared, tolerated])
            whole[:, first:end] = np.hstack(rest)
            dense.append(whole)
        matrix = sum(one.T @ one for one in dense)
        gradient = sum(
            one.T @ own[each][0].residuals for one, each in zip(dense, used, strict=True)
        )
        matrix += np.diag(np.r_[np.zeros(parameters), given, *(others[each] for each in used)])
        matrix[:parameters, :parameters] += prior.matrix
        gradient[:known] += np.r_[prior.gradient, given * off]
        scale = np.sqrt(np.diag(matrix))
        step = np.linalg.solve(matrix / np.outer(scale, scale), gradient / scale) / scale
        mine, wanted = dense[used.index(target)], raw.whiten(effects[target])
        left = raw.residuals - mine @ step
        mixed = (mine.T @ wanted) / scale[:, None]
        lost = mixed.T @ np.linalg.solve(matrix / np.outer(scale, scale), mixed)
        solved = systems[target].with_tolerances(tolerances[target], given, off).solution
        found = solved.project(effects[target])
        np.testing.assert_allclose(found.score, wanted.T @ left, rtol=1e-8)
        np.testing.assert_allclose(found.information, wanted.T @ wanted - lost, rtol=1e-8)


def test_unknown_signs_have_the_variance_of_their_rows(twin):
    """A sign that is 1 with P has the variance 4 P (1 − P); it is zero away from reversals."""
    lab, experiment = twin.lab, twin.experiment
    values, motion = lab.robot.parameters, experiment.fit.motion
    free = np.ones(len(values), dtype=bool)
    part = linearise(lab.robot, experiment, values, free, motion)
    times = experiment.recording.forces.times
    signs = experiment.along_motion(motion).signs(lab.robot, times)
    jumps, _, _ = force_jumps(lab.robot, motion.at(times).state(), signs, values)
    share = (1 + signs) / 2
    of_rows = np.einsum("tir,tr->ti", jumps**2, 4 * share * (1 - share))
    found = (part.sign_errors.toarray() ** 2).sum(axis=1).reshape(of_rows.shape)
    np.testing.assert_allclose(found, of_rows, atol=2 * UNSURE * np.max(jumps**2))
    assert np.any(found > 0)
    assert np.mean(np.any(found > 0, axis=1)) < 0.9
