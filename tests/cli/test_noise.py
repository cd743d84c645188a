import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.trajectory import FourierTrajectory
from tests.docs.pages import parse
from tests.estimation.cases import ROBOT, measured, trajectory

MOTION = trajectory()
SIGMA = ROBOT.description.noise.force_covariance
DELTA = ROBOT.description.noise.length_covariance
STILL = FourierTrajectory(2 * np.pi, ROBOT.home, np.zeros((6, 1)), np.zeros((6, 1)))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "run.yaml").write_text("name: lab\nrobot: palida\n")
    return tmp_path


def write(folder, samples=200, **options):
    write_data(folder, measured(trajectory(samples), **options))


def write_data(folder, data):
    table = pd.DataFrame(
        np.column_stack([data.time, data.lengths, data.forces]),
        columns=["t", *(f"q{j}" for j in range(1, 7)), *(f"Q{j}" for j in range(1, 7))],
    )
    table.to_csv(folder / "recording.csv", index=False)


def arguments(folder, *more):
    return [
        "noise",
        folder / "run.yaml",
        "--data",
        folder / "recording.csv",
        "--out",
        folder / "out",
        *more,
    ]


@pytest.mark.parametrize("samples", [200, 200.4])
def test_the_noise_of_a_recording(folder, expdesign, samples):
    write(folder, samples, periods=8)
    status, output, error = expdesign(*arguments(folder, "--json"))
    assert status == 0, error
    found = json.loads(output)
    ratio = np.diag(found["force_covariance"]) / np.diag(SIGMA)
    assert np.all(np.abs(ratio - 1) < 0.2)
    assert {f["outcome"] for f in found["findings"]} <= {"holds", "not tested"}
    record = json.loads((folder / "out" / "noise.json").read_text())
    assert record["force_std"] == found["force_std"]
    table = pd.read_csv(folder / "out" / "tables" / "noise_covariance.csv")
    assert len(table) == 72
    names = {path.stem for path in (folder / "out" / "figures").iterdir()}
    assert names == {
        "noise_distribution",
        "noise_quantiles",
        "noise_covariance",
        "noise_spectrum",
    }


def test_outliers_are_found(folder, expdesign):
    write(folder, periods=8)
    table = pd.read_csv(folder / "recording.csv")
    table.loc[::37, "Q2"] += 400
    table.to_csv(folder / "recording.csv", index=False)
    status, output, _ = expdesign(*arguments(folder))
    assert status == 0
    assert "outliers" in output
    assert "no outliers: holds" not in output
    assert "force 2" in output


def test_one_period_has_no_scatter(folder, expdesign):
    write(folder, periods=1)
    (folder / "run.yaml").write_text(
        "name: lab\nrobot: palida\ntrajectory: {frequency: [1 Hz, 1 Hz], controller_period: 5 ms}\n"
    )
    status, _, error = expdesign(*arguments(folder))
    assert status == 2
    assert "two periods or more" in error
    assert not (folder / "out").exists()


def test_it_is_a_stage_of_the_run_folder(folder, expdesign):
    write(folder, periods=8)
    (folder / "run.yaml").write_text("name: lab\nrobot: palida\nreport: {figures: [svg]}\n")
    status, _, error = expdesign(*arguments(folder))
    assert status == 0, error
    out = folder / "out"
    stage = json.loads((out / "manifest.json").read_text())["stages"]["noise"]
    assert stage["status"] == "done"
    assert {"noise.json", "tables/noise_covariance.csv", "columns.json"} <= set(stage["files"])
    assert {path.suffix for path in (out / "figures").iterdir()} == {".svg"}
    assert all((out / file).is_file() for file in stage["files"])
    status, _, error = expdesign("report", out)
    assert status == 0, error
    assert 'id="noise"' in (out / "report.html").read_text(encoding="utf-8")


def test_its_configuration_is_that_of_the_folder(folder, expdesign):
    write(folder, periods=8)
    for formats in ("[svg]", "[svg, pdf]"):
        (folder / "run.yaml").write_text(
            f"name: lab\nrobot: palida\nreport: {{figures: {formats}}}\n"
        )
        assert expdesign(*arguments(folder))[0] == 0
        text = (folder / "out" / "run.yaml").read_text(encoding="utf-8")
        assert text == resolved_yaml(load_run(folder / "run.yaml"))


def lines_of(folder):
    """Return the noise of the lines that were written, pasted into a robot file."""
    block = parse((folder / "out" / "noise.yaml").read_text(encoding="utf-8"))
    robot = load_run({"name": "n", "robot": "palida"}).run.robot.model_dump(exclude={"noise"})
    return load_run({"name": "n", "robot": robot | block}).robot.noise


def alike(found, expected, samples):
    """Assert that an estimated covariance is the true one within 5 standard errors."""
    size = np.diag(expected)
    error = np.sqrt((expected**2 + np.multiply.outer(size, size)) / samples)
    assert np.all(np.abs(found - expected) < 5 * error)


@pytest.mark.parametrize("moving", [False, True])
def test_the_first_noise_is_pasted_into_the_robot_file(folder, expdesign, moving):
    """No design is known: the machine rests, or makes any motion that repeats."""
    motion = trajectory() if moving else STILL
    write_data(folder, measured(motion, periods=12))
    status, output, error = expdesign(*arguments(folder))
    assert status == 0, error
    block = (folder / "out" / "noise.yaml").read_text(encoding="utf-8")
    assert block in output
    record = json.loads((folder / "out" / "noise.json").read_text())
    assert record["at_rest"] is not moving
    alike(np.array(record["force_covariance"]), SIGMA, record["force_freedom"])
    found = lines_of(folder)
    for made, exact in (
        (found.force_covariance, record["force_covariance"]),
        (found.length_covariance, record["length_covariance"]),
    ):
        size = np.sqrt(np.diag(exact))
        np.testing.assert_allclose(made, exact, rtol=0, atol=2e-3 * np.outer(size, size).max())
    manifest = json.loads((folder / "out" / "manifest.json").read_text())
    assert "noise.yaml" in manifest["stages"]["noise"]["files"]


def test_lengths_that_only_show_their_resolution(folder, expdesign):
    data = measured(STILL, periods=10, length_scale=0.0)
    data.lengths[::7, 2] += 1e-6
    write_data(folder, data)
    status, output, error = expdesign(*arguments(folder))
    assert status == 0, error
    assert "(actuators 1, 2, 4, 5, 6)" in output
    found = lines_of(folder)
    assert found.length_covariance is None
    alike(found.force_covariance, SIGMA, 1500)
    status, _, error = expdesign("report", folder / "out")
    assert status == 0, error
    assert "of the machine at rest" in (folder / "out" / "report.html").read_text(encoding="utf-8")


def test_no_correlation_without_one(folder, expdesign):
    data = measured(STILL, periods=12)
    drawn = np.random.default_rng(3).normal(size=(2, len(data), 6))
    still = data.lengths.mean(axis=0)
    write_data(folder, replace(data, forces=3 * drawn[0], lengths=still + 1e-5 * drawn[1]))
    assert expdesign(*arguments(folder))[0] == 0
    found = lines_of(folder)
    assert np.count_nonzero(found.force_covariance) == 6
    assert np.sqrt(np.diag(found.force_covariance)) == pytest.approx([3.0] * 6, rel=0.1)
    assert np.sqrt(np.diag(found.length_covariance)) == pytest.approx([1e-5] * 6, rel=0.1)


def test_another_motion_than_the_one_of_the_folder(folder, expdesign):
    """What was designed is no error where the noise is asked for; a design that is named is."""
    motion = trajectory(200)
    (folder / "out").mkdir()
    keys = {"omega": 2 * np.pi / 1.7, "harmonics": 2, "lambda0": ROBOT.home.tolist()}
    series = {"mu": motion.mu.tolist(), "nu": motion.nu.tolist()}
    (folder / "out" / "design.json").write_text(json.dumps(keys | series))
    for made in (motion, STILL):
        write_data(folder, measured(made, periods=8))
        status, output, error = expdesign(*arguments(folder, "--json"))
        assert status == 0, error
        found = json.loads(output)
        assert found["at_rest"] is (made is STILL)
        if made is motion:
            assert found["period"] == pytest.approx(1.0, rel=1e-5)
    write_data(folder, measured(motion, periods=8))
    named = arguments(folder, "--design", folder / "out")
    status, _, error = expdesign(*named)
    assert status == 2
    assert "do not repeat" in error


def test_what_shows_no_noise(folder, expdesign):
    data = measured(STILL, periods=4)
    ramp = data.lengths + 0.05 * np.sin(data.time)[:, None] + 0.03 * data.time[:, None] ** 2
    write_data(folder, replace(data, lengths=ramp))
    status, _, error = expdesign(*arguments(folder))
    assert status == 2
    assert "not at rest" in error
    dead = data.forces.copy()
    dead[:, 4] = 0.0
    write_data(folder, replace(data, forces=dead))
    status, _, error = expdesign(*arguments(folder))
    assert status == 2
    assert "forces do not change at all (actuator 5)" in error


def test_channels_without_noise_of_their_own(folder, expdesign):
    """A column that is named twice, also with another force constant, and a sum of others."""
    data = measured(STILL, periods=10)
    copied, summed = data.forces.copy(), data.forces.copy()
    copied[:, 5] = 3 - 2 * copied[:, 1]
    summed[:, 5] = summed[:, 1] + summed[:, 2]
    for forces, expected, where in ((copied, 2, "2 and 6"), (summed, 1, "")):
        write_data(folder, replace(data, forces=forces))
        status, _, error = expdesign(*arguments(folder))
        assert status == expected, error
        assert where in error


def test_check_says_how_to_come_to_it(folder, expdesign):
    robot = parse(resolved_yaml(load_run({"name": "n", "robot": "palida"})))["robot"]
    del robot["noise"]
    (folder / "robot.yaml").write_text(json.dumps(robot))
    (folder / "run.yaml").write_text("name: lab\nrobot: robot.yaml\n")
    status, output, _ = expdesign("check", folder / "run.yaml", "--json")
    assert status == 0
    (warning,) = (w for w in json.loads(output)["warnings"] if "force_std" in w)
    assert "expdesign noise" in warning
    (folder / "run.yaml").write_text("name: lab\nrobot: palida\n")
    _, output, _ = expdesign("check", folder / "run.yaml", "--json")
    assert not any("force_std" in w for w in json.loads(output)["warnings"])
