"""Files of a run folder are complete or absent; abandoned temporary files are removed."""

import errno
import json
import os
import re
import stat
from dataclasses import dataclass

import numpy as np
import pytest

from expdesign.runfolder.files import (
    TEMPORARY,
    atomic_write,
    remove_leftovers,
    write_json,
    write_text,
)
from expdesign.runfolder.manifest import text_hash
from expdesign.runfolder.tables import write_csv


@dataclass(frozen=True)
class Point:
    x: float
    y: float


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_half_written_when_the_writer_raises(tmp_path, error):
    def write():
        with atomic_write(tmp_path / "new.txt") as temporary:
            temporary.write_text("half")
            raise error("in the middle")

    with pytest.raises(error):
        write()
    assert names(tmp_path) == []


@pytest.mark.parametrize("value", [object(), {1, 2}, Point(1.0, 2.0)])
def test_the_old_file_stays_when_the_writer_raises(tmp_path, value):
    path = tmp_path / "old.json"
    write_text(path, "old")
    with pytest.raises(TypeError, match=f"a {type(value).__name__} has no form in JSON"):
        write_json(path, {"fine": 1, "not": [value]})
    assert path.read_text() == "old"
    assert names(tmp_path) == ["old.json"]


def test_the_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "a" / "b" / "file.txt"
    with atomic_write(path) as temporary:
        temporary.write_text("first")
        assert not path.exists()
        assert temporary.parent == path.parent
        assert temporary.name.startswith(".")
    assert path.read_text() == "first"
    with atomic_write(path) as temporary:
        temporary.write_text("second")
        assert path.read_text() == "first"
    assert path.read_text() == "second"
    assert names(path.parent) == ["file.txt"]


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_permissions_are_those_of_ordinary_files(tmp_path, mask, mode):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "file.txt", "text")
        assert os.umask(mask) == mask
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file.txt").stat().st_mode) == mode


def test_numbers_that_json_does_not_have_become_null(tmp_path):
    path = tmp_path / "data.json"
    write_json(
        path,
        {
            "nan": float("nan"),
            "inside": [float("inf"), {"deep": -np.inf}],
            "array": np.array([[1.0, np.nan], [0.1, 2.0]]),
            "scalar": np.float64("nan"),
            "count": np.int64(3),
            "flag": np.bool_(True),
            "tuple": (1, None, "ω"),
            7: "key",
        },
    )

    def refuse(constant):
        raise AssertionError(constant)

    text = path.read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=refuse) == {
        "nan": None,
        "inside": [None, {"deep": None}],
        "array": [[1.0, None], [0.1, 2.0]],
        "scalar": None,
        "count": 3,
        "flag": True,
        "tuple": [1, None, "ω"],
        "7": "key",
    }
    assert text.endswith("\n")
    assert "ω" in text


def test_json_and_csv_keep_all_digits(tmp_path):
    values = np.random.default_rng(0).normal(size=50) * 10.0 ** np.arange(-25, 25)
    write_json(tmp_path / "data.json", values)
    assert json.loads((tmp_path / "data.json").read_text()) == values.tolist()
    write_csv(tmp_path / "data.csv", ["value"], values[:, None].tolist())
    lines = (tmp_path / "data.csv").read_bytes().decode().split("\n")
    assert lines[0] == "value"
    assert [float(line) for line in lines[1:-1]] == values.tolist()
    assert lines[-1] == ""


def test_an_error_of_the_system_names_the_file_and_leaves_nothing(tmp_path):
    path = tmp_path / "table.csv"

    def write(name):
        with atomic_write(path):
            raise OSError(errno.ENOSPC, "full", name)

    for name in (None, str(tmp_path / "temporary")):
        with pytest.raises(OSError, match=re.escape(str(path))) as caught:
            write(name)
        assert caught.value.errno == errno.ENOSPC
    with pytest.raises(OSError, match="other") as caught:
        write("/elsewhere/other.csv")
    assert caught.value.filename == "/elsewhere/other.csv"
    assert names(tmp_path) == []


def half_written(folder):
    """Write what a killed process leaves, and files that only look like it; return both."""
    left, others = {f"{TEMPORARY}x", f"{TEMPORARY}folder"}, {".expdesign-notes", ".hidden", "a.csv"}
    (folder / f"{TEMPORARY}folder").mkdir()
    for name in ({f"{TEMPORARY}x", f"{TEMPORARY}folder/table.csv"}) | others:
        (folder / name).write_text("half", encoding="utf-8")
    return left, others


def test_temporary_files_in_a_locked_folder_are_removed(tmp_path):
    _, others = half_written(tmp_path)
    remove_leftovers(tmp_path, locked=True)
    assert names(tmp_path) == sorted(others)


def test_temporary_files_that_others_may_write_stay_for_a_day(tmp_path):
    left, others = half_written(tmp_path)
    remove_leftovers(tmp_path)
    assert names(tmp_path) == sorted(left | others)
    for name in left | others:
        os.utime(tmp_path / name, (0, 0))
    remove_leftovers(tmp_path)
    assert names(tmp_path) == sorted(others)


def test_the_next_file_in_the_folder_removes_them(tmp_path):
    left, others = half_written(tmp_path)
    for name in left:
        os.utime(tmp_path / name, (0, 0))
    write_text(tmp_path / "file.txt", "whole")
    assert names(tmp_path) == sorted({*others, "file.txt"})


def test_a_missing_folder_has_no_temporary_files(tmp_path):
    remove_leftovers(tmp_path / "none", locked=True)
    assert names(tmp_path) == []


def test_a_hash_of_texts_depends_on_their_borders():
    assert text_hash("ab", "c") != text_hash("a", "bc")
    assert text_hash("a") != text_hash("a", "")
    assert text_hash("a", 1) == text_hash("a", 1)
