"""`expdesign model`: from a run folder with an estimate to files for a controller."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML

from estimation.controlmodel.formats import ControlModelFile
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.result import EstimateFile
from estimation.uncertainty.forces import force_limit_in_words, worst_force
from expdesign.cli.app import app
from expdesign.cli.app import run as command_line
from expdesign.configuration import resolved_yaml
from expdesign.robot import load_robot
from expdesign.runfolder.manifest import Manifest, StageEntry, file_hash
from tests.estimation import constants
from tests.estimation.cases import measured, run, trajectory

FILES = {
    "c": {".c", ".h", "_vectors.h", "_selftest.c", "Makefile"},
    "python": {".py"},
    "simulink": {".c", ".h", "_vectors.h", "_selftest.c", "_sfun.c", "build_palida_model.m"},
}
BESIDE = {"test_vectors.csv", "uncertainty.csv", "columns.json", "model.json"}


@pytest.fixture(scope="module")
def estimated(made_once):
    """Return a run folder with an estimate, as the stage leaves it."""

    def make(place):
        folder, motion = place / "run", trajectory(100, 0.01)
        configuration = run({"harmonics": 2, "estimators": ["gm", "ml"]})
        result = estimate_parameters(configuration, measured(motion, 1, step=0.01), motion)
        files = estimation_result(result).write(folder)
        (folder / "run.yaml").write_text(resolved_yaml(configuration), encoding="utf-8")
        hashes = {str(f.relative_to(folder)): file_hash(f) for f in files if f.is_file()}
        entry = StageEntry("done", "", 1.0, "2026-01-02T03:04:05+00:00", files=hashes)
        Manifest.new({}, "").with_stage("estimate", entry).write(folder)

    return made_once("control-model", make) / "run"


@pytest.fixture
def folder(estimated, tmp_path):
    shutil.copytree(estimated, tmp_path / "run")
    return tmp_path / "run"


@pytest.mark.parametrize("name", FILES)
def test_the_files_say_where_their_numbers_come_from(expdesign, folder, name, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    status, out, err = expdesign("model", folder, "--format", name, "--json")
    assert status == 0, err
    place = folder / "model" / name
    named = {f if f[0].isalpha() else f"palida_model{f}" for f in FILES[name]}
    assert {path.name for path in place.iterdir()} == named | BESIDE
    record = ControlModelFile.read(place)
    assert json.loads(out)["origin"]["run"] == record.origin.run == "case"
    identified = folder / "identified-robot.yaml"
    assert record.origin.sha256 == file_hash(identified)
    assert record.origin.made == "2026-01-02T03:04:05+00:00"
    assert record.origin.verdict == "not judged"
    assert "not judged" in err
    for file, digest in record.files.items():
        assert file_hash(place / file) == digest
    assert bool(record.untested) == (name != "python")
    head = next(place.glob("palida_model.[hp]*")).read_text(encoding="utf-8")[:3000]
    for text in (record.origin.sha256, "estimator ml", "rms", *(f"actuator {j}" for j in (1, 6))):
        assert text in head


def test_the_uncertainty_is_stated_along_the_design_else_along_the_recording(expdesign, folder):
    expdesign("model", folder, "--format", "python")
    before = ControlModelFile.read(folder / "model/python")
    assert "recording" in before.motion
    motion = trajectory(100, 0.01, seed=9)
    keys = {"harmonics": motion.harmonics, "omega": motion.omega}
    keys |= {key: getattr(motion, key).tolist() for key in ("lambda0", "mu", "nu")}
    (folder / "design.json").write_text(json.dumps(keys), encoding="utf-8")
    expdesign("model", folder, "--format", "python")
    after = ControlModelFile.read(folder / "model/python")
    assert "design" in after.motion
    assert len(after.uncertainty) == 6
    table = pd.read_csv(folder / "model/python/uncertainty.csv")
    robot = load_robot(folder / "identified-robot.yaml")
    forces = robot.actuator_forces(*_at(motion, table["t"].to_numpy()))
    np.testing.assert_allclose(table[[f"Q{j}" for j in range(1, 7)]], forces, atol=1e-9)
    for one in after.uncertainty:
        std = table[f"Q{one.actuator}_std"]
        assert one.largest == pytest.approx(std.max())
        assert one.largest > one.rms > 0


def _at(motion, times):
    samples = motion.sample(times)
    return samples.pose, samples.rate, samples.acceleration


def test_forces_of_the_identified_robot_are_compared_with_its_limit(expdesign, folder):
    rows = EstimateFile.read(folder).forces
    assert [row.actuator for row in rows] == list(range(1, 7))
    for row in rows:
        assert abs(row.bound) == 230
        assert row.excess == pytest.approx(abs(row.force) - 230)
        assert row.excess < row.likely_excess < 0
    assert "kept, also with 2 σ" in force_limit_in_words(worst_force(rows))
    robot = YAML().load(folder / "identified-robot.yaml")
    for share, broken in ((1.01, False), (0.9, True)):
        robot["limits"]["actuator_force"] = share * max(row.largest_force for row in rows)
        YAML().dump(robot, folder / "identified-robot.yaml")
        status, _, err = expdesign("model", folder, "--format", "python")
        assert status == 0
        assert ("the identified machine exceeds its force limit" in err) == broken
        assert ("expdesign certify DIR --robot" in err) == broken
        found = ControlModelFile.read(folder / "model/python").uncertainty
        assert (max(row.excess for row in found) > 0) == broken


def test_the_module_of_a_folder_tests_itself_and_predicts_as_the_identified_robot(
    expdesign, folder
):
    place = folder.parent / "elsewhere"
    status, _, _ = expdesign("model", folder, "--format", "python", "--out", place)
    assert status == 0
    assert not (folder / "model").exists()
    program = [sys.executable, "palida_model.py"]
    done = subprocess.run(program, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    robot = load_robot(folder / "identified-robot.yaml")
    table = pd.read_csv(place / "test_vectors.csv")
    axes = ("x", "y", "z", "phi", "theta", "psi")
    states = [table[[d + axis for axis in axes]].to_numpy() for d in ("", "d", "dd")]
    forces = table[[f"Q{j}" for j in range(1, 7)]].to_numpy()
    np.testing.assert_allclose(robot.actuator_forces(*states), forces, atol=1e-9)
    # It fails when a number is another one.
    text = (place / "palida_model.py").read_text(encoding="utf-8")
    mass = repr(float(robot.parameters[robot.parameter_names.index("p10")]))
    assert text.count(mass) == 1
    (place / "palida_model.py").write_text(text.replace(mass, "12.5"), encoding="utf-8")
    done = subprocess.run(program, cwd=place, capture_output=True, check=False)
    assert done.returncode == 1


@pytest.mark.system("cc")
def test_a_compiler_builds_tests_and_times_the_code(expdesign, folder):
    status, out, _ = expdesign("model", folder, "--format", "c", "--smoothing", "2 mm/s", "--json")
    assert status == 0
    found = json.loads(out)
    assert found["sign_width"] == 0.002
    for test, allowed in zip(found["tests"], (1e-9, 2.3e-3), strict=True):
        assert test["deviation"] <= allowed
        assert 0 < test["median"] <= test["most"] <= test["worst"]


def test_a_robot_without_an_estimate_says_so(expdesign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = expdesign("model", "palida", "--format", "python", "--json")
    assert status == 0
    assert "nominal" in err
    found = json.loads(out)
    assert (found["origin"]["run"], found["uncertainty"]) == ("", [])
    assert (tmp_path / "runs/palida/model/python/palida_model.py").is_file()


def test_a_folder_does_not_hide_a_robot_that_ships_silently(expdesign, folder, monkeypatch):
    monkeypatch.chdir(folder.parent)
    (folder.parent / "palida").mkdir()
    for used, named in (("robot", False), ("folder", True)):
        status, out, err = expdesign("model", "palida", "--format", "python", "--json")
        assert status == 0, err
        assert bool(json.loads(out)["origin"]["run"]) == named
        assert f"the {used} palida is used" in err
        shutil.copytree(folder, folder.parent / "palida", dirs_exist_ok=True)


def test_a_robot_file_that_was_changed_since_is_told(expdesign, folder):
    path = folder / "identified-robot.yaml"
    path.write_text(path.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
    status, _, err = expdesign("model", folder, "--format", "python")
    assert status == 0
    assert "changed" in err


@pytest.mark.slow
def test_an_earlier_estimate_of_constants_says_what_it_lacks(expdesign, tmp_path):
    """Of the very same robot file, without the rows of the constants."""
    result = estimate_parameters(constants.run(), constants.data(1), constants.MOTION)
    estimation_result(result).write(tmp_path)
    path, yaml, stated = tmp_path / "identified-robot.yaml", YAML(), []
    for old in (False, True):
        if old:
            data = yaml.load(path)
            known = data["identification"]
            assert list(known.pop("constants")) == ["cogging_pitch", "stribeck_velocity"]
            count = len(known["parameters"])
            for key in ("covariance_random", "covariance_systematic"):
                known[key] = [row[:count] for row in known[key][:count]]
            yaml.dump(data, path)
        status, _, err = expdesign("model", tmp_path, "--format", "python")
        assert status == 0
        assert ("identification.constants" in err) == old
        stated.append(ControlModelFile.read(tmp_path / "model/python").uncertainty)
    for now, before in zip(*stated, strict=True):
        assert before.rms > 1.1 * now.rms


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--format", "java"], "--format"),
        ([], "--format"),
        (["--format", "c", "--smoothing", "-1"], "--smoothing"),
        (["--format", "c", "--smoothing", "3 kg"], "--smoothing"),
    ],
)
def test_bad_options_are_refused(expdesign, folder, arguments, named):
    status, _, err = expdesign("model", folder, *arguments)
    assert status == 2
    assert named in err
    assert not (folder / "model").exists()


def test_a_folder_without_an_estimate_is_refused(expdesign, folder):
    (folder / "identified-robot.yaml").unlink()
    status, _, err = expdesign("model", folder, "--format", "c")
    assert status == 2
    assert "identified-robot.yaml" in err


def test_no_fmu_without_a_compiler(expdesign, folder, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    status, _, err = expdesign("model", folder, "--format", "fmu")
    assert status == 1
    assert "compiler" in err
    assert not list(folder.glob("model/fmu/*"))


def test_the_report_has_a_section_of_the_models(folder):
    for name in ("python", "c"):
        assert command_line(app, ["model", str(folder), "--format", name, "--json"]) == 0
    assert command_line(app, ["report", str(folder), "--json"]) == 0
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert 'id="model"' in text
    assert "model/python" in text


@pytest.mark.parametrize(("off", "kind"), [(0.0, ""), (0.02, "note: "), (0.07, "warning: ")])
def test_forces_in_true_newtons_are_told(expdesign, folder, off, kind):
    """Where the estimate has found force constants off, as the robot file says."""
    path = folder / "identified-robot.yaml"
    robot = YAML().load(path)
    known = robot["identification"]
    known["deviations"] = [
        {"name": "force_constant_2", "tolerance": 0.03, "value": off, "std": 0.01}
    ]
    known["response"] = [[0.0] for _ in known["parameters"]]
    YAML().dump(robot, path)
    status, _, err = expdesign("model", folder, "--format", "python")
    assert status == 0, err
    assert ("true newtons" in err) == (off != 0)
    assert (f"{100 * off:+.2g} %" in err) == (off != 0)
    assert f"{kind}the estimate has corrected the force constants" in err or off == 0


@pytest.mark.parametrize("name", ["c", "python"])
@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"p1": -0.2}, "no machine has these parameters (p1 = -0.2"),
        ({"r3": -2.0, "p8": -1.0}, "(p8 = -1 "),
        ({}, ""),
    ],
)
def test_impossible_parameters_and_those_not_identified_are_named(
    expdesign, folder, monkeypatch, name, change, found
):
    monkeypatch.setenv("CC", "no-such-compiler")
    path = folder / "identified-robot.yaml"
    robot = YAML().load(path)
    known = robot["identification"]
    nearest = EstimateFile.read(folder).best_estimator.consistent.values
    robot["parameters"].update({**nearest, **change})
    count, weak = len(known["parameters"]), known["parameters"].index("v2")
    scales = load_robot(path).scales
    variances = np.diag((1e-3 * scales) ** 2)
    variances[weak, weak] = (0.6 * scales[weak]) ** 2
    known["covariance_random"] = variances.tolist()
    known["covariance_systematic"] = np.zeros((count, count)).tolist()
    YAML().dump(robot, path)
    status, out, err = expdesign("model", folder, "--format", name, "--json")
    assert status == 0, err
    head = next((folder / "model" / name).glob("palida_model.[hp]*")).read_text()[:5000]
    doubts = json.loads(out)["doubts"]
    assert doubts == list(ControlModelFile.read(folder / "model" / name).doubts)
    assert [bool(found)] == ["no machine has these parameters" in text for text in (err,)]
    assert found in err
    assert "not identified (σ of half of their scale or more): v2." in err
    assert len(doubts) == 1 + bool(found)
    words = " ".join(line.lstrip(" *#") for line in head.splitlines())
    assert "not identified (std of half of their scale or more): v2." in words
    assert "estimate.fixed" in words
    assert ("`estimate.consistent: true`" in words) == ("`estimate.consistent: true`" in err)
    assert ("`estimate.consistent: true`" in err) == bool(found)
    for one in change:
        assert f"{one} = {change[one]:g} +-" in words
