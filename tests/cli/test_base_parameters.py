"""A machine with a term that says nothing new, through the command line."""

import csv
import json

import pytest

from tests.payload import described

STRIBECK = {"stribeck": {"velocity": 1e9}}
GONE = [f"s{j}" for j in range(1, 7)]
SHOWN = [f"r{j} + s{j}" for j in range(1, 7)]


@pytest.fixture
def run(tiny, tmp_path):
    """Write a run of the machine."""

    def write(**sections):
        design = {"starts": 1, "search": "restarts", "max_iterations": 4}
        design |= sections.pop("design", {})
        mapping = tiny(robot=described("palida", STRIBECK), design=design, **sections)
        path = tmp_path / "run.yaml"
        path.write_text(json.dumps(mapping), encoding="utf-8")
        return path

    return write


def _rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_check_names_what_no_motion_tells_apart(expdesign, run, tmp_path):
    path, out = run(), tmp_path / "out"
    status, said, messages = expdesign("check", path, "--machine", "--out", out)
    assert status == 0
    assert "24 of 30 parameters" in said
    (warning,) = [line for line in messages.splitlines() if "parameters: base" in line]
    for text in (*GONE, *SHOWN):
        assert text in warning
    status, said, _ = expdesign("check", path, "--machine", "--out", out, "--json")
    data = json.loads(said)
    assert data["machine"]["base_parameters"]["r1"] == pytest.approx({"s1": 1.0})
    assert data["machine"]["base_parameters"]["p1"] == {}
    assert any("parameters: base" in warning for warning in data["warnings"])


def test_check_names_what_noise_hides(expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("name: slow\nrobot: rubin\n", encoding="utf-8")
    status, said, messages = expdesign("check", path, "--machine", "--out", tmp_path / "out")
    assert status == 0
    assert "identify all 24 parameters" in said
    (warning,) = [line for line in messages.splitlines() if "no motion within" in line]
    assert "p1 (" in warning
    assert "p10 (" not in warning


def test_a_design_for_all_is_refused_before_it_searches(expdesign, run, tmp_path):
    status, said, _ = expdesign("design", run(), "--out", tmp_path / "out", "--json")
    data = json.loads(said)
    assert (status, data["status"]) == (1, 1)
    assert data["unexcited"] == GONE
    assert data["shows"] == SHOWN
    assert "design.parameters: base" in data["message"]


@pytest.mark.slow
@pytest.mark.usefixtures("cheap_finish")
def test_from_a_design_for_what_shows_to_the_report(expdesign, run, tmp_path):
    estimate = {"parameters": "base", "estimators": ["gm"]}
    path, out = run(design={"parameters": "base"}, estimate=estimate), tmp_path / "out"
    for stage in ("design", "simulate", "estimate"):
        status, said, messages = expdesign(stage, path, "--out", out)
        assert status == 0, messages
    for text in SHOWN:
        assert text in said
    design = json.loads((out / "design.json").read_text(encoding="utf-8"))
    assert not set(GONE) & set(design["parameters"])
    assert len(design["parameters"]) == 24
    predicted = {row["parameter"]: row for row in _rows(out / "tables/design_combinations.csv")}
    found = {row["parameter"]: row for row in _rows(out / "tables/estimate_combinations.csv")}
    for name, gone in zip(("r1", "r2"), GONE[:2], strict=False):
        for rows in (predicted, found):
            if name in rows:
                assert gone in rows[name]["regrouped"].split(", ")
                assert rows[name]["std_alone"] == ""
    assert {"p10", "v1"} & set(predicted)
    robot = (out / "identified-robot.yaml").read_text(encoding="utf-8")
    assert "stribeck" in robot
    status, _, messages = expdesign("report", out)
    assert status == 0, messages
    page = (out / "report.html").read_text(encoding="utf-8")
    for key in ("design_combinations", "estimate_combinations"):
        assert f'id="table-{key}"' in page


@pytest.mark.parametrize(
    ("section", "allowed"),
    [({"design": {"parameters": "bass"}}, "base"), ({"estimate": {"parameters": "bass"}}, "base")],
)
def test_words_that_are_none(expdesign, run, section, allowed):
    status, _, messages = expdesign("check", run(**section))
    assert status == 2
    assert allowed in messages.split("allowed:")[1]
