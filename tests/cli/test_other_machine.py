"""A simulated machine that is not the run's robot, from the run file to the report."""

import json
import re

import pytest

from estimation.twin.truth import Truth
from expdesign.configuration.robot import load_robot_description
from expdesign.trajectory import fourier_keys
from tests.report.html import Page
from tests.twin.examples import motion

HEAVY = 17.25


@pytest.fixture
def run_file(tmp_path):
    """Return a run file whose twin is another machine, and the folder of a design."""
    robot = load_robot_description("palida").description.model_dump(mode="json", exclude_none=True)
    terms = [*robot["terms"], "force_offset"]
    parameters = robot["parameters"] | {"p10": HEAVY, "o1": 40.0}
    joints = [[x + 1e-3 * (j == 0), y, z] for j, (x, y, z) in enumerate(robot["platform_joints"])]
    other = robot | {"name": "other-one", "terms": terms, "parameters": parameters}
    other["platform_joints"] = joints
    (tmp_path / "other.yaml").write_text(json.dumps(other), encoding="utf-8")
    experiment = {"sampling": 50, "periods": 3, "truth": "other.yaml", "delay": "1 ms"}
    run = {"name": "n", "robot": "palida", "experiment": experiment, "workers": 1}
    run["noise"] = {"force_spectrum": {"ar": 0.3}}
    (tmp_path / "run.yaml").write_text(json.dumps(run), encoding="utf-8")
    design = tmp_path / "design"
    design.mkdir()
    (design / "design.json").write_text(
        json.dumps(fourier_keys(motion()), default=lambda value: value.tolist()), encoding="utf-8"
    )
    return tmp_path / "run.yaml", design


def test_it_is_told_and_estimates_are_compared_with_it(expdesign, run_file, tmp_path):
    file, design = run_file
    out = tmp_path / "out"
    status, output, messages = expdesign("simulate", file, "--design", design, "--out", out)
    assert status == 0, messages
    assert "other-one" in output
    assert "memory in the forces (autoregressive)" in output
    assert messages.count("experiment.truth") == 1  # its platform is not symmetric
    truth = Truth.read(out)
    assert (truth.robot, truth.machine.name) == ("palida", "other-one")
    assert truth.parameters["o1"] == 40.0
    data = out / "measurement.csv"
    options = ("--data", data, "--design", design, "--out", out)
    status, _, messages = expdesign("estimate", file, *options)
    assert status == 0, messages
    assert "experiment.truth" not in messages
    rows = (out / "estimates.csv").read_text(encoding="utf-8")
    assert "p10" in rows
    assert "o1" not in rows
    status, _, messages = expdesign("report", out)
    assert status == 0, messages
    page = Page((out / "report.html").read_text(encoding="utf-8")).text
    assert re.search(r"\bother-one\b", page)
    assert re.search(rf"\b{HEAVY}\b", page)
