"""Time columns that count from a date: numbers since an epoch and stamps of ISO 8601."""

from datetime import UTC, datetime, timedelta, timezone

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from tests.data.recordings import STEP, recording, write_csv

BEGIN = 1_764_212_345_123_456_789
NANOSECONDS = BEGIN + np.round(recording().t * 1e9).astype(np.int64)


def _text(nanoseconds, unit):
    """Return integer nanoseconds in a unit, exact."""
    digits = {"s": 9, "ms": 6, "us": 3, "ns": 0}[unit]
    whole, rest = divmod(int(nanoseconds), 10**digits)
    return f"{whole}.{rest:0{digits}d}" if digits else str(whole)


def _iso(nanoseconds, separator="T", zone=UTC, end="Z", mark=".", digits=9):
    seconds, rest = divmod(int(nanoseconds), 10**9)
    text = datetime.fromtimestamp(seconds, UTC).astimezone(zone).strftime(f"%Y-%m-%d{separator}%X")
    return f"{text}{mark}{rest:09d}"[: len(text) + 1 + digits] + end


EAST = timezone(timedelta(hours=5, minutes=30))
STAMPS = {
    "UTC": {},
    "blank": {"separator": " ", "end": ""},
    "offset": {"zone": EAST, "end": "+05:30"},
    "offset without colon": {"zone": EAST, "end": "+0530", "separator": " "},
    "offset after a blank": {"zone": EAST, "end": " +05:30"},
    "comma": {"mark": ",", "separator": " ", "end": ""},
}


def _written(path, times, rec, name="t", **options):
    frame = rec.frame
    frame["t"] = times
    frame.rename(columns={"t": name}).to_csv(path, index=False, **options)
    return path


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("form", STAMPS)
def test_stamps_of_iso_8601(form, decimal, tmp_path, rec, read):
    times = [_iso(time, **STAMPS[form]) for time in NANOSECONDS]
    path = _written(tmp_path / "m.csv", times, rec, "Zeit [UTC]", sep=";", decimal=decimal)
    found = read(path, delimiter=";", decimal=decimal, columns={"t": "Zeit"})
    assert found.time == pytest.approx(rec.t, rel=0, abs=1e-12)
    assert np.array_equal(found.forces, rec.Q)
    assert found.jitter < 1e-9
    assert found.warnings == ()


@pytest.mark.parametrize(("digits", "jitter"), [(6, 1e-3), (3, 1e-9)])
def test_stamps_with_fewer_digits(digits, jitter, tmp_path, rec, read):
    times = [_iso(time, digits=digits) for time in NANOSECONDS]
    found = read(_written(tmp_path / "m.csv", times, rec))
    assert found.time == pytest.approx(rec.t, rel=0, abs=1e-6)
    assert found.jitter < jitter


def test_times_of_day(tmp_path, rec, read):
    times = [_iso(time)[11:-1] for time in NANOSECONDS]
    found = read(_written(tmp_path / "m.csv", times, rec))
    assert found.time == pytest.approx(rec.t, rel=0, abs=1e-12)


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_numbers_since_1970(unit, stated, tmp_path, rec, read):
    """Doubles of them would be off by 128 ns, of a step of 1 ms."""
    path = _written(tmp_path / "m.csv", [_text(time, unit) for time in NANOSECONDS], rec)
    found = read(path, units={"t": unit} if stated else {}, start=3.1e-3)
    assert found.time == pytest.approx(rec.t[4:], rel=0, abs=1e-12)
    assert found.jitter < 1e-9
    assert len(found.warnings) == (not stated and unit != "s")
    assert all(f"data.units: {{t: {unit}}}" in warning for warning in found.warnings)


def test_quotes_exponents_and_commas(tmp_path, rec, read):
    times = [f"{time // 10**6},{time % 10**6:06d}E3" for time in NANOSECONDS]
    path = _written(tmp_path / "m.csv", times, rec, sep=";", decimal=",", quoting=1)
    found = read(path, delimiter=";", decimal=",", units={"t": "us"})
    assert found.time == pytest.approx(rec.t, rel=0, abs=1e-12)


def test_a_counter_keeps_its_zero(tmp_path, rec, read):
    """Microseconds since the controller was switched on: `start` counts from there."""
    path = _written(tmp_path / "m.csv", (250_000_000 + 1000 * np.arange(60)).astype(str), rec)
    found = read(path, units={"t": "us"}, start=250.01)
    assert found.time == pytest.approx(250 + rec.t[10:], rel=0, abs=1e-9)


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("kind", [np.int64, np.uint64])
def test_integers_of_other_files(kind, tmp_path, rec, read):
    columns = rec.columns | {"t": NANOSECONDS.astype(kind)}
    savemat(tmp_path / "m.mat", columns)
    with h5py.File(tmp_path / "m.h5", "w") as file:
        for name, values in columns.items():
            file[name] = values
    for path in (tmp_path / "m.mat", tmp_path / "m.h5"):
        found = read(path, units={"t": "ns"})
        assert found.time == pytest.approx(rec.t, rel=0, abs=1e-12)
        assert found.jitter < 1e-9


def test_stamps_of_another_form_are_one_fault(tmp_path, rec, refused):
    times = [f"27.11.2026 10:15:{1e-3 * row:06.3f}" for row in range(60)]
    (problem,) = refused(_written(tmp_path / "m.csv", times, rec))
    assert (problem.line, problem.key) == (2, "t")
    assert problem.message == "'27.11.2026 10:15:00.000' is not a finite number"
    assert "ISO 8601 such as 2026-11-27T10:15:00.123Z, all in one form" in problem.allowed


def test_a_wrong_stamp_among_others(tmp_path, rec, refused):
    times = [_iso(time) for time in NANOSECONDS]
    times[7] = "2026-13-45T10:15:00Z"
    (problem,) = refused(_written(tmp_path / "m.csv", times, rec))
    assert (problem.line, problem.key) == (9, "t")
    assert "2026-13-45" in problem.message


ODD = {
    "fraction of a minute": ("2026-11-27T10:15.5Z", 7),
    "hour 24": ("2026-11-27T24:00:00Z", 7),
    "time without date": ("10:15:00Z", 7),
    "date without zone": ("2026-11-27T10:15:00", 7),
    "first cell without zone": ("2026-11-27T10:15:00", 0),
}


@pytest.mark.parametrize("case", ODD)
def test_stamps_of_several_forms(case, tmp_path, rec, refused):
    """Read as they are they would be minutes, a day or the offset of a zone away."""
    text, row = ODD[case]
    times = [_iso(time) for time in NANOSECONDS]
    times[row] = text
    problem = refused(_written(tmp_path / "m.csv", times, rec))[0]
    assert (problem.line, problem.key) == (row + 2 if row else 3, "t")
    assert "is not a finite number" in problem.message


def test_stamps_that_go_back_name_both_lines(tmp_path, rec, refused):
    """An hour that a summer time has twice."""
    times = [_iso(time - (row > 30) * 3600 * 10**9) for row, time in enumerate(NANOSECONDS)]
    (problem,) = refused(_written(tmp_path / "m.csv", times, rec))
    assert "time goes back from line 32" in problem.message


def test_a_unit_that_stamps_contradict(tmp_path, rec, refused):
    path = _written(tmp_path / "m.csv", [_iso(time) for time in NANOSECONDS], rec)
    (problem,) = refused(path, units={"t": "ms"})
    assert "the file says that t is in 's', data.units says 'ms'" in problem.message


def test_an_ordinary_time_is_as_before(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    rec.t = rec.t + 5.25
    write_csv(path, rec)
    assert read(path).time == pytest.approx(rec.t, rel=0, abs=STEP * 1e-9)
