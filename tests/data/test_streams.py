"""Two files of one recording: stamps and rates of their own, and none at all."""

import numpy as np
import pandas as pd
import pytest

from estimation.data.reading import read_measurement
from estimation.data.streams import resample
from estimation.identification import estimate_parameters
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import DataSection, InputError
from tests.estimation.cases import ROBOT, run, trajectory

START = 1764238500.0
MOTION = trajectory()
PERIODS = 5


def _sampled(times, seed=None):
    """Return lengths and forces of the motion at times of their own, with the robot's noise."""
    states, noise = MOTION.sample(times), ROBOT.description.noise
    lengths = ROBOT.inverse_kinematics(states.pose)
    forces = ROBOT.actuator_forces(states.pose, states.rate, states.acceleration)
    if seed is None:
        return lengths, forces
    rng = np.random.default_rng(seed)
    draws = [
        rng.normal(size=(len(times), 6)) @ np.linalg.cholesky(each).T
        for each in (noise.length_covariance, noise.force_covariance)
    ]
    return lengths + draws[0], forces + draws[1]


def _write(folder, name, columns, time, values):
    table = pd.DataFrame(values, columns=columns)
    if time is not None:
        table.insert(0, "stamp", time)
    table.to_csv(folder / name, index=False, float_format="%.17g")
    return str(folder / name)


def _files(folder, of_lengths, of_forces, *, seed=None, dates=None):
    q, _ = _sampled(of_lengths, seed)
    _, forces = _sampled(of_forces, None if seed is None else seed + 1000)
    shown = [of_lengths, of_forces]
    if dates is not None:
        nanoseconds = [np.round((START + each) * 1e6).astype(np.int64) for each in shown]
        shown = [
            pd.to_datetime(each, unit="us").strftime(f"{dates}%H:%M:%S.%fZ") for each in nanoseconds
        ]
    joints = [f"Joint_{j}" for j in range(1, 7)]
    files = {
        "lengths": _write(folder, "position.csv", joints, shown[0], q),
        "forces": _write(folder, "effort.csv", joints, shown[1], forces),
    }
    columns = {"t": "stamp"}
    columns |= {f"{letter}{j}": f"Joint_{j}" for letter in "qQ" for j in range(1, 7)}
    return {"files": files, "columns": columns}


def _read(section):
    checked = DataSection.model_validate(section)
    return read_measurement(section["files"]["lengths"], checked, ROBOT)


def _grid(rate, begin=0.0):
    return begin + np.arange(round((PERIODS * MOTION.period + 0.1) * rate)) / rate


def test_a_spline_keeps_what_is_slow():
    rng = np.random.default_rng(2)
    times, at = (
        np.arange(2000) / 1000 + rng.uniform(-3e-4, 3e-4, 2000),
        np.linspace(0.01, 1.99, 400),
    )
    values = np.stack([times**3 - times, np.sin(2 * np.pi * 10 * times)], axis=1)
    found = resample(times, values, at)
    np.testing.assert_allclose(found[:, 0], at**3 - at, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.sin(2 * np.pi * 10 * at), atol=2e-4)
    np.testing.assert_allclose(resample(at, found, at), found, atol=1e-9)


@pytest.mark.parametrize("dates", [None, "%Y-%m-%dT", ""])
@pytest.mark.parametrize(("of_lengths", "of_forces"), [(1000, 250), (200, 720), (250, 250)])
def test_two_rates_meet_at_the_lower_one(tmp_path, of_lengths, of_forces, dates):
    section = _files(tmp_path, _grid(of_lengths), _grid(of_forces, 0.0123), dates=dates)
    found = _read(section)
    assert 1 / found.step == pytest.approx(min(of_lengths, of_forces), rel=1e-6)
    begin = 0.0 if of_lengths <= of_forces else 0.0123
    moved = found.time + (
        begin - found.time[0] + np.ceil(0.0123 * of_lengths) / of_lengths * (begin == 0)
    )
    q, forces = _sampled(moved)
    inner = slice(5, -5)
    np.testing.assert_allclose(found.lengths[inner], q[inner], atol=2e-6)
    assert np.median(np.abs(found.forces - forces)) < 0.05
    (remark, *_) = found.warnings
    assert remark == (
        f"lengths at {of_lengths} Hz, forces at {of_forces} Hz, forces begin 12.3 ms later; "
        f"combined at the times of the {'forces' if of_forces < of_lengths else 'lengths'}"
    )


def test_a_file_that_begins_earlier_and_ends_later_or_covers_a_gap_is_as_exact(tmp_path):
    """Forces of half the time, with 0.4 s missing: the lengths are those of the machine there."""
    of_forces = _grid(250, 1.3)
    of_forces = of_forces[: len(of_forces) // 2]
    of_forces = np.delete(of_forces, np.s_[300:330])
    found = _read(_files(tmp_path, _grid(1000), of_forces))
    assert found.lost == 30
    assert len(found) == len(of_forces)
    np.testing.assert_allclose(found.lengths, _sampled(of_forces)[0], atol=1e-7)


@pytest.mark.parametrize("rows", [1020, 1030, 1050])
def test_period_numbers_of_lengths_at_more_samples(tmp_path, rows):
    """The first rows have the same time up to the rounding of two fitted grids."""
    section = _files(tmp_path, np.arange(rows) / 1000, np.arange(rows // 4) / 250)
    table = pd.read_csv(section["files"]["lengths"])
    table["period"] = np.arange(rows) // 200
    table.to_csv(section["files"]["lengths"], index=False, float_format="%.17g")
    found = _read(section)
    np.testing.assert_array_equal(found.period, 4 * np.arange(len(found)) // 200)


@pytest.mark.parametrize("rates", [(500, 250), (250, 500)])
def test_a_length_out_of_range_names_the_file_of_the_lengths(tmp_path, rates):
    section = _files(tmp_path, *(_grid(rate) for rate in rates)) | {"offset": 700}
    with pytest.raises(InputError) as error:
        _read(section)
    assert {problem.file.name for problem in error.value.problems} == {"position.csv"}


def test_a_late_beginning_of_one_file_doubts_the_clocks(tmp_path):
    (remark, *_) = _read(_files(tmp_path, _grid(500), _grid(500, 0.056))).warnings
    assert "forces begin 56 ms later" in remark
    assert "clocks" in remark
    assert "data.delay" in remark


def test_an_estimate_of_two_files(tmp_path):
    rng = np.random.default_rng(4)
    late = _grid(300, 0.004)
    late += rng.uniform(-0.3, 0.3, len(late)) / 300
    section = _files(tmp_path, _grid(500), late, seed=3) | {"time": "stamped"}
    found = _read(section)
    assert "forces at 300" in found.warnings[0]
    assert "with a jitter of" in found.warnings[0]
    estimate = estimate_parameters(run({"estimators": ["gm"], "harmonics": 2}), found, MOTION)
    gm = estimate["gm"]
    off = (gm.values - ROBOT.parameters) / np.sqrt(np.diag(gm.covariance))
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_files_without_a_time_have_the_sampling_frequency(tmp_path):
    section = _files(tmp_path, _grid(500), _grid(500))
    for file in section["files"].values():
        pd.read_csv(file).drop(columns="stamp").to_csv(file, index=False, float_format="%.17g")
    del section["columns"]["t"]
    found = _read(section | {"sampling": "500 Hz"})
    assert found.step == pytest.approx(0.002, rel=1e-9)
    q, forces = _sampled(_grid(500))
    np.testing.assert_allclose(found.lengths, q, atol=1e-12)
    np.testing.assert_allclose(found.forces, forces, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"begin": 100.0}, "the files have no time in common"),
        ({"cell": np.nan}, "the cell is empty"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path, changes, message):
    section = _files(tmp_path, _grid(500), _grid(500, changes.get("begin", 0.0)))
    if "cell" in changes:
        table = pd.read_csv(section["files"]["forces"])
        table.loc[7, "Joint_3"] = np.nan
        table.to_csv(section["files"]["forces"], index=False)
    with pytest.raises(InputError) as caught:
        _read(section)
    assert message in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_intervals_of_estimates_from_two_files_cover(tmp_path, jitter):
    """Rates of their own, forces late by −4 to 12 ms, stamps with jitter (parts of a step)."""
    held, lags = [], []
    for seed in range(20):
        rng = np.random.default_rng([7, seed])
        late, of_forces = rng.uniform(-4e-3, 12e-3), _grid(250)
        of_forces += jitter * rng.uniform(-1, 1, len(of_forces)) / 250
        section = _files(tmp_path, _grid(500), of_forces, seed=seed)
        if jitter:
            section["time"] = "stamped"
        table = pd.read_csv(section["files"]["forces"])
        table["stamp"] += late
        table.to_csv(section["files"]["forces"], index=False, float_format="%.17g")
        case = run({"estimators": ["ml"], "harmonics": 2}, tolerances={"delay": "10 ms"})
        found = estimate_parameters(case, _read(section), MOTION)["ml"]
        (lag,) = (one for one in found.systematic.deviations if one.name == "delay")
        lags.append((lag.value - late) / lag.std)
        widths = interval_widths(found.freedom) * found.std
        held.append(np.mean(np.abs(found.values - ROBOT.parameters) < widths))
    assert abs(np.mean(held) - 0.95) < 3 * np.std(held) / np.sqrt(len(held))
    assert 0.6 < np.sqrt(np.mean(np.square(lags))) < 1.4
    assert np.max(np.abs(lags)) < 3.5
