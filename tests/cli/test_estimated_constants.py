"""New terms, and a pitch that is estimated, from the design to the report."""

import csv
import json
import re

import numpy as np
import pytest

from expdesign.configuration.robot import load_robot_description

QUICK = {"starts": 1, "search": "restarts", "max_iterations": 4}
PITCH, NEAR = 0.05, 0.051
PLANTED = {"cs2": 20.0, "cc2": -12.0, "cs5": 15.0, "a1": 8.0, "a4": -9.0, "b_force": 40.0}


def _terms(pitch):
    """Return the default terms with others; what friction has is an offset, too."""
    places = {"base_x": 0.1, "base_y": 0.2, "base_z": -1.4, "length": 0.75}
    more = ["force_offset", "asymmetric_friction", {"cogging": {"pitch": pitch}}]
    return [*more, {"gravity_compensation": places}]


@pytest.fixture
def runs(tiny, tmp_path):
    """Return the run file of a machine, and that of a user who knows it roughly."""
    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    files = []
    for name, pitch, values in (
        ("machine", PITCH, PLANTED),
        ("user", {"value": f"{1e3 * NEAR} mm", "estimate": True}, {}),
    ):
        terms = {"terms": [*robot["terms"], *_terms(pitch)]}
        described = robot | terms | {"parameters": robot["parameters"] | values}
        mapping = tiny(name=name, robot=described, design=QUICK)
        file = tmp_path / f"{name}.yaml"
        section = {"estimate": {"estimators": ["gm", "ml"]}}
        file.write_text(json.dumps(mapping | section), encoding="utf-8")
        files.append(file)
    return files


def _rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.usefixtures("cheap_finish")
def test_a_pitch_comes_back_with_what_it_moves(expdesign, runs, tmp_path):
    machine, user = runs
    folder, found = tmp_path / "machine", tmp_path / "estimate"
    status, out, messages = expdesign("check", user)
    assert status == 0, messages
    assert "estimate: true" in out
    assert "note: cogging.pitch is estimated from 0.051 m on, with no prior\n" in messages
    for command in (
        ("design", machine, "--out", folder),
        ("simulate", machine, "--design", folder, "--out", folder),
        (
            "estimate",
            user,
            "--data",
            folder / "measurement.csv",
            "--design",
            folder,
            "--out",
            found,
        ),
        ("report", found),
    ):
        status, out, messages = expdesign(*command)
        assert status == 0, messages
        if command[0] == "estimate":
            (written,) = re.findall(r"cogging\.pitch +mm +[\d.]+ +– +([\d.]+)\(", out)
            assert 1e-3 * float(written) == pytest.approx(PITCH, abs=0.5 * (NEAR - PITCH))
    for row in _rows(found / "tables" / "constants.csv"):
        assert (row["constant"], float(row["stated"])) == ("cogging.pitch", NEAR)
        assert abs(float(row["value"]) - PITCH) < 4 * float(row["std"])
        assert float(row["std"]) < 0.5 * (NEAR - PITCH)
    off = [
        (float(row["value"]) - PLANTED.get(row["parameter"], 0.0)) / float(row["std"])
        for row in _rows(found / "estimates.csv")
        if row["parameter"] in PLANTED or row["parameter"][0] in "ao"
    ]
    assert np.max(np.abs(off)) < 5
    assert "cogging.pitch" in (found / "report.html").read_text(encoding="utf-8")

    # The robot that was found predicts, and is estimated again from where it was left.
    robot = found / "identified-robot.yaml"
    again = json.loads(user.read_text(encoding="utf-8")) | {"robot": str(robot)}
    user.write_text(json.dumps(again), encoding="utf-8")
    status, _, messages = expdesign("check", user)
    assert status == 0, messages
    assert "with a prior of ± " in messages
