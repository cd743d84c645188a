"""A term that the robot file lacks, from the run file to the report and the validation."""

import csv
import json

import pytest

from estimation.identification.result import EstimationResult
from expdesign.configuration.robot import load_robot_description
from expdesign.trajectory import fourier_keys
from tests.estimation.cases import trajectory


@pytest.fixture
def run_file(tmp_path):
    """Return a run file whose machine has drives with inertia, in a folder with a design."""
    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    machine = robot | {
        "terms": [*robot["terms"], "drive_inertia"],
        "parameters": robot["parameters"] | {"m_drive": 3.0},
    }
    (tmp_path / "machine.yaml").write_text(json.dumps(machine), encoding="utf-8")
    run = {
        "name": "n",
        "robot": "palida",
        "experiment": {"sampling": 200, "periods": 6, "truth": "machine.yaml"},
        "estimate": {
            "estimators": ["gm"],
            "harmonics": 2,
            "select": {"candidates": ["force_offset", "drive_inertia"]},
        },
        "validate": [{"motion": "circle", "radius": 0.1, "speed": 0.5}],
        "report": {},
        "workers": 1,
    }
    (tmp_path / "run.yaml").write_text(json.dumps(run), encoding="utf-8")
    (tmp_path / "out").mkdir()
    design = json.dumps(fourier_keys(trajectory()), default=lambda value: value.tolist())
    (tmp_path / "design.json").write_text(design, encoding="utf-8")
    return tmp_path / "run.yaml"


@pytest.mark.slow
def test_it_is_added_estimated_predicted_with_and_told(expdesign, run_file):
    design, out = run_file.parent / "design.json", run_file.parent / "out"
    options = ("--design", design, "--out", out)
    status, _, messages = expdesign("simulate", run_file, *options)
    assert status == 0, messages
    status, _, messages = expdesign(
        "estimate", run_file, "--data", out / "measurement.csv", *options
    )
    assert status == 0, messages
    assert "drive_inertia" in messages
    record = EstimationResult.read(out)
    assert record.selection.chosen == ("drive_inertia",)
    text = (out / "tables/selection.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["term"] for row in rows if row["chosen"] == "True"] == ["drive_inertia"]
    assert len(record.selection.steps) == len(rows)
    assert "m_drive" in record.parameters
    # The robot that was found has the term; so has who predicts with the estimate.
    assert "drive_inertia" in (out / "identified-robot.yaml").read_text(encoding="utf-8")
    status, output, messages = expdesign("validate", run_file, "--estimate", out, "--out", out)
    assert status == 0, messages
    assert output.count("passes") == 6
    status, _, messages = expdesign("report", out)
    assert status == 0, messages
    page = (out / "report.html").read_text(encoding="utf-8")
    assert record.selection.caveat.split(".")[0] in page
    again = run_file.parent / "again.yaml"
    again.write_text("name: again\nrobot: out/identified-robot.yaml\n", encoding="utf-8")
    status, output, messages = expdesign("check", again)
    assert status == 0, messages
    assert "drive_inertia" in output
