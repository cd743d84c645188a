"""The YAML and the Python of the docs work."""

import ast
import dataclasses
import importlib
import re
import sys
from pkgutil import resolve_name

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

import expdesign
from constraints import limit_definitions, limits
from expdesign.cli.app import app
from expdesign.configuration import RunDescription, load_run
from expdesign.configuration import design as design_section
from expdesign.configuration.robot import RobotDescription, load_robot_description
from expdesign.information.criteria import criteria, spectral_cost
from expdesign.robot import LimitModel, robot_from
from expdesign.solver.phases import SearchEvent
from tests.docs.pages import FILES, ROOT, blocks, parse, prose

# Pages whose files are written by their commands: test_tutorial.py executes them.
EXECUTED_PAGES = ("own-machine", "payload")
YAML_BLOCKS = [block for block in blocks("yaml") if block.page.stem not in EXECUTED_PAGES]
LIMIT = "constraints/limits/strut_inclination.py"
CRITERION = "phi2.py"


# As in: `A` or `B.read(folder)` of `module`; and `module.A` alone.
_NAME = r"`([A-Za-z_.]+)(?:\([a-z]*\))?`"
_PLACE = r"`((?:constraints|expdesign|estimation|results)[A-Za-z_.]*)`"
NAMED = re.compile(rf"{_NAME}(?:\s+or\s+{_NAME})?\s+of\s+{_PLACE}")
DOTTED = re.compile(_PLACE)


SERVO = {"drive": {"motor": {"force_constant": "80 N/A", "resistance": "1 ohm"}}}
"""Of the machine whose run files the pages show in part, so that these may have voltages."""


def _keys(model):
    return {info.alias or name for name, info in model.model_fields.items()}


def _is_robot(data):
    return {"name", "base_joints"} <= set(data)


def _name(block):
    return block.text.partition("\n")[0].removeprefix("# ")


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Folder with every robot file that the docs show."""
    folder = tmp_path_factory.mktemp("robots")
    for block in YAML_BLOCKS:
        if _is_robot(parse(block.text)):
            assert _name(block).endswith(".yaml"), "a robot's first line names its file"
            (folder / _name(block)).write_text(block.text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def palida():
    return parse(load_robot_description("palida").source.read_text(encoding="utf-8"))


@pytest.mark.parametrize("block", YAML_BLOCKS, ids=lambda block: block.page.stem)
def test_yaml_is_valid(block, robots, palida):
    data = parse(block.text)
    if _is_robot(data):
        robot_from(load_robot_description(robots / _name(block)))
    elif "robot" in data:
        file = robots / "run_of_the_docs.yaml"
        file.write_text(block.text, encoding="utf-8")
        robot_from(load_run(file).robot)
    elif set(data) <= _keys(RunDescription):
        robot_from(load_run({"name": "part", "robot": palida | SERVO, **data}).robot)
    else:
        assert set(data) <= _keys(RobotDescription)
        robot_from(load_run({"name": "part", "robot": palida | data}).robot)


def test_there_are_complete_examples_of_a_robot_and_a_run():
    shown = [parse(block.text) for block in YAML_BLOCKS if block.page.name == "robots.md"]
    assert any(_is_robot(data) for data in shown)
    assert any("robot" in data for data in shown)


def test_the_robot_of_the_docs_is_free_of_warnings(robots):
    (run,) = (b for b in YAML_BLOCKS if _name(b) == "my-run.yaml")
    (robots / "my-run.yaml").write_text(run.text, encoding="utf-8")
    assert load_run(robots / "my-run.yaml").warnings == ()


def test_the_python_of_the_readme(monkeypatch):
    (block,) = (b for b in blocks("python") if b.page.name == "README.md")
    calls = []

    class Result:
        trajectory = expdesign.FourierTrajectory(1.0, np.zeros(6), np.ones((6, 1)), np.ones((6, 1)))

    monkeypatch.setattr(expdesign, "design", lambda config: calls.append(config) or Result())
    names = {}
    exec(compile(block.text, "README.md", "exec"), names)
    assert calls == ["my-palida.yaml"]
    assert names["lengths"].shape == (6,)
    assert names["motion"].pose.shape == (2, 6)


def test_the_python_of_the_twin(tmp_path, monkeypatch):
    text = "".join(b.text for b in blocks("python") if b.page.name == "twin.md")
    for name in ("my-experiment.yaml", "real-machine.yaml"):
        (run,) = (b for b in YAML_BLOCKS if _name(b) == name)
        (tmp_path / name).write_text(run.text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(text, "twin.md", "exec"), names)
    assert names["first"].lengths.shape == names["second"].forces.shape == (20944, 6)
    assert names["twin"].truth.executed.harmonics == 15
    assert len(names["drawn"].values) == 36


@pytest.mark.slow
def test_the_python_page(tiny_result, tmp_path, monkeypatch):
    """Its blocks run one after the other, with a prepared design."""
    calls = []

    def design(config, monitor):
        monitor.report(SearchEvent(1, "blunt", 1, 1.0, 0.0, 0.0))
        calls.append((config.run.name, monitor.stop_requested()))
        return tiny_result

    monkeypatch.setattr(expdesign, "design", design)
    monkeypatch.setattr("expdesign.stages.design.design", lambda *_: tiny_result)
    monkeypatch.setattr("results.design_figures", lambda _, folder: calls.append(folder))
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks("python"):
        if block.page.name == "python.md":
            exec(compile(block.text, "python.md", "exec"), names)
    assert calls == [("from-python", False), names["folder"]]
    assert (tmp_path / "runs/from-python/trajectory.csv").is_file()
    np.testing.assert_allclose(names["there"], names["pose"], atol=1e-9)
    assert names["jacobian"].shape == (6, 6)
    assert names["struts"].alpha.shape == (6,)
    assert names["log_det"] == pytest.approx(tiny_result.log_det_information, abs=1e-6)
    assert names["estimated"].estimators.keys() == {"ls", "gm"}
    np.testing.assert_allclose(names["own"].time, names["measured"].time, rtol=0, atol=1e-12)
    assert names["own"].step == pytest.approx(names["measured"].step, rel=1e-12)
    assert names["found"].verdict == names["verdict"].status.value
    np.testing.assert_array_equal(
        names["again"].robot.base_joints, names["robot"].description.base_joints
    )
    assert list(names["made"].stages) == ["design", "experiment", "estimate"]
    assert names["page"] == tmp_path / "runs" / "whole" / "report.html"
    assert names["page"].is_file()


@pytest.mark.parametrize("page", FILES, ids=lambda page: page.stem)
def test_named_modules_exist(page):
    text = prose(page)
    found = [f"{place}.{name}" for *names, place in NAMED.findall(text) for name in names if name]
    found += DOTTED.findall(text)
    for block in blocks("python"):
        if block.page == page:
            imports = [n for n in ast.parse(block.text).body if isinstance(n, ast.ImportFrom)]
            found += [f"{each.module}.{alias.name}" for each in imports for alias in each.names]
    for name in found:
        resolve_name(name)


@pytest.fixture
def with_limit(example, tmp_path, monkeypatch):
    """Drop the worked example into the catalogue of limits."""
    folder = tmp_path / "limits"
    folder.mkdir()
    (folder / "strut_inclination.py").write_text(example(LIMIT), encoding="utf-8")
    monkeypatch.setattr(limits, "__path__", [*limits.__path__, str(folder)])
    importlib.invalidate_caches()
    limit_definitions.cache_clear()
    yield
    monkeypatch.undo()
    sys.modules.pop(f"{limits.__name__}.strut_inclination", None)
    vars(limits).pop("strut_inclination", None)
    limit_definitions.cache_clear()


def _inclined(bound):
    run = load_run({"name": "n", "robot": "palida", "limits": {"strut_inclination": bound}})
    return robot_from(run.robot)


@pytest.mark.usefixtures("with_limit")
def test_the_limit_of_the_docs_bounds_the_inclination():
    robot = _inclined("60 deg")
    (limit,) = (limit for limit in robot.limits if limit.key == "strut_inclination")
    rng = np.random.default_rng(0)
    states = np.zeros((20, 18))
    states[:, :6] = robot.home + rng.normal(size=(20, 6)) * 0.1
    values = LimitModel(robot, (limit,)).values(states)
    base = robot.description.base_joints
    for state, row in zip(states, values, strict=True):
        rotation = ca.evalf(robot_rotation(state[3:6])).full()
        struts = state[:3] + robot.description.platform_joints @ rotation.T - base
        cosines = np.abs(struts[:, 2]) / np.linalg.norm(struts, axis=1)
        np.testing.assert_allclose(row, np.arccos(cosines), rtol=0, atol=1e-9)


def robot_rotation(angles):
    rotation = importlib.import_module("expdesign.mechanism.strut")
    return rotation.rotation_matrix(ca.SX(ca.DM(angles)))


@pytest.mark.usefixtures("with_limit")
def test_both_forms_of_the_limit_of_the_docs_agree():
    (limit,) = (k for k in _inclined("50 deg").limits if k.key == "strut_inclination")
    direction = ca.SX.sym("u", 3, 6)
    forms = ca.Function(
        "forms",
        [direction],
        [
            limit.definition.natural({"strut_direction": direction}),
            limit.definition.smooth({"strut_direction": direction}),
        ],
    )
    _, highest = limit.smooth_bounds()
    rng = np.random.default_rng(1)
    for _ in range(30):
        u = rng.normal(size=(3, 6))
        natural, smooth = (form.full().ravel() for form in forms(u / np.linalg.norm(u, axis=0)))
        np.testing.assert_array_equal(limit.violation(natural) > 0, smooth > highest)


@pytest.mark.usefixtures("with_limit")
def test_the_limit_of_the_docs_refuses_a_home_that_breaks_it():
    with pytest.raises(expdesign.InputError, match="inclination of the strut"):
        _inclined("30 deg")


@pytest.fixture
def phi2(example):
    names = {"__name__": "phi2"}
    exec(compile(example(CRITERION), "phi2.py", "exec"), names)
    return names["PHI2"]


def test_the_criterion_of_the_docs_has_its_derivatives(phi2):
    rng = np.random.default_rng(2)
    logs = np.sort(rng.normal(size=5))
    cost, slope, curvature = phi2.cost(logs, phi2.levels[-1])
    assert np.exp(cost) == pytest.approx(phi2.value(np.exp(logs)), rel=1e-12)
    step = 1e-6
    for k, unit in enumerate(np.eye(5)):
        ahead, behind = (phi2.cost(logs + sign * step * unit, 2.0) for sign in (1, -1))
        assert slope[k] == pytest.approx((ahead[0] - behind[0]) / (2 * step), abs=1e-8)
        np.testing.assert_allclose(curvature[k], (ahead[1] - behind[1]) / (2 * step), atol=1e-8)


def test_the_criterion_of_the_docs_lies_between_a_and_e(phi2):
    eigenvalues = np.array([0.5, 1.0, 4.0])
    trace = criteria()["a"].value(eigenvalues)
    smallest = criteria()["e"].value(eigenvalues)
    assert 1 / smallest < phi2.value(eigenvalues) < trace
    samples = 7
    cost = spectral_cost(np.diag(eigenvalues) / samples, phi2, 2.0).value
    read = phi2.from_cost(cost, 3, samples, 0.0)
    assert read == pytest.approx(phi2.value(eigenvalues), rel=1e-12)


def test_the_schema_admits_every_criterion():
    assert tuple(criteria()) == design_section.criterion_keys()


def test_the_commands_of_the_docs_exist():
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    names = [
        command.name or command.callback.__name__.replace("_", "-")
        for command in app.registered_commands
    ]
    for name in names:
        assert f"| `expdesign {name}" in text
        assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0
    assert text.count("| `expdesign ") == len(names)


def test_limits_are_frozen_data(robots):
    """Limits are data, as the docs say."""
    robot = robot_from(load_robot_description(robots / "my-hexapod.yaml"))
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.limits[0].origin = "elsewhere"
