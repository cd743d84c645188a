"""Every format gives the same recording, and damaged files of every format are refused."""

import sys

import numpy as np
import pytest

from estimation.data.reading import file_formats, format_of
from expdesign.configuration import FORCE_CHANNELS, LENGTH_CHANNELS, InputError
from expdesign.runfolder.manifest import Manifest, entry
from tests.data.recordings import WRITERS

BINARY = [name for name in WRITERS if name not in ("recording.csv", "recording")]
OPTIONAL = {
    "recording73.mat": ("h5py", "mat73"),
    "recording.h5": ("h5py", "hdf5"),
    "recording.mf4": ("asammdf", "mdf"),
    "recording.mcap": ("rosbags", "ros"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_round_trip(name, tmp_path, rec, read):
    path = tmp_path / name
    WRITERS[name](path, rec)
    found = read(path)
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces, rec.Q)
    assert found.time == pytest.approx(rec.t, abs=1e-12)
    assert found.step == pytest.approx(1e-3, rel=1e-12)
    assert found.jitter < 1e-9
    assert (found.period, found.stamped, found.warnings) == (None, False, ())
    assert found.source == str(path)


def test_each_format_is_a_file_with_its_own_title():
    titles = [found.title for found in file_formats()]
    assert len(set(titles)) == len(titles) == 7


@pytest.mark.parametrize("name", WRITERS)
def test_one_format_claims_a_file(name, tmp_path, rec):
    WRITERS[name](tmp_path / name, rec)
    assert sum(found.claims(tmp_path / name) for found in file_formats()) == 1


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("name", BINARY)
def test_truncated_files_are_refused(name, tmp_path, rec, refused):
    path = tmp_path / name
    WRITERS[name](path, rec)
    data = path.read_bytes()
    for size in (0, len(data) // 2):
        path.write_bytes(data[:size])
        assert refused(path)


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("name", BINARY)
def test_noise_is_refused(name, tmp_path, refused):
    path = tmp_path / name
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    (problem,) = refused(path)
    assert "the file is damaged or not of the format" in problem.message


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("name", BINARY)
def test_wrong_bytes_never_end_in_a_traceback(name, tmp_path, rec, read):
    path = tmp_path / name
    WRITERS[name](path, rec)
    data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(7)
    refusals = 0
    for _ in range(3):
        wrong = data.copy()
        wrong[rng.integers(0, len(data), 25)] = rng.integers(0, 256, 25)
        path.write_bytes(wrong.tobytes())
        try:
            read(path)
        except InputError:
            refusals += 1
    assert refusals


@pytest.mark.parametrize("name", OPTIONAL)
def test_a_missing_extra_is_named(name, tmp_path, rec, refused, monkeypatch):
    library, extra = OPTIONAL[name]
    path = tmp_path / name
    WRITERS[name](path, rec)
    monkeypatch.setitem(sys.modules, library, None)
    (problem,) = refused(path)
    assert library in problem.message
    assert problem.allowed == f"after: pip install expdesign[{extra}]"


def test_what_is_no_recording(tmp_path, refused):
    assert refused(tmp_path / "absent.csv")[0].message == "there is no such file"
    assert "not a rosbag2 recording" in refused(tmp_path)[0].message
    other = tmp_path / "recording.xlsx"
    other.touch()
    (problem,) = refused(other)
    assert "'.xlsx'" in problem.message
    assert ".mf4" in problem.allowed


def test_no_permission(tmp_path, rec, refused, monkeypatch):
    path = tmp_path / "secret.csv"
    WRITERS["recording.csv"](path, rec)

    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", denied)
    assert refused(path)[0].message == "there is no permission to read it"


def test_a_mat_file_is_told_by_its_content(tmp_path, rec):
    for name in ("recording.mat", "recording73.mat"):
        WRITERS[name](tmp_path / name, rec)
    titles = [format_of(tmp_path / name).title for name in ("recording.mat", "recording73.mat")]
    assert titles == ["MATLAB up to v7", "MATLAB v7.3"]


@pytest.mark.parametrize(
    ("name", "stage", "words"),
    [
        ("trajectory.csv", "design", "a designed motion, whose forces are computed"),
        ("estimates.csv", "estimate", "a result of `estimate`"),
        ("exports/csv.csv", "", "a controller table, which has no measured forces"),
    ],
)
def test_a_result_of_a_run_folder_is_not_a_recording(tmp_path, name, stage, words):
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(",".join(("t", *LENGTH_CHANNELS, *FORCE_CHANNELS)))
    about = Manifest.new({}, "")
    if stage:
        about = about.with_stage(stage, entry("done", "", 0.0, "", tmp_path, [file]))
    else:
        about = about.with_added(tmp_path, [file], {})
    about.write(tmp_path)
    with pytest.raises(InputError) as caught:
        format_of(file)
    (problem,) = caught.value.problems
    assert problem.file == file
    assert words in problem.message
    assert "not a recording" in problem.message


def test_the_manifest_of_another_program_refuses_no_recording(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t")
    (tmp_path / "manifest.json").write_text('{"format": 99, "stages": {}}')
    assert ".csv" in format_of(file).extensions


def test_the_recording_of_a_run_folder_is_one(tmp_path):
    file = tmp_path / "measurement.csv"
    file.write_text("t")
    made = entry("done", "", 0.0, "", tmp_path, [file])
    Manifest.new({}, "").with_stage("experiment", made).write(tmp_path)
    assert ".csv" in format_of(file).extensions
