import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.configuration import InputError, Problem, RunDescription, load_run, resolved_yaml
from expdesign.configuration.run import RUN_FORMAT
from expdesign.library import robot_files, run_files

QUICK = settings(max_examples=50, deadline=None)


def _write(folder, text, name="run.yaml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def _same(first, second):
    assert first.run == second.run
    assert first.run.stages == second.run.stages
    a, b = first.robot, second.robot
    assert a.description == b.description
    assert a.parameters == b.parameters
    assert a.characteristic_length == b.characteristic_length
    for name in ("home", "gravity", "base_joints", "platform_joints", "alpha_axes"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(a.platform_joint_axes, b.platform_joint_axes)
    assert list(a.limits) == list(b.limits)
    for key, limit in a.limits.items():
        np.testing.assert_array_equal(limit.lower, b.limits[key].lower)
        np.testing.assert_array_equal(limit.upper, b.limits[key].upper)
    assert (a.noise is None) == (b.noise is None)
    if a.noise is not None:
        for name in ("force_covariance", "length_covariance"):
            mine, other = getattr(a.noise, name), getattr(b.noise, name)
            assert (mine is None) == (other is None)
            assert mine is None or np.array_equal(mine, other)


# --- sources ------------------------------------------------------------------------------------


def test_file_mapping_model_and_configuration(tmp_path, monkeypatch):
    path = _write(tmp_path, "name: a\nrobot: palida\ndesign: {starts: 3}\n")
    configuration = load_run(path)
    assert configuration.run.name == "a"
    assert configuration.file == path
    assert configuration.run.stages == ("design",)
    _same(configuration, load_run(str(path)))
    mapping = {"name": "a", "robot": "palida", "design": {"starts": 3}}
    _same(configuration, load_run(mapping))
    _same(configuration, load_run(RunDescription.model_validate(mapping)))
    _same(configuration, load_run(configuration.run))
    assert load_run(configuration) is configuration
    monkeypatch.chdir(tmp_path)
    _same(configuration, load_run("run.yaml"))
    (tmp_path / "palida").mkdir()
    assert load_run("palida").run.name == "palida"


def test_mapping_of_arrays_and_tuples(run_mapping):
    robot = run_mapping["robot"]
    robot["base_joints"] = np.array(robot["base_joints"])
    robot["home"] = tuple(robot["home"])
    robot["parameters"]["p10"] = np.float32(16.25)
    run_mapping["trajectory"] = {"harmonics": np.int64(4)}
    configuration = load_run(run_mapping)
    assert configuration.run.trajectory.harmonics == 4
    assert configuration.robot.parameters["p10"] == 16.25


def test_robot_path_is_relative_to_the_run_file(tmp_path, monkeypatch, robot_mapping):
    (tmp_path / "robots").mkdir()
    first = load_run({"name": "a", "robot": robot_mapping})
    text = resolved_yaml(first).split("robot:\n")[1].split("\n\n")[0]
    text = "\n".join(line[2:] for line in text.splitlines())
    _write(tmp_path / "robots", text.replace("name: palida", "name: mine"), "mine.yaml")
    path = _write(tmp_path, "name: a\nrobot: robots/mine.yaml\n")
    monkeypatch.chdir("/")
    configuration = load_run(path)
    assert configuration.robot.name == "mine"
    assert configuration.robot.source == tmp_path / "robots" / "mine.yaml"
    monkeypatch.chdir(tmp_path)
    assert load_run({"name": "a", "robot": "robots/mine.yaml"}).robot.name == "mine"


def test_data_files_are_relative_to_the_run_file(tmp_path):
    path = _write(
        tmp_path,
        "name: a\nrobot: palida\ndata: {file: m.csv}\nvalidate: [{motion: file, file: /abs.csv}]\n",
    )
    configuration = load_run(path)
    assert configuration.run.data.file == str(tmp_path / "m.csv")
    assert configuration.run.validation[0].file == "/abs.csv"
    assert configuration.run.stages == ("validate",)


@pytest.mark.parametrize(
    ("source", "says", "nearest"),
    [
        ("palidda", "there is no file 'palidda'", "palida"),
        ("PaLiDA", "there is no file 'PaLiDA'", "palida"),
        ("zzz", "there is no file 'zzz'", None),
        ("missing.yaml", "there is no such file", None),
        ("no/such/place", "there is no such file", None),
        (Path("missing"), "there is no such file", None),
        (Path("/"), "this is a folder", None),
        ("/", "this is a folder", None),
        ("a\0b.yaml", "cannot be read", None),
        ("~nobody-of-that-name/x.yaml", "there is no such file", None),
        ({}, "the key 'name' is missing", None),
        ({"name": "a"}, "the key 'robot' is missing", None),
        ({"name": "a", "robot": "palidda"}, "there is no file 'palidda'", "palida"),
        ({"name": "a", "robot": "rubn"}, "there is no file 'rubn'", "rubin"),
        ({"name": "a", "robot": "robots/none.yaml"}, "there is no such file", None),
        ({1: "a"}, "the key 1 is not a text", None),
    ],
)
def test_what_cannot_be_found(problems_of, source, says, nearest):
    problem = next(p for p in problems_of(source) if says in p.message)
    assert problem.nearest == nearest


def test_a_robot_file_that_is_missing_is_told_where_it_is_named(tmp_path, problems_of):
    run = _write(tmp_path, "name: a\nrobot: robots/none.yaml\n", "run.yaml")
    (problem,) = problems_of(run)
    assert (problem.file, problem.line, problem.key) == (run, 2, "robot")
    assert str(tmp_path / "robots" / "none.yaml") in problem.message


def test_a_mapping_that_contains_itself(problems_of):
    mapping = {"name": "a"}
    mapping["robot"] = mapping
    (problem,) = problems_of(mapping)
    assert "nested too deeply" in problem.message


def test_problems_name_file_line_and_key(tmp_path, problems_of):
    robot = _write(tmp_path, "name: r\nhome: [0, 0, 5 kg, 0, 0, 0]\nlimits: {tilt: -1}\n", "r.yaml")
    run = _write(
        tmp_path,
        "name: a\nrobot: r.yaml\n\ntrajectory:\n  harmonics: 0\nlimits:\n  alpha: [2, 1]\n",
    )
    problems = problems_of(run)
    places = [(p.file, p.line, p.key) for p in problems if "missing" not in p.message]
    assert places == [
        (run, 5, "trajectory.harmonics"),
        (run, 7, "limits.alpha"),
        (robot, 2, "home[3]"),
        (robot, 3, "limits.tilt"),
    ]
    assert str(problems[0]).startswith(f"{run}:5: trajectory.harmonics: 0 is out of range")
    assert {p.key for p in problems if "missing" in p.message} == {
        "base_joints",
        "platform_joints",
        "parameters",
    }


def test_nothing_is_reported_twice(run_mapping, problems_of):
    run_mapping["limits"] = {"tilt": -1}
    run_mapping["robot"]["limits"]["alpha"] = 5
    assert [p.key for p in problems_of(run_mapping)] == ["robot.limits.alpha", "limits.tilt"]


def test_error_survives_pickling():
    error = InputError([Problem("a", key="b"), Problem("c")])
    assert pickle.loads(pickle.dumps(error)).problems == error.problems
    with pytest.raises(ValueError, match="needs a problem"):
        InputError([])


# --- overrides and what follows from other sections ---------------------------------------------


def test_limits_and_noise_of_the_run_override_the_robots(tmp_path):
    path = _write(
        tmp_path,
        "name: a\n"
        "robot: palida\n"
        "limits:\n"
        "  strut_speed: 1 m/s\n"
        "  position: {x: [-0.1, 0.1]}\n"
        "noise: {force_std: [1, 1, 1, 1, 1, 1]}\n",
    )
    robot = load_run(path).robot
    assert robot.limits["strut_speed"].upper.tolist() == [1] * 6
    assert robot.limits["strut_speed"].origin == "run.yaml: limits.strut_speed"
    assert robot.limits["strut_speed"].line == 4
    assert robot.limits["tilt"].origin == "palida.yaml: limits.tilt"
    assert robot.limits["position"].upper.tolist() == [0.1, 0.2, -0.504]
    # Key by key: the correlation is still the robot's.
    assert robot.noise.force_covariance[0, 1] == pytest.approx(0.5)
    assert robot.noise.length_covariance[0, 0] == pytest.approx(1e-8)


def test_controller_period_defaults_to_the_sampling():
    mapping = {"name": "a", "robot": "palida"}
    assert load_run(mapping).run.trajectory.controller_period == 0.001
    mapping["experiment"] = {"sampling": "500 Hz"}
    assert load_run(mapping).run.trajectory.controller_period == 0.002


def test_parameters_must_be_the_robots(run_mapping, problems_of):
    run_mapping |= {
        "design": {"parameters": ["p1", "Ixy"]},
        "estimate": {"fixed": ["sx"], "bounds": {"Iyz": [0, 1]}},
    }
    problems = problems_of(run_mapping)
    assert [p.key for p in problems] == ["design.parameters", "estimate.fixed", "estimate.bounds"]
    assert "platform: general" in problems[0].message
    run_mapping["robot"]["platform"] = "general"
    load_run(run_mapping)


def test_a_hum_that_is_folded_by_the_sampling_is_a_warning(run_mapping):
    known = load_run(run_mapping).warnings
    hum = {"frequency": 60, "amplitude": 5, "harmonics": [1, 0, 1]}
    for sampling, seen in ((1000, []), (300, ["120 Hz"]), (100, ["40 Hz", "20 Hz"])):
        run_mapping["experiment"] = {"sampling": sampling, "hum": hum}
        new = [text for text in load_run(run_mapping).warnings if text not in known]
        assert len(new) == len(seen)
        for text, frequency in zip(new, seen, strict=True):
            assert text.startswith("experiment.hum")
            assert text.endswith(frequency)


def test_missing_noise_is_a_warning(run_mapping):
    del run_mapping["robot"]["noise"]
    assert not any("noise" in w for w in load_run(run_mapping).warnings)
    run_mapping["design"] = {}
    assert any("no noise of the forces" in w for w in load_run(run_mapping).warnings)


# --- the resolved configuration -----------------------------------------------------------------


@pytest.mark.parametrize("name", run_files())
def test_round_trip_of_the_runs_that_ship(tmp_path, name):
    configuration = load_run(name)
    text = resolved_yaml(configuration)
    again = load_run(_write(tmp_path, text))
    _same(configuration, again)
    assert resolved_yaml(again) == text


@pytest.mark.parametrize("name", robot_files())
def test_round_trip_of_the_robots_that_ship(tmp_path, name):
    configuration = load_run({"name": "a", "robot": name, "validate": [{"motion": "circle"}]})
    again = load_run(_write(tmp_path, resolved_yaml(configuration)))
    _same(configuration, again)


def test_round_trip_of_everything(tmp_path, run_mapping):
    run_mapping["robot"] |= {"platform": "general", "platform_joint_axes": [[1, 2, 3]] * 6}
    run_mapping |= {
        "description": "two\nlines, a tab\t and 'quotes' \"\\\" # no comment",
        "limits": {
            "actuator_force": [[-1e3, 2e3]] * 5 + [3e3],
            "strut_speed": [1, 2, 3, 1, 2, 3],
            "platform_joint_angle": "40 deg",
            "rotation": {"psi": [-1, 1]},
            "characteristic_length": "150 mm",
        },
        "noise": {"force_covariance": (np.eye(6) + 0.1).tolist()},
        "design": {"parameters": ["p1", "sx"], "max_seconds": 60},
        "experiment": {
            "cogging": {"amplitude": 12, "pitch": "30 mm"},
            "outliers": {"share": 1e-5},
        },
        "data": {"columns": {"t": "time [s]", "q1": "null"}, "units": {"q": "mm"}},
        "estimate": {"fixed": {"p1": None, "p2": 1.0}, "bounds": {"r1": [0, 1]}},
        "validate": [{"motion": "line", "poses": [[0, 0, -0.6, 0, 0, 0], [0, 0, -0.7, 0, 0, 0.1]]}],
        "export": ["csv"],
        "scheduler": "tcp://localhost:8786",
    }
    configuration = load_run(run_mapping)
    again = load_run(_write(tmp_path, resolved_yaml(configuration)))
    _same(configuration, again)
    assert again.run.data.columns["q1"] == "null"


@pytest.mark.parametrize(
    ("limits", "widths"),
    [
        ({}, (0.8, 0.2, 0.1)),  # PaLiDA: 2 m/s
        ({"strut_speed": "0.4 m/s"}, (0.16, 0.04, 0.02)),
        ({"strut_speed": [0.5, 0.5, 0.5, 0.5, 0.5, 0.8]}, (0.32, 0.08, 0.04)),
        ({"strut_speed": [-0.6, 0.2]}, (0.24, 0.06, 0.03)),
        ({"strut_speed": "0.5 mm/s"}, (2e-4, 5e-5, 2.5e-5)),
    ],
)
def test_smoothing_follows_the_speed_limit(limits, widths, tmp_path):
    mapping = {"name": "a", "robot": "palida", "limits": limits}
    configuration = load_run(mapping)
    assert configuration.run.design.smoothing == pytest.approx(widths, rel=1e-12)
    assert configuration.run.stages == ()  # what is filled in is not named
    assert f"smoothing: [{configuration.run.design.smoothing[0]!r}, " in resolved_yaml(
        configuration
    )
    _same(configuration, load_run(_write(tmp_path, resolved_yaml(configuration))))
    given = load_run({**mapping, "design": {"smoothing": [0.3]}})
    assert given.run.design.smoothing == (0.3,)
    assert given.run.stages == ("design",)


def test_smoothing_without_a_speed_limit():
    robot = load_run("palida").robot.description.model_dump(mode="json", by_alias=True)
    del robot["limits"]["strut_speed"]
    run = load_run({"name": "a", "robot": robot}).run
    assert run.design.smoothing == (0.8, 0.2, 0.1)


def test_every_default_is_printed():
    text = resolved_yaml(load_run({"name": "a", "robot": "palida"}))
    for key in ("smoothing", "time_tolerance", "repetitions", "differentiation", "alpha_axes"):
        assert f"{key}:" in text
    assert "# design:" in text
    assert "SI units" in text


@QUICK
@given(
    description=st.text(),
    frequency=st.floats(2.5e-3, 499),
    tilt=st.floats(1e-6, 3),
    column=st.text(min_size=1, max_size=20).filter(str.strip),
)
def test_round_trip_of_any_text_and_number(tmp_path_factory, description, frequency, tilt, column):
    mapping = {
        "name": "a",
        "description": description,
        "robot": "palida",
        "trajectory": {"frequency": [frequency, frequency]},
        "limits": {"tilt": tilt},
        "data": {"columns": {"t": column}},
    }
    configuration = load_run(mapping)
    path = tmp_path_factory.getbasetemp() / "text.yaml"
    path.write_text(resolved_yaml(configuration), encoding="utf-8")
    _same(configuration, load_run(path))


# --- whatever stands in a mapping, it loads or is refused ---------------------------------------

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["5 kg", "30 deg", "1e400", ".nan", "all", "palida", "1 m"]),
    st.binary(max_size=4),
    st.complex_numbers(),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=7), st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=20,
)
SECTIONS = [*RunDescription.model_fields, "validate"]
NAMES = st.sampled_from([*SECTIONS, "harmonics", "samples", "criterion", "columns", "x"])


def _loads_or_is_refused(mapping):
    try:
        configuration = load_run(mapping)
    except InputError as error:
        for problem in error.problems:
            assert problem.message
            str(problem).encode("utf-8", "backslashreplace")
        return
    resolved_yaml(configuration)


@QUICK
@given(st.dictionaries(st.one_of(NAMES, st.text(), st.integers()), VALUES))
def test_any_mapping(mapping):
    _loads_or_is_refused(mapping)


@QUICK
@given(st.data())
def test_any_value_in_the_place_of_a_valid_one(data):
    mapping = load_run("palida").run.model_dump(mode="json", by_alias=True)
    for _ in range(data.draw(st.integers(1, 3))):
        place, key = mapping, data.draw(st.sampled_from(sorted(mapping)))
        while True:
            inner = place[key]
            keys = sorted(inner) if isinstance(inner, dict) else None
            keys = list(range(len(inner))) if isinstance(inner, list) else keys
            if not keys or data.draw(st.integers(0, 3)) == 0:
                break
            place, key = inner, data.draw(st.sampled_from(keys))
        place[key] = data.draw(VALUES)
    _loads_or_is_refused(mapping)


# --- format -------------------------------------------------------------------------------------


def test_a_resolved_run_states_its_format_and_a_users_needs_none(tmp_path):
    configuration = load_run(_write(tmp_path, "name: a\nrobot: palida\n"))
    text = resolved_yaml(configuration)
    assert f"\nformat: {RUN_FORMAT}\n" in text
    _same(configuration, load_run(_write(tmp_path, text)))
    _same(configuration, load_run(_write(tmp_path, text.replace(f"format: {RUN_FORMAT}\n", ""))))


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (RUN_FORMAT + 1, "was made by a newer version"),
        (0, "was made by an earlier version; run it again"),
        ("one", "'one' is not a format number"),
        (-1, "-1 is not a format number"),
        (True, "True is not a format number"),
    ],
)
def test_another_format_is_refused(tmp_path, problems_of, found, says):
    path = _write(tmp_path, f"name: a\nformat: {found}\nrobot: palida\n")
    (problem,) = problems_of(path)
    assert says in problem.message
    assert (problem.file, problem.line, problem.key) == (path, 2, "format")
