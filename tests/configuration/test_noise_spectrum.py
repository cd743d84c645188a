"""Spectra of noise in robot and run files."""

import json
import re

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.noise import AMPLITUDES, COHERENCIES, DENSITIES
from expdesign.mechanism.hexapod import ACTUATORS

STD = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
RUN = {"name": "n", "robot": "palida"}


def _noise(**keys):
    return load_run(RUN | {"noise": keys}).robot.noise


def _refused(**keys):
    with pytest.raises(InputError) as caught:
        _noise(**keys)
    return caught.value.problems[0]


def _file(folder, rows, more=()):
    path = folder / "spectrum.csv"
    lines = [("frequency", *DENSITIES, *more), *rows]
    path.write_text("\n".join(",".join(map(str, line)) for line in lines), encoding="utf-8")
    return path


def _flat(folder):
    return _file(folder, [[f, *(np.square(STD) / 500)] for f in (0, 100, 500)])


def test_no_spectrum_is_white():
    assert load_run("palida").robot.noise.force_spectrum is None
    assert _noise(force_std=STD, force_spectrum="white").force_spectrum is None


@pytest.mark.parametrize(
    ("ar", "rows"),
    [
        (0.9, [[0.9]] * 6),
        ([0.1, 0.2, 0.3, 0.4, 0.5, "0.6"], [[0.1], [0.2], [0.3], [0.4], [0.5], [0.6]]),
        ([[0.5, 0.2]], [[0.5, 0.2]] * 6),
        (
            [[0.5, 0.2], [0.3], [0.1], [0], [0], [0]],
            [[0.5, 0.2], [0.3, 0], [0.1, 0], *[[0, 0]] * 3],
        ),
    ],
)
def test_autoregressive(ar, rows):
    noise = _noise(force_covariance=np.diag(np.square(STD)), force_spectrum={"ar": ar})
    (part,) = noise.force_spectrum.parts
    np.testing.assert_array_equal(part.coefficients, rows)
    np.testing.assert_allclose(noise.force_covariance, np.diag(np.square(STD)), rtol=1e-12)


def test_hum_comes_on_top_of_the_covariance():
    lines = [{"frequency": "50 Hz", "amplitude": "2 N"}, {"frequency": 150, "amplitude": STD}]
    covariance = np.diag(np.square(STD))
    noise = _noise(force_covariance=covariance, force_spectrum={"hum": lines})
    expected = covariance + np.diag(2 + np.square(STD) / 2)
    np.testing.assert_allclose(noise.force_covariance, expected, rtol=1e-12)
    one = _noise(length_std=STD, length_spectrum={"hum": {"frequency": 50, "amplitude": "1 mm"}})
    expected = np.square(STD) + 0.5e-6
    np.testing.assert_allclose(np.diag(one.length_covariance), expected, rtol=1e-12)


def test_a_file_gives_size_and_shape(tmp_path):
    path = _flat(tmp_path)
    noise = _noise(force_spectrum=str(path))
    np.testing.assert_allclose(noise.force_covariance, np.diag(np.square(STD)), rtol=1e-12)
    found = noise.force_spectrum.at(np.array([0.0, 30.0, 500.0]), 1000.0, 1e4)
    np.testing.assert_allclose(found, [np.diag(np.square(STD))] * 3, rtol=1e-12)


def test_a_covariance_beside_a_file_leaves_the_shape(tmp_path):
    rows = [[0, *[4.0] * 6], [500, *[2.0] * 6]]
    noise = _noise(force_std=STD, force_spectrum=str(_file(tmp_path, rows)))
    own = load_run("palida").robot.description.noise.force_correlation
    np.testing.assert_allclose(noise.force_covariance, np.array(own) * np.outer(STD, STD))
    at = noise.force_spectrum.at(np.array([0.0, 500.0]), 1000.0, 1e4)
    np.testing.assert_allclose(at[0], 2 * at[1], rtol=1e-12)


def test_a_file_with_lines_and_coherencies(tmp_path):
    more = np.zeros((3, len(AMPLITUDES) + len(COHERENCIES)))
    more[1, 2] = 3.0  # of strut 3 at 100 Hz
    more[:, len(AMPLITUDES)] = 0.5  # real part of struts 2 and 1
    more[1, len(AMPLITUDES) + 1] = 0.3
    rows = [[f, *[0.01] * 6, *m] for f, m in zip((0, 100, 500), more, strict=True)]
    noise = _noise(force_spectrum=str(_file(tmp_path, rows, (*AMPLITUDES, *COHERENCIES))))
    expected = 5 * np.eye(ACTUATORS)
    expected[2, 2] += 4.5
    expected[0, 1] = expected[1, 0] = 2.5
    np.testing.assert_allclose(noise.force_covariance, expected, rtol=1e-12)
    at = noise.force_spectrum.at(np.array([99.0, -99.0]), 1000.0, 1e5)
    assert at[0, 1, 0].imag == pytest.approx(0.3 * 5 * 0.99, rel=1e-3)
    assert at[1, 1, 0].imag == pytest.approx(-0.3 * 5 * 0.99, rel=1e-3)


def test_what_is_resolved_needs_no_file(tmp_path):
    path = _flat(tmp_path)
    run = RUN | {"noise": {"force_spectrum": {"file": str(path), "hum": []}}}
    configuration = load_run(run)
    written = tmp_path / "run.yaml"
    written.write_text(resolved_yaml(configuration), encoding="utf-8")
    path.unlink()
    again = load_run(written)
    assert again.run == configuration.run
    frequencies = np.linspace(0, 500, 7)
    found, expected = (
        c.robot.noise.force_spectrum.at(frequencies, 1000.0, 1e4) for c in (again, configuration)
    )
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("spectrum", "key"),
    [
        ({"ar": 1.0}, "ar"),
        ({"ar": -1.2}, "ar"),
        ({"ar": [[0.9, 0.2]]}, "ar"),
        ({"ar": [0.1, 0.2]}, "ar"),
        ({"ar": [[]]}, "ar"),
        ({"ar": "much"}, "ar"),
        ({"ar": 0.5, "file": "spectrum.csv"}, "file"),
        ({"hum": {"frequency": 0, "amplitude": 1}}, "hum[1].frequency"),
        ({"hum": {"frequency": 50, "amplitude": [1, 2]}}, "hum[1].amplitude"),
        ({"hum": {"frequency": 50, "amplitude": "1 mm"}}, "hum[1].amplitude"),
        ({"colour": "pink"}, "colour"),
    ],
)
def test_what_is_no_spectrum_is_refused_with_its_place(spectrum, key):
    assert _refused(force_spectrum=spectrum).key == f"noise.force_spectrum.{key}"


def test_a_shape_without_a_size_is_refused():
    robot = load_run("palida").robot.description.model_copy(update={"noise": None})
    with pytest.raises(InputError) as caught:
        load_run(RUN | {"robot": robot, "noise": {"force_spectrum": {"ar": 0.5}}})
    assert caught.value.problems[0].key == "noise.force_spectrum"


ONES = [1.0] * 6


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ([[0, *ONES], [100, *ONES[:5], -1], [500, *ONES]], 3),
        ([[0, *ONES], [100, *ONES[:5], "x"], [500, *ONES]], 3),
        ([[0, *ONES], [100, *ONES], [500, *ONES[:5]]], 4),
        ([[0, *ONES], [0, *ONES], [500, *ONES]], None),
        ([[0, *ONES]], None),
    ],
)
def test_files_that_are_no_spectrum_are_refused_with_their_place(tmp_path, rows, line):
    path = _file(tmp_path, rows)
    problem = _refused(force_spectrum=str(path))
    assert problem.file == path
    assert problem.line == line


@pytest.mark.parametrize("given", ["pink", "none.csv", {"file": "none.csv"}])
def test_what_is_no_file_is_refused_where_it_is_named(tmp_path, monkeypatch, given):
    monkeypatch.chdir(tmp_path)
    problem = _refused(length_spectrum=given)
    assert problem.key == "noise.length_spectrum"
    named = given if isinstance(given, str) else given["file"]
    assert str(tmp_path / named) in problem.message
    assert "white" in problem.allowed


def test_nothing_is_no_spectrum_but_white_is_one(tmp_path):
    assert _refused(force_spectrum={}).key == "noise.force_spectrum"
    path = tmp_path / "run.yaml"
    path.write_text(resolved_yaml(load_run(RUN | {"noise": {"force_spectrum": "white"}})), "utf-8")
    assert load_run(path).robot.noise.force_spectrum is None


def test_what_only_a_resolved_file_has_is_not_offered():
    unknown, no_mapping = _refused(force_spectrum={"tabel": 1}), _refused(force_spectrum=5)
    for problem in (unknown, no_mapping):
        offered = re.findall(r"\w+", problem.allowed)
        assert {"ar", "band", "file", "hum"} <= set(offered)
        assert "table" not in offered
    assert unknown.nearest != "table"


def test_a_hum_that_the_sampling_cannot_hold_is_refused(tmp_path):
    hum = {"hum": [{"frequency": 50, "amplitude": 1}, {"frequency": 600, "amplitude": 1}]}
    assert _refused(force_spectrum=hum).key == "noise.force_spectrum.hum[2].frequency"
    assert _noise(length_std=STD, length_spectrum={"hum": hum["hum"][:1]}).length_spectrum
    run = RUN | {"noise": {"force_spectrum": hum}, "experiment": {"sampling": "1.25 kHz"}}
    assert load_run(run).robot.noise.force_spectrum
    # Where it stands in the robot file, that is the place to look at.
    robot = load_run("palida").robot.description.model_dump(mode="json", by_alias=True)
    robot["noise"]["force_spectrum"] = hum
    path = tmp_path / "robot.yaml"
    path.write_text(json.dumps(robot), encoding="utf-8")
    for place in ({"robot": str(path)}, {"experiment": {"truth": str(path)}}):
        with pytest.raises(InputError) as caught:
            load_run(RUN | place)
        (problem,) = caught.value.problems
        assert (problem.file, problem.key) == (path, "noise.force_spectrum.hum[2].frequency")


def test_missing_columns_are_named(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("f,S\n1,2\n", encoding="utf-8")
    assert _refused(force_spectrum=str(path)).line == 1


def test_a_sampling_beyond_what_was_measured_is_refused(tmp_path):
    noise = {"force_spectrum": str(_flat(tmp_path))}
    with pytest.raises(InputError) as caught:
        load_run(RUN | {"noise": noise, "experiment": {"sampling": "2 kHz"}})
    assert caught.value.problems[0].key == "experiment.sampling"
