"""MDF 4: groups, time of their masters, units, invalid samples."""

import numpy as np
import pytest
from asammdf import MDF, Signal

from estimation.data.readers import mdf
from expdesign.configuration import DataSection, InputError
from tests.data.recordings import write_mdf

pytestmark = pytest.mark.usefixtures("forked")


def _write(path, *groups):
    with MDF(version="4.10") as file:
        for group in groups:
            file.append(group)
        file.save(path, overwrite=True)


def _signals(rec, kinds="qQ", unit="", factor=1.0, name="{}"):
    return [
        Signal(values * factor, rec.t, name=name.format(channel), unit=unit)
        for channel, values in rec.columns.items()
        if channel[0] in kinds
    ]


def _problems(path, **section):
    with pytest.raises(InputError) as caught:
        mdf.read(path, DataSection(**section))
    return caught.value.problems


def test_units_of_the_channels_are_used(tmp_path, rec, read, refused):
    path = tmp_path / "m.mf4"
    _write(path, _signals(rec, "q", "mm", 1e3) + _signals(rec, "Q", "A", 0.01))
    assert "force constants" in refused(path)[0].message
    found = read(path, force_constants=100)
    assert found.lengths == pytest.approx(rec.q, rel=1e-14)
    assert found.forces == pytest.approx(rec.Q, rel=1e-14)
    assert "data.units says 'm'" in refused(path, force_constants=100, units={"q": "m"})[0].message


def test_groups_with_the_same_time_are_one_recording(tmp_path, rec):
    path = tmp_path / "m.mf4"
    _write(path, _signals(rec, "q"), _signals(rec, "Q"))
    table = mdf.read(path, DataSection())
    assert np.array_equal(table.values["Q5"], rec.Q[:, 4])
    assert np.array_equal(table.values["t"], rec.t)


def test_groups_with_other_times_are_refused(tmp_path, rec):
    path = tmp_path / "m.mf4"
    slow = [Signal(s.samples[::2], s.timestamps[::2], name=s.name) for s in _signals(rec, "Q")]
    _write(path, _signals(rec, "q"), slow)
    problems = _problems(path)
    assert [problem.key for problem in problems] == [f"Q{j}" for j in range(1, 7)]
    assert problems[0].message == (
        "the channel was recorded at other times (30 samples) than 'q1' (60 samples)"
    )


def test_a_name_in_several_groups_needs_its_group(tmp_path, rec):
    path = tmp_path / "m.mf4"
    double = [Signal(s.samples * 2, s.timestamps, name=s.name) for s in _signals(rec)]
    _write(path, double, _signals(rec))
    problems = _problems(path)
    assert problems[0].message == "several columns could be q1"
    assert "'0/q1', '1/q1'" in problems[0].allowed
    columns = {c: f"1/{c}" for c in rec.columns if c != "t"}
    table = mdf.read(path, DataSection(columns=columns))
    assert np.array_equal(table.values["q1"], rec.q[:, 0])


def test_time_may_be_a_channel(tmp_path, rec):
    path = tmp_path / "m.mf4"
    clock = Signal(rec.t * 1e3 + 5, rec.t, name="controller clock", unit="ms")
    _write(path, [*_signals(rec), clock])
    table = mdf.read(path, DataSection(columns={"t": "controller clock"}))
    assert np.array_equal(table.values["t"], rec.t * 1e3 + 5)
    assert table.columns["t"].unit == "ms"


def test_invalid_samples_and_texts_are_defects(tmp_path, rec, refused):
    path = tmp_path / "m.mf4"
    signals = _signals(rec)
    invalid = np.zeros(60, dtype=bool)
    invalid[16] = True
    signals[2] = Signal(rec.q[:, 2], rec.t, name="q3", invalidation_bits=invalid)
    _write(path, signals)
    (problem,) = refused(path)
    assert problem.key == "q3, sample 17"
    assert problem.message == "'marked invalid' is not a finite number"
    stamps = Signal(np.arange(60), rec.t, name="stamp", unit="ms", invalidation_bits=invalid)
    _write(path, [*_signals(rec), stamps])
    (problem,) = refused(path, columns={"t": "stamp"})
    assert problem.key == "stamp, sample 17"
    signals[2] = Signal(np.array([b"ok"] * 60), rec.t, name="q3", encoding="utf-8")
    _write(path, signals)
    problems = refused(path)
    assert problems[0].key == "q3, sample 1"
    assert problems[0].message == "'ok' is not a finite number"


def test_compressed_files_and_integers(tmp_path, rec, read):
    path = tmp_path / "m.mf4"
    rec.Q = np.round(rec.Q)
    with MDF(version="4.10") as file:
        integers = [
            Signal(s.samples.astype(np.int16), rec.t, name=s.name) for s in _signals(rec, "Q")
        ]
        file.append(_signals(rec, "q") + integers)
        file.save(path, overwrite=True, compression=2)
    assert np.array_equal(read(path).forces, rec.Q)


def test_missing_channel(tmp_path, rec):
    path = tmp_path / "m.mf4"
    write_mdf(path, rec)
    (problem,) = _problems(path, columns={"q2": "Q_2"})
    assert (problem.key, problem.file) == ("Q_2", path)
    assert problem.nearest == "q2"
