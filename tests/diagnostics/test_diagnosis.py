import json
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
import pytest

from estimation.data.measurement import Measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import Diagnosis
from estimation.diagnostics.finding import FindingOutcome, Status
from estimation.processing import PeriodSource, fold_recording
from expdesign.runfolder import JsonFile, described
from tests.estimation.cases import given_noise


def _diagnose(lab, experiments, estimate, **options):
    return diagnose(lab.robot, experiments, lab.knowledge, estimate, **options)


def _outcomes(result):
    return {f.assumption: f.outcome for f in result.verdict.findings}


def test_a_sound_estimate_is_accepted(laboratory, sound):
    experiment, estimate = sound
    result = _diagnose(laboratory, [experiment], estimate)
    assert result.verdict.status is Status.ACCEPTED, result.verdict.summary
    assert all(f.outcome is FindingOutcome.HOLDS for f in result.verdict.findings)
    assert not any(f.advice for f in result.verdict.findings)
    assert result.verdict.summary.startswith("accepted")
    assert all(recording.tests.settled for recording in result.recordings)


def test_estimators_agree_on_what_the_model_lacks(laboratory, sound):
    """The joint step takes the residuals of every estimator to the same place."""
    experiment, ml = sound
    scores = []
    for estimate in (ml, *(laboratory.estimate([experiment], kind) for kind in ("ls", "gm"))):
        attribution = _diagnose(laboratory, [experiment], estimate).recordings[0].attribution
        scores.append([scan.best for scan in attribution.first.scans])
    np.testing.assert_allclose(scores[1], scores[0], rtol=0.03)
    np.testing.assert_allclose(scores[2], scores[0], rtol=0.03)


def test_the_step_is_nothing_at_the_maximum_of_likelihood(sharp):
    experiment = sharp.experiment(sharp.measure(1))
    diagnosis = _diagnose(sharp, [experiment], sharp.estimate([experiment], "ml")).recordings[0]
    left = diagnosis.attribution.last.solution.force_residuals()
    np.testing.assert_allclose(left, diagnosis.residuals.forces, atol=0.02)


@dataclass(frozen=True, eq=False)
class DiagnosisFile(JsonFile):
    """A diagnosis in a file of its own."""

    FILE: ClassVar[str] = "diagnosis.json"
    WRITTEN_BY: ClassVar[str] = "this test"
    diagnosis: Annotated[Diagnosis, described("", "")]


def _written(result, folder):
    """Return what a file says of a diagnosis, which is the same after it was read."""
    (path,) = DiagnosisFile(result).write(folder)
    text = path.read_text(encoding="utf-8")
    DiagnosisFile.read(path).write(folder)
    assert path.read_text(encoding="utf-8") == text
    return json.loads(text)["diagnosis"]


def test_a_diagnosis_in_a_file(laboratory, sound, tmp_path):
    experiment, estimate = sound
    result = _diagnose(laboratory, [experiment], estimate)
    document = _written(result, tmp_path)
    assert document["estimator"] == "ml"
    assert document["verdict"]["status"] == "accepted"
    (only,) = document["experiments"]
    test = result.recordings[0].tests.lack_of_fit
    assert only["lack_of_fit"]["ms_lof"] == pytest.approx(test.mean_square.tolist())
    assert only["lack_of_fit"]["failed"] == []
    assert [scan["strut"] for scan in only["position_periodic"]] == [1, 2, 3, 4, 5, 6]
    kinds = {family["kind"]: family for family in only["causes"]}
    assert len(kinds["column"]["candidates"]) == 72
    assert [joint["parameter"] for joint in kinds["joint"]["candidates"]] == [
        *["base"] * 6,
        *["platform"] * 6,
    ]
    assert all(len(joint["values"]) == 3 for joint in kinds["joint"]["candidates"])


def test_residuals_of_every_period_average_to_the_mean(laboratory, sound):
    experiment, estimate = sound
    diagnosis = _diagnose(laboratory, [experiment], estimate).recordings[0]
    record, rest = experiment.recording, diagnosis.residuals.forces
    periods = record.forces.periods - (record.forces.values - rest)
    np.testing.assert_allclose(periods.mean(axis=0), rest, atol=1e-9)
    comparison = diagnosis.tests.variance_comparison
    np.testing.assert_allclose(comparison.model_error, np.mean(periods**2, (0, 1)))
    np.testing.assert_allclose(comparison.model_error / comparison.measurement_error, 1, atol=0.2)


def test_a_prediction_of_sound_data_is_accepted(laboratory, sound):
    _, estimate = sound
    held = laboratory.experiment(laboratory.measure(20))
    result = _diagnose(laboratory, [held], estimate, held_out=True)
    assert result.verdict.status is Status.ACCEPTED
    np.testing.assert_array_equal(result.recordings[0].tests.lack_of_fit.fitted_freedom, 0)


@pytest.mark.parametrize("estimator", ["gm", "ml"])
def test_two_experiments_share_the_levels_and_the_parameters(sharp, estimator):
    experiments = [sharp.experiment(sharp.measure(seed)) for seed in (31, 32)]
    estimate = sharp.estimate(experiments, estimator)
    result = _diagnose(sharp, experiments, estimate)
    first, second = (d.tests.lack_of_fit for d in result.recordings)
    assert first.level == pytest.approx(0.005)
    # Half of the parameters' share each.
    alone = _diagnose(
        sharp, experiments[:1], sharp.estimate(experiments[:1], estimator)
    ).recordings[0]
    fitted = alone.tests.lack_of_fit.fitted_freedom
    np.testing.assert_allclose(first.fitted_freedom + second.fitted_freedom, fitted, atol=0.15)
    assert any(f.sentence.startswith("experiment 2: ") for f in result.verdict.findings)
    named = ("the forces are as noisy as assumed", "the fitted motion explains the lengths")
    levels = [f.level for f in result.verdict.findings if f.assumption in named]
    assert levels == pytest.approx([0.0005] * 4)


def test_noise_from_residuals_refuses_the_bias_test(laboratory, sound, tmp_path):
    experiment, estimate = sound
    forces = replace(experiment.noise.forces, source="residuals")
    own = replace(experiment.noise, forces=forces)
    result = _diagnose(laboratory, [replace(experiment, noise=own)], estimate)
    assert _outcomes(result)["the model explains the forces"] is FindingOutcome.NOT_TESTED
    refused = _written(result, tmp_path)["experiments"][0]["lack_of_fit"]
    assert "includes the error of the model" in refused["refused"]
    assert "f" not in refused
    assert "not tested: the model explains the forces" in result.verdict.summary


def test_one_period_with_given_noise(laboratory, sound):
    _, estimate = sound
    data = laboratory.measure(40)
    rows = slice(0, laboratory.samples)
    one = Measurement(data.time[rows], data.lengths[rows], data.forces[rows], data.step)
    experiment = laboratory.experiment(one, laboratory.noise)
    result = _diagnose(laboratory, [experiment], estimate, held_out=True)
    outcomes = _outcomes(result)
    assert outcomes["the model explains the forces"] is FindingOutcome.NOT_TESTED
    assert outcomes["the noise is white"] is FindingOutcome.NOT_TESTED
    assert outcomes["all periods are alike"] is FindingOutcome.NOT_TESTED
    assert outcomes["the forces are as noisy as assumed"] is FindingOutcome.HOLDS
    assert result.recordings[0].tests.normality.source == "residuals"


def test_noise_that_was_given_too_large_or_too_small(laboratory, sound):
    experiment, estimate = sound
    for factor, word in ((1.5, "too small"), (0.7, "too large")):
        noise = given_noise(
            factor * laboratory.noise.forces.covariance, laboratory.noise.lengths.covariance
        )
        result = _diagnose(laboratory, [replace(experiment, noise=noise)], estimate)
        sentences = [f.sentence for f in result.verdict.failed]
        assert any(f"force residuals are {word}" in sentence for sentence in sentences)


def test_pointwise_kinematics(laboratory, tmp_path):
    experiment = laboratory.pointwise(laboratory.measure(1))
    estimate = laboratory.estimate([experiment], "gm")
    result = _diagnose(laboratory, [experiment], estimate)
    outcomes = _outcomes(result)
    assert outcomes["the fitted motion explains the lengths"] is FindingOutcome.NOT_TESTED
    assert outcomes["forces and lengths are sampled at the same time"] is FindingOutcome.NOT_TESTED
    diagnosis = result.recordings[0]
    assert diagnosis.pointwise
    assert diagnosis.tests.chi_square.lengths is None
    _written(result, tmp_path)


def test_motion_with_too_few_harmonics_is_noticed(laboratory):
    from estimation.estimators import Experiment
    from estimation.kinematics import fit_motion
    from estimation.measurement_model import HarmonicMotion

    record = fold_recording(laboratory.measure(1), laboratory.trajectory.omega, PeriodSource.DESIGN)
    start = HarmonicMotion.of(laboratory.trajectory)
    fit = fit_motion(laboratory.robot, record, laboratory.noise.lengths, 2, start=start)
    experiment = Experiment.from_fit(laboratory.robot, record, laboratory.noise, fit)
    result = _diagnose(laboratory, [experiment], laboratory.estimate([experiment]))
    failed = [
        f for f in result.verdict.failed if f.assumption == "the fitted motion explains the lengths"
    ]
    assert len(failed) == 1
    assert "harmonics" in failed[0].advice


def test_disturbed_measurements_are_described(laboratory, sound):
    """Outliers in a force, drift of a strut: named, and the estimate is doubtful."""
    data = laboratory.measure(60)
    rng = np.random.default_rng(0)
    forces, lengths = data.forces.copy(), data.lengths.copy()
    forces[rng.choice(len(forces), 6, replace=False), 4] += 300.0
    lengths[:, 1] += 2e-4 * np.arange(len(lengths)) / len(lengths)
    experiment = laboratory.experiment(replace(data, forces=forces, lengths=lengths))
    result = _diagnose(laboratory, [experiment], laboratory.estimate([experiment], "ml"))
    sentences = {f.assumption: f.sentence for f in result.verdict.failed}
    assert "force 5: 6" in sentences["no outliers"]
    assert "lengths of strut 2" in sentences["all periods are alike"]
    assert result.verdict.status is Status.DOUBTFUL
