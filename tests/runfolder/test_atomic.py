import errno
import json
import os
import re
import stat

import numpy as np
import pandas as pd
import pytest

from expdesign.runfolder.files import atomic_write, write_csv, write_json, write_text


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_half_written_when_the_writer_raises(tmp_path, error):
    def write():
        with atomic_write(tmp_path / "new.txt") as beside:
            beside.write_text("half")
            raise error("in the middle")

    with pytest.raises(error):
        write()
    assert names(tmp_path) == []


def test_what_was_there_stays_when_the_writer_raises(tmp_path):
    path = tmp_path / "old.json"
    write_text(path, "old")
    with pytest.raises(TypeError):
        write_json(path, {"fine": 1, "not": object()})
    assert path.read_text() == "old"
    assert names(tmp_path) == ["old.json"]


def test_the_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "a" / "b" / "file.txt"
    with atomic_write(path) as beside:
        beside.write_text("first")
        assert not path.exists()
        assert beside.parent == path.parent
        assert beside.name.startswith(".")
    assert path.read_text() == "first"
    with atomic_write(path) as beside:
        beside.write_text("second")
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


def test_json_has_no_numbers_that_json_does_not_know(tmp_path):
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
    write_csv(tmp_path / "data.csv", pd.DataFrame({"value": values}))
    lines = (tmp_path / "data.csv").read_bytes().decode().split("\n")
    assert lines[0] == "value"
    assert [float(line) for line in lines[1:-1]] == values.tolist()
    assert lines[-1] == ""


def test_an_error_of_the_system_names_the_file_and_leaves_nothing(tmp_path):
    path = tmp_path / "table.csv"

    def write(name):
        with atomic_write(path):
            raise OSError(errno.ENOSPC, "full", name)

    for name in (None, str(tmp_path / "what-stands-for-it")):
        with pytest.raises(OSError, match=re.escape(str(path))) as caught:
            write(name)
        assert caught.value.errno == errno.ENOSPC
    with pytest.raises(OSError, match="other") as caught:
        write("/elsewhere/other.csv")
    assert caught.value.filename == "/elsewhere/other.csv"
    assert names(tmp_path) == []
