"""What cannot be is named, with what to write: status 2 for bad input, a finding for a doubt."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml

from expdesign.library import robot_files
from tests.estimation.cases import measured, trajectory

pytestmark = pytest.mark.slow

MOTION = trajectory()
FORCES = [f"Q{j}" for j in range(1, 7)]


@pytest.fixture
def estimated(tmp_path, expdesign, monkeypatch):
    """Estimate from a recording with the section `data`: status, output, error, and the record."""
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())

    def call(change=None, **section):
        data = measured(MOTION, 0)
        table = pd.DataFrame(
            np.column_stack([data.time, data.lengths, data.forces]),
            columns=["t", *(f"q{j}" for j in range(1, 7)), *FORCES],
        )
        if change is not None:
            change(table)
        table.to_csv(tmp_path / "recording.csv", index=False)
        run = {"name": "lab", "robot": "palida", "estimate": {"estimators": ["gm"]}}
        (tmp_path / "run.yaml").write_text(yaml.safe_dump(run | {"data": section}))
        status, output, error = expdesign(
            "estimate",
            tmp_path / "run.yaml",
            "--data",
            tmp_path / "recording.csv",
            "--out",
            tmp_path / "out",
        )
        record = tmp_path / "out" / "estimate.json"
        verdict = json.loads(record.read_text())["diagnostics"]["verdict"] if not status else None
        return status, output + error, verdict

    return call


def test_a_negative_force_constant(estimated):
    """Accepted with −115 kg before: refused, with the signs that are right."""

    def currents(table):
        table[FORCES] /= 85.0

    status, said, _ = estimated(currents, units={"Q": "A"}, force_constants=-85)
    assert status == 2
    assert "Q1, Q2, Q3, Q4, Q5 and Q6 have the opposite sign" in said
    assert "Q: -1" in said


def test_force_constants_without_a_current(estimated):
    status, said, _ = estimated(force_constants=85)
    assert status == 2
    assert "data.units: {Q: A}" in said


def test_a_current_without_force_constants(estimated):
    status, said, _ = estimated(units={"Q": "A"})
    assert status == 2
    assert "force_constants" in said


@pytest.mark.parametrize("name", robot_files())
def test_robots_that_ship_have_gravity_downwards(name, expdesign, tmp_path):
    """PaLiDA hangs, and is not warned of; with gravity the other way every one is."""
    robot = yaml.safe_load(robot_files()[name].read_text())
    for sign, warned in ((-1, False), (1, True)):
        robot["gravity"] = [0, 0, sign * 9.81]
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
        (tmp_path / "run.yaml").write_text("name: lab\nrobot: robot.yaml\n")
        status, output, error = expdesign("check", tmp_path / "run.yaml")
        assert status == 0
        assert ("gravity points along +z" in " ".join((output + error).split())) == warned


def test_check_warns_of_sliders_that_lie_beyond_their_joint(expdesign, tmp_path):
    robot = yaml.safe_load(robot_files()["linuxcnc"].read_text())
    robot["parameters"]["p5"] = 0.55
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    (tmp_path / "run.yaml").write_text("name: lab\nrobot: robot.yaml\n")
    status, output, error = expdesign("check", tmp_path / "run.yaml")
    assert status == 0
    assert "p5 = 0.55 is above 0" in " ".join((output + error).split())
