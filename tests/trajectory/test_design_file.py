import json
import re

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.runfolder import MissingFileError
from expdesign.trajectory import FourierTrajectory, TrajectoryFile, fourier_keys


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
    for source in (file, file.parent):
        found = TrajectoryFile.read(source)
        assert (found.robot, found.status) == (None, None)
        assert isinstance(found.trajectory, FourierTrajectory)
        assert found.trajectory.omega == 3.0
        for key in ("lambda0", "mu", "nu"):
            np.testing.assert_array_equal(getattr(found.trajectory, key), data[key])


def test_what_a_design_states_beside_it(file):
    file.write_text(json.dumps(record(robot="palida", status="converged", solver={"a": 1})))
    found = TrajectoryFile.read(file)
    assert (found.robot, found.status) == ("palida", "converged")


def test_what_is_written_is_read_with_every_digit(tmp_path):
    rng = np.random.default_rng(1)
    made = FourierTrajectory(0.1 + 0.2, rng.normal(size=6), *rng.normal(size=(2, 6, 3)))
    (path,) = TrajectoryFile(**fourier_keys(made)).write(tmp_path)
    for source in (path, tmp_path):
        found = TrajectoryFile.read(source).trajectory
        np.testing.assert_array_equal(found.vector(), made.vector())


def test_another_name_of_the_file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(record(omega=5)), encoding="utf-8")
    assert TrajectoryFile.read(path).trajectory.omega == 5.0


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
    "other harmonics": ({"harmonics": 3}, ["mu", "nu"]),
    "no robot's name": ({"robot": 3}, ["robot"]),
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
    "a row is short": (with_entry("nu", 4, [1.0]), ["nu"]),
    "a mapping": ({"mu": {"1": []}}, ["mu"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_values_are_named(case, file):
    changes, keys = BAD[case]
    file.write_text(json.dumps(record(**changes)), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        TrajectoryFile.read(file)
    found = [problem.key for problem in caught.value.problems]
    assert found == keys
    for problem in caught.value.problems:
        assert problem.file == file
        assert problem.message
        assert not re.search("[Ii]nput|should|valid", problem.message), "words of a library"


@pytest.mark.parametrize(
    ("changes", "found", "allowed"),
    [
        ({"omega": "fast"}, "'fast'", "number"),
        ({"omega": -1}, "-1", "at least 1e-06"),
        ({"omega": float("inf")}, "inf", "finite"),
        ({"harmonics": 0}, "0", "at least 1"),
        ({"harmonics": 2.5}, "2.5", "whole number"),
        ({"harmonics": 2.0}, "2.0", "without point"),
        ({"robot": 3}, "3", "text"),
        ({"mu": {"1": []}}, "a mapping", "list"),
        ({"lambda0": [0.0] * 5}, "5 entries", "6"),
    ],
)
def test_a_wrong_value_is_told_with_what_is_allowed(changes, found, allowed, file):
    file.write_text(json.dumps(record(**changes)), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        TrajectoryFile.read(file)
    (problem,) = caught.value.problems
    assert found in problem.message
    assert allowed in str(problem)


@pytest.mark.parametrize("place", ["", "nowhere", "design.json"])
def test_what_is_missing(tmp_path, place):
    with pytest.raises(MissingFileError, match="harmonics, omega, lambda0"):
        TrajectoryFile.read(tmp_path / place)
