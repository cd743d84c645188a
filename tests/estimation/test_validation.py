import json
from dataclasses import replace

import numpy as np
import pytest

from estimation.diagnostics.diagnosis_result import Diagnosis
from estimation.diagnostics.finding import Assumption, DiagnosisVerdict, Status
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.estimate import identified_model
from estimation.identification.result import EstimationResult
from estimation.twin.truth import write_measurement
from estimation.validation.validate import ValidationResult, validate
from expdesign.configuration import InputError, load_run
from expdesign.configuration.experiment import ValidationMotion
from expdesign.motion.benchmark import benchmark_motion
from results.views.folder import RunFolder
from results.views.validate import validation_view
from results.views.view import TextBlock
from tests.estimation.cases import ROBOT, STEP, measured, read_estimate, run, trajectory

MOTION = trajectory(seed=2)
SAMPLING = f"{1 / STEP} Hz"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a run folder with an estimate."""
    path = tmp_path_factory.mktemp("estimate")
    estimation_result(estimate_parameters(run(), measured(MOTION, periods=10), MOTION)).write(path)
    return path


def case(cogging=None, noise=None, **motion):
    experiment = {"sampling": SAMPLING}
    if cogging:
        experiment["cogging"] = {"amplitude": cogging, "pitch": 0.03}
    return load_run(
        {
            "name": "case",
            "robot": "palida",
            "experiment": experiment,
            **({"noise": noise} if noise else {}),
            "validate": [{"motion": "circle", "radius": 0.1, "speed": 0.5, **motion}],
        }
    )


def test_the_circle_of_the_benchmark():
    circle = benchmark_motion(ValidationMotion(motion="circle"), ROBOT.home, 1e-3)
    times = circle.sample_times(720)
    states = circle.sample(times)
    off = states.pose[:, :3] - ROBOT.home[:3]
    normal = np.array([0, -0.5, np.sqrt(3) / 2])
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), 0.15, rtol=1e-12)
    np.testing.assert_allclose(off @ normal, 0, atol=1e-12)
    np.testing.assert_allclose(off[0], [0.15, 0, 0], atol=1e-12)
    # Counter-clockwise about the normal, and 1 m/s but for the whole number of steps.
    turning = np.cross(off, states.rate[:, :3]) @ normal
    assert np.all(turning > 0)
    np.testing.assert_allclose(np.linalg.norm(states.rate[:, :3], axis=1), 1.0, rtol=1e-3)
    assert circle.period / 1e-3 == pytest.approx(round(circle.period / 1e-3), abs=1e-9)
    np.testing.assert_allclose(states.pose[:, 3:], np.broadcast_to(ROBOT.home[3:], (720, 3)))


@pytest.mark.parametrize(("mirror", "plane"), [("xz", [1, -1, 1]), ("yz", [-1, 1, 1])])
def test_a_mirror_image_is_one(mirror, plane):
    poses = [(0.05, 0.02, -0.6, 0.1, 0.05, 0.3), (-0.05, 0.06, -0.7, -0.1, 0.1, -0.2)]
    plain = benchmark_motion(ValidationMotion(motion="line", poses=poses), ROBOT.home, 1e-3)
    image = benchmark_motion(
        ValidationMotion(motion="line", poses=poses, mirror=mirror), ROBOT.home, 1e-3
    )
    flip = np.diag(np.array(plane, dtype=float))
    times = plain.sample_times(7)
    for one, other in zip(plain.sample(times).pose, image.sample(times).pose, strict=True):
        np.testing.assert_allclose(other[:3], flip @ one[:3])
        np.testing.assert_allclose(rotation(other[3:]), flip @ rotation(one[3:]) @ flip, atol=1e-12)


def rotation(angles):
    import casadi as ca

    from expdesign.mechanism.strut import rotation_matrix

    return ca.evalf(rotation_matrix(ca.SX(angles))).full()


def test_a_line_touches_its_ends_and_keeps_its_speed():
    poses = [(0.1, 0, -0.6, 0, 0, 0), (-0.1, 0, -0.6, 0, 0, 0)]
    line = benchmark_motion(
        ValidationMotion(motion="line", poses=poses, speed=0.4), ROBOT.home, 1e-3
    )
    states = line.sample(line.sample_times(1000))
    assert states.pose[:, 0].max() == pytest.approx(0.1)
    assert states.pose[:, 0].min() == pytest.approx(-0.1)
    assert np.abs(states.rate[:, 0]).max() == pytest.approx(0.4, rel=1e-2)


def test_a_spline_passes_its_poses():
    rng = np.random.default_rng(0)
    poses = [tuple(ROBOT.home + rng.uniform(-0.08, 0.08, 6)) for _ in range(6)]
    spline = benchmark_motion(ValidationMotion(motion="spline", poses=poses), ROBOT.home, 1e-3)
    states = spline.sample(spline.sample_times(5000)).pose
    for pose in poses:
        assert np.min(np.linalg.norm(states - pose, axis=1)) < 1e-3


@pytest.mark.parametrize(
    "motion",
    [
        {},
        {
            "noise": {"force_std": [0.5] * 6, "length_std": [1e-5] * 6},
            "motion": "line",
            "poses": [[0.1, 0, -0.6, 0, 0, 0], [-0.1, 0, -0.65, 0, 0, 0]],
            "speed": 0.4,
            "periods": 10,
        },
    ],
    ids=["circle", "line"],
)
def test_a_sound_estimate_passes(folder, motion):
    """Also on a line, at whose ends the machine rests, with little noise."""
    result = validate(case(**motion), read_estimate(folder, ROBOT))
    assert result.accepted
    test = result.predictions[0].tests.lack_of_fit
    assert not np.any(test.failed)
    assert not test.refused


def test_cogging_that_the_estimate_does_not_know_fails_its_struts(folder):
    result = validate(case(cogging=[0, 0, 40, 40, 0, 0]), read_estimate(folder, ROBOT))
    test = result.predictions[0].tests.lack_of_fit
    assert list(np.flatnonzero(test.failed) + 1) == [3, 4]
    assert not result.accepted


def test_the_measured_forces_of_a_prediction_are_those_of_the_recording(folder, tmp_path):
    """Before a filter of the sensors they would contain the noise, divided by its gain."""
    data = measured(MOTION, seed=1, periods=10)
    write_measurement(data, tmp_path / "m.csv")
    known = {"filter": {"Q": {"low_pass": "5 Hz", "order": 2}}}
    motions = [{"motion": "file", "file": str(tmp_path / "m.csv")}]
    result = validate(run(data=known, validate=motions), read_estimate(folder, ROBOT))
    mean = data.forces.reshape(10, -1, 6).mean(axis=0)
    rms = [row.rms_measured for row in result.rows]
    assert rms == pytest.approx(np.std(mean, axis=0), rel=1e-6)
    assert np.std(result.forces[0].measured, axis=0) == pytest.approx(rms)


def test_the_times_of_a_prediction_are_those_of_the_recording(folder, tmp_path):
    """Also of single samples, whose times are counted from the middle of the recording."""
    data = measured(trajectory(200.4, seed=2), seed=1, periods=6)
    write_measurement(data, tmp_path / "m.csv")
    motions = [{"motion": "file", "file": str(tmp_path / "m.csv")}]
    (found,) = validate(run(validate=motions), read_estimate(folder, ROBOT)).forces
    assert len(found.time) > 5 * 200
    np.testing.assert_allclose(found.time, data.time[: len(found.time)], rtol=0, atol=1e-9)


def test_a_motion_without_a_period_is_predicted_and_read_again(folder, tmp_path):
    """No second period shows its noise, and with it which errors the test would find."""
    data = measured(trajectory(320, harmonics=3), seed=3, periods=0.7)
    write_measurement(data, tmp_path / "m.csv")
    motions = [{"motion": "file", "file": str(tmp_path / "m.csv"), "tolerance": "60 N"}]
    result = validate(run(validate=motions), read_estimate(folder, ROBOT))
    result.write(tmp_path)
    errors = type(result).read(tmp_path).errors
    assert errors
    for each in errors:
        assert np.isnan(each.detectable)
        assert each.error_low == 0 < each.error_high < 60
    made = RunFolder(tmp_path, {}, run(), results={ValidationResult: result})
    texts = [each.text for each in validation_view(made).blocks if isinstance(each, TextBlock)]
    assert any("with the noise, which is not known" in text for text in texts)


def test_a_wrong_mass_fails(folder):
    saved = read_estimate(folder, ROBOT)
    saved.estimate.values[9] *= 1.2
    assert not validate(case(), saved).accepted


def test_what_speaks_against_the_estimate_comes_before_causes_of_the_prediction(folder):
    against = Assumption("gains are right", "a gain is wrong", "look").fails("seen", 1e-9, 0.001)
    minor = Assumption("normal", "a tail is heavy", "", serious=False).fails("seen", 1e-9, 0.001)
    verdict = DiagnosisVerdict(Status.DOUBTFUL, "doubtful: a gain is wrong", (against, minor))
    file = replace(EstimationResult.read(folder), diagnostics=Diagnosis("ml", verdict, (), ()))
    doubtful = identified_model(file, folder, ROBOT)
    assert doubtful.doubt == "a gain is wrong"
    assert read_estimate(folder, ROBOT).doubt == ""
    run_of = case(cogging=[0, 0, 40, 40, 0, 0])
    plain, after = (validate(run_of, saved) for saved in (read_estimate(folder, ROBOT), doubtful))
    (new,) = set(after.warnings) - set(plain.warnings)
    assert "a gain is wrong" in new
    before, advised = (each.motions[0].diagnostics.verdict.failed for each in (plain, after))
    assert [each.sentence for each in before] == [each.sentence for each in advised]
    assert any(each.serious for each in before)
    for own, instead in zip(before, advised, strict=True):
        assert (own.advice != instead.advice) == own.serious
        assert ("estimate" in instead.advice) or not own.serious


def test_an_estimate_survives_its_file(folder):
    saved = read_estimate(folder, ROBOT)
    record = json.loads((folder / "estimate.json").read_text())
    assert saved.estimate.estimator == "ml"
    assert saved.estimate.values[9] == record["estimators"]["ml"]["values"]["p10"]
    assert np.all(np.linalg.eigvalsh(saved.estimate.covariance) > 0)


@pytest.mark.parametrize("content", [None, "{", "{}", '{"parameters": ["p1"]}', "[1]"])
def test_what_is_no_estimate_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "estimate.json").write_text(content)
    with pytest.raises(InputError, match=r"estimate\.json"):
        read_estimate(tmp_path, ROBOT)


def test_a_run_without_motions_is_refused(folder):
    with pytest.raises(InputError, match="names no motion"):
        validate(run(), read_estimate(folder, ROBOT))


def test_an_estimate_of_another_robot_is_refused(folder, tmp_path):
    record = json.loads((folder / "estimate.json").read_text())
    record["robot"] = "rubin"
    (tmp_path / "estimate.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="of the robot 'rubin', not of 'palida'"):
        read_estimate(tmp_path, ROBOT)


def test_a_pointwise_estimate_warns(tmp_path):
    config = run({"estimators": ["gm"], "differentiation": "central"})
    estimation_result(estimate_parameters(config, measured(MOTION), MOTION)).write(tmp_path)
    warnings = validate(case(), read_estimate(tmp_path, ROBOT)).warnings
    assert any("pointwise differentiation" in warning for warning in warnings)
