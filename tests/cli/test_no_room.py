"""Disks that are full, folders that cannot be written to: a plain message, and no half file."""

import errno
import json
import os
import resource
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

MEGABYTE = 2**20


@contextmanager
def files_of_at_most(size):
    """Let the system refuse longer files, as it refuses them on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def run_file(tiny, tmp_path):
    """Return a run whose recording has some megabytes."""
    path = tmp_path / "run.yaml"
    run = tiny(experiment={"sampling": 1000, "periods": 10})
    path.write_text(json.dumps(run), encoding="utf-8")
    return path


@pytest.fixture
def folder(tiny_result, tmp_path):
    """Return a run folder that holds a design."""
    out = tmp_path / "out"
    tiny_result.write(out)
    return out


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_disk_that_becomes_full(expdesign, run_file, folder):
    before = files(folder)
    with files_of_at_most(2 * MEGABYTE):
        status, _, messages = expdesign("simulate", run_file, "--out", folder)
    assert status == 1
    assert "measurement.csv: " in messages
    assert "Traceback" not in messages
    after = files(folder)
    assert set(after) - set(before) <= {"truth.json"}
    assert all(after[name] == before[name] for name in before if name != "columns.json")
    # With room it is done.
    assert expdesign("simulate", run_file, "--out", folder)[0] == 0
    assert (folder / "measurement.csv").stat().st_size > 2 * MEGABYTE


def test_a_disk_that_is_full_is_told_before_the_work(expdesign, run_file, folder, monkeypatch):
    monkeypatch.setattr(
        "expdesign.stages.registry.ExperimentStage.functions", lambda _: pytest.fail("it began")
    )
    before = files(folder)
    with files_of_at_most(MEGABYTE // 2):
        status, answer, _ = expdesign("simulate", run_file, "--out", folder, "--json")
    assert status == 1
    assert str(folder) in json.loads(answer)["message"]
    assert files(folder) == before


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EDQUOT, errno.EIO])
def test_a_folder_that_nothing_can_be_written_to(expdesign, run_file, folder, monkeypatch, number):
    def refuse(**options):
        raise OSError(number, os.strerror(number), str(Path(options["dir"]) / "temporary"))

    before = files(folder)
    monkeypatch.setattr(tempfile, "mkstemp", refuse)
    status, _, messages = expdesign("simulate", run_file, "--out", folder)
    assert status == 1
    assert os.strerror(number) in messages
    assert "temporary" not in messages
    assert files(folder) == before


def command(*arguments, **streams):
    return subprocess.run(
        [sys.executable, "-c", "from expdesign.cli import main; main()", *arguments],
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        **streams,
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no such device")
def test_results_and_messages_that_nobody_takes():
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        lost = command("robots", stdout=full, stderr=subprocess.PIPE)
        assert lost.returncode == 1
        assert "failed: " in lost.stderr
        assert "Traceback" not in lost.stderr
        assert "Exception" not in lost.stderr
        # Messages are no reason to fail.
        silent = command("check", "palida", stdout=subprocess.PIPE, stderr=full)
    assert silent.returncode == 0
    assert "palida" in silent.stdout
