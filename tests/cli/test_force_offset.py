"""A term that is none of the default ones, from the design to the report."""

import csv
import json

import numpy as np
import pytest

from expdesign.configuration.robot import load_robot_description

PLANTED = dict(zip(("o1", "o2", "o3", "o4", "o5", "o6"), (8, -5, 12, -9, 4, 6), strict=True))
QUICK = {"starts": 1, "search": "restarts", "max_iterations": 4}


@pytest.fixture
def runs(tiny, tmp_path):
    """Return the run file of a machine with offsets, and that of a user who does not know them."""
    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    robot["terms"] = [*robot["terms"], "force_offset"]
    files = []
    for name, offsets in (("machine", PLANTED), ("user", {})):
        described = robot | {"parameters": robot["parameters"] | offsets}
        study = {"repetitions": 3, "estimators": ["gm"]}
        estimate = {"estimators": ["ls", "gm", "ml"]}
        mapping = tiny(
            name=name, robot=described, design=QUICK, experiment={"periods": 10}, montecarlo=study
        )
        file = tmp_path / f"{name}.yaml"
        file.write_text(json.dumps(mapping | {"estimate": estimate}), encoding="utf-8")
        files.append(file)
    return files


def _rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.usefixtures("cheap_finish")
def test_planted_offsets_come_back(expdesign, runs, tmp_path):
    machine, user = runs
    folder = tmp_path / "machine"
    for stage in ("design", "simulate", "montecarlo"):
        design = () if stage == "design" else ("--design", folder)
        status, _, messages = expdesign(stage, machine, *design, "--out", folder)
        assert status == 0, messages
    assert "force_offset" in (folder / "run.yaml").read_text(encoding="utf-8")
    data = folder / "measurement.csv"
    found = tmp_path / "estimate"
    status, _, messages = expdesign(
        "estimate", user, "--data", data, "--design", folder, "--out", found
    )
    assert status == 0, messages

    predicted = json.loads((folder / "design.json").read_text(encoding="utf-8"))["predicted_std"]
    rows = [row for row in _rows(found / "estimates.csv") if row["parameter"] in PLANTED]
    assert len(rows) == 3 * 6
    ratios = []
    for row in rows:
        name, std = row["parameter"], float(row["std"])
        assert abs(float(row["value"]) - PLANTED[name]) < 4 * std
        assert row["unit"] == "N"
        assert float(row["a_priori"]) == 0
        assert row["identified"] == "True"
        if row["estimator"] != "ls":
            ratios.append(std / predicted["experiment"][name])
    # Ten periods show the noise's spectrum roughly: single parameters differ by chance. With three,
    # 4 of 24 recordings had an offset beyond a factor of two.
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1, rel=0.25)
    assert 0.5 < min(ratios) <= max(ratios) < 2
    values = np.array([float(row["value"]) for row in rows])
    assert np.corrcoef(values, np.tile(list(PLANTED.values()), 3))[0, 1] > 0.9

    status, _, messages = expdesign("report", found)
    assert status == 0, messages
    assert "<i>o</i><sub>6</sub>" in (found / "report.html").read_text(encoding="utf-8")
