import json

import numpy as np
import pandas as pd
import pytest

from expdesign.configuration import load_run, resolved_yaml
from tests.estimation.cases import ROBOT, measured, trajectory

MOTION = trajectory()
SIGMA = ROBOT.description.noise.force_covariance


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "run.yaml").write_text("name: lab\nrobot: palida\n")
    return tmp_path


def write(folder, samples=200, **options):
    data = measured(trajectory(samples), **options)
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
    assert "no outliers: fails" in output
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
