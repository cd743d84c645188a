import json

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.trajectory import FourierTrajectory, read_design_file
from expdesign.trajectory import design_file as module


def record(**changes):
    """Return the least that a design.json holds; a key set to ... is left out."""
    rng = np.random.default_rng(0)
    data = {
        "harmonics": 2,
        "omega": 3.0,
        "lambda0": [0.0, 0, -0.654, 0, 0, 0],
        "mu": rng.normal(size=(6, 2)).tolist(),
        "nu": rng.normal(size=(6, 2)).tolist(),
    }
    return {k: v for k, v in (data | changes).items() if v is not ...}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "design.json"


def test_the_least_that_is_needed(file):
    data = record()
    file.write_text(json.dumps(data), encoding="utf-8")
    for source in (file, file.parent, str(file.parent)):
        found = read_design_file(source)
        assert found.path == file
        assert (found.robot, found.status) == (None, None)
        assert isinstance(found.trajectory, FourierTrajectory)
        assert found.trajectory.omega == 3.0
        for key in ("lambda0", "mu", "nu"):
            np.testing.assert_array_equal(getattr(found.trajectory, key), data[key])


def test_what_a_design_states_beside_it(file):
    file.write_text(json.dumps(record(robot="palida", status="converged", solver={"a": 1})))
    found = read_design_file(file)
    assert (found.robot, found.status) == ("palida", "converged")
    file.write_text(json.dumps(record(robot=3, status=None)))
    assert (read_design_file(file).robot, read_design_file(file).status) == (None, None)


def test_another_name_of_the_file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(record(omega=5)), encoding="utf-8")
    assert read_design_file(path).trajectory.omega == 5.0


def with_entry(key, row, value):
    data = record()
    data[key][row] = value
    return {key: data[key]}


BAD = {
    "no harmonics": ({"harmonics": ...}, ["harmonics"]),
    "no omega": ({"omega": ...}, ["omega"]),
    "no coefficients": ({"mu": ..., "nu": ...}, ["mu", "nu"]),
    "nothing at all": (
        dict.fromkeys(record(), ...),
        ["harmonics", "omega", "lambda0", "mu", "nu"],
    ),
    "zero harmonics": ({"harmonics": 0}, ["harmonics"]),
    "a fraction of a harmonic": ({"harmonics": 2.0}, ["harmonics"]),
    "true harmonics": ({"harmonics": True}, ["harmonics"]),
    "other harmonics": ({"harmonics": 3}, ["mu[1]", "mu[2]", "mu[3]", "mu[4]", "mu[5]"] * 2),
    "no number": ({"omega": "fast"}, ["omega"]),
    "omega is negative": ({"omega": -1}, ["omega"]),
    "omega is zero": ({"omega": 0}, ["omega"]),
    "omega is NaN": ({"omega": float("nan")}, ["omega"]),
    "omega is infinite": ({"omega": float("inf")}, ["omega"]),
    "omega is beyond": ({"omega": 10**400}, ["omega"]),
    "five coordinates": ({"lambda0": [0.0] * 5}, ["lambda0"]),
    "a number for a list": ({"lambda0": 0.0}, ["lambda0"]),
    "NaN": (with_entry("mu", 2, [1.0, float("nan")]), ["mu[3][2]"]),
    "null": (with_entry("nu", 0, [None, 1.0]), ["nu[1][1]"]),
    "text": (with_entry("lambda0", 5, "0.1"), ["lambda0[6]"]),
    "a row is missing": ({"mu": record()["mu"][:5]}, ["mu"]),
    "a row is short": (with_entry("nu", 4, [1.0]), ["nu[5]"]),
    "a mapping": ({"mu": {"1": []}}, ["mu"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_values_are_named(case, file):
    changes, keys = BAD[case]
    file.write_text(json.dumps(record(**changes)), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_design_file(file)
    found = [problem.key for problem in caught.value.problems]
    if case == "other harmonics":
        assert found == keys[:5] + [key.replace("mu", "nu") for key in keys[:5]]
    else:
        assert found == keys
    for problem in caught.value.problems:
        assert problem.file == file
        assert problem.message
        assert problem.allowed


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", 1),
        (b"{", 1),
        (b'{\n"omega": 1,\n}', 3),
        (b"name: a\n", 1),
        (b"[]", 1),
        (b"null", 1),
        (b"\xff\xfe\x00", None),
        (b"[" * 200_000, None),
        (b'{"omega": ' + b"9" * 10_000 + b"}", None),
    ],
    ids=lambda value: None if isinstance(value, int) else str(value)[:20],
)
def test_what_is_no_json(content, line, file):
    file.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_design_file(file)
    (problem,) = caught.value.problems
    assert (problem.file, problem.line) == (file, line)
    assert "harmonics" in problem.allowed


def test_a_file_that_is_too_large(file, monkeypatch):
    monkeypatch.setattr(module, "LARGEST_FILE", 1024**2)
    file.write_text(" " * 1024**2 + json.dumps(record()))
    with pytest.raises(InputError, match="larger than 1 MiB"):
        read_design_file(file)


def test_what_is_missing(tmp_path):
    with pytest.raises(InputError, match="the folder has none") as caught:
        read_design_file(tmp_path)
    assert caught.value.problems[0].file == tmp_path / "design.json"
    with pytest.raises(InputError, match="no such file or folder"):
        read_design_file(tmp_path / "nowhere")
    (tmp_path / "design.json").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_design_file(tmp_path)
