"""What an ended process has left is removed; what a living one writes is not."""

import os
import subprocess
import sys

import pytest

from expdesign.runfolder.files import remove_leftovers, temporary_prefix, write_text


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.fixture
def ended():
    """Return how names of a process that has ended begin."""
    code = "from expdesign.runfolder.files import temporary_prefix; print(temporary_prefix())"
    answer = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    return answer.stdout.strip()


def place_of(prefix):
    """Return the part of a name that stands for the computer."""
    return prefix.split("-")[1]


def test_what_an_ended_process_left_is_removed(tmp_path, ended):
    (tmp_path / f"{ended}x").write_text("half", encoding="utf-8")
    (tmp_path / f"{ended}folder").mkdir()
    (tmp_path / f"{ended}folder" / "table.csv").write_text("half", encoding="utf-8")
    # The same number in its turn, of the same computer.
    token = temporary_prefix().split("-")[3]
    again = temporary_prefix().replace(token, "0" * len(token))
    (tmp_path / f"{again}x").write_text("half", encoding="utf-8")
    remove_leftovers(tmp_path)
    assert names(tmp_path) == set()


def test_what_may_be_somebodys_stays(tmp_path, ended):
    living = f"{temporary_prefix()}x"
    parent = ended.replace(ended.split("-")[2], str(os.getppid())) + "x"
    elsewhere = ended.replace(place_of(ended), "0" * 8) + "x"
    others = {".expdesign-notes", ".hidden", "table.csv"}
    kept = {living, parent, elsewhere} | others
    for name in kept:
        (tmp_path / name).write_text("whole", encoding="utf-8")
    remove_leftovers(tmp_path)
    assert names(tmp_path) == kept
    # Unless nobody has touched it for long.
    os.utime(tmp_path / elsewhere, (0, 0))
    remove_leftovers(tmp_path)
    assert names(tmp_path) == kept - {elsewhere}


def test_whoever_writes_there_next_removes_it(tmp_path, ended):
    (tmp_path / f"{ended}x").write_text("half", encoding="utf-8")
    write_text(tmp_path / "file.txt", "whole")
    assert names(tmp_path) == {"file.txt"}


def test_a_folder_that_is_not_there_holds_nothing(tmp_path):
    remove_leftovers(tmp_path / "none")
    assert names(tmp_path) == set()
