"""Two commands on one folder: the second is refused, and never is a folder of both."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from expdesign.configuration import ComputationError, InputError
from expdesign.runfolder.lock import (
    LOCK,
    Holder,
    consistent_reading,
    is_empty,
    one_writer,
    one_writer_to,
)
from expdesign.runfolder.manifest import Manifest, file_hash
from tests.killed_runs import environment
from tests.tiny_run import tiny_run


def test_the_second_writer_is_refused_with_the_first(tmp_path):
    folder = tmp_path / "run"
    with one_writer(folder, "expdesign design"):
        assert is_empty(folder)
        with pytest.raises(InputError) as caught, one_writer(folder, "expdesign run"):
            pytest.fail("it is held")
    (problem,) = caught.value.problems
    assert problem.file == folder
    for part in ("`expdesign design`", f"process {os.getpid()} on", "since 20"):
        assert part in problem.message
    assert not folder.exists()


def test_a_folder_with_files_stays(tmp_path):
    with one_writer(tmp_path / "run", "expdesign run"):
        (tmp_path / "run" / "file").touch()
        assert not is_empty(tmp_path / "run")
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["file"]


def test_the_lock_of_a_dead_process_is_free(tmp_path):
    program = (
        "import sys, time; from pathlib import Path; "
        "from expdesign.runfolder.lock import one_writer\n"
        "with one_writer(Path(sys.argv[1]), 'expdesign run'):\n"
        "    print('held', flush=True); time.sleep(60)"
    )
    held = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, env=environment()
    )
    assert held.stdout.readline() == b"held\n"
    with pytest.raises(InputError), one_writer(tmp_path, "expdesign run"):
        pytest.fail("it is held")
    held.send_signal(signal.SIGKILL)
    held.wait()
    held.stdout.close()
    assert {path.name for path in tmp_path.iterdir()} == {LOCK, Holder.FILE}
    with one_writer(tmp_path, "expdesign design"):
        assert Holder.read(tmp_path).process == os.getpid()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("part", ["designs/001", "motion-2", "designs/001/motion-2"])
def test_a_part_of_a_run_is_locked_with_the_whole(part, tmp_path):
    for folder in (tmp_path, tmp_path / "designs" / "001"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "run.yaml").touch()
    with (
        one_writer(tmp_path, "expdesign run"),
        pytest.raises(InputError, match="expdesign run"),
        one_writer(tmp_path / part, "expdesign export"),
    ):
        pytest.fail("it is held")


def test_a_folder_that_changes_while_it_is_read_is_noticed(tmp_path):
    with consistent_reading(tmp_path):
        pass
    with pytest.raises(ComputationError, match="while it was read"), consistent_reading(tmp_path):
        (tmp_path / Manifest.FILE).write_text("{}", encoding="utf-8")


def test_a_reader_leaves_no_lock(tmp_path):
    (tmp_path / LOCK).touch()  # of a process that was killed
    with consistent_reading(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_two_writers_of_one_file_do_not_mix(tmp_path):
    source, away = tmp_path / "run", tmp_path / "away"
    source.mkdir()
    with one_writer_to(away, "expdesign export", source, "a.csv") as reading:
        with reading:
            pass
        with one_writer_to(away, "expdesign export", source, "b.csv"):
            pass
        with (
            pytest.raises(InputError, match="`expdesign export`, process"),
            one_writer_to(away, "expdesign export", source, "a.csv"),
        ):
            pytest.fail("it is held")
        with pytest.raises(ComputationError, match="while it was read"), reading_of(source):
            (source / Manifest.FILE).write_text("{}", encoding="utf-8")
    assert not away.exists()
    with one_writer_to(source / "exports", "expdesign export", source, "a.csv") as reading, reading:
        assert Holder.read(source).command == "expdesign export"
    assert [path.name for path in source.iterdir()] == [Manifest.FILE]


@pytest.mark.parametrize("name", ["run/../run", "link"])
def test_a_folder_has_one_lock_by_every_path(name, tmp_path):
    source = tmp_path / "run"
    source.mkdir()
    (source / Manifest.FILE).write_text("{}", encoding="utf-8")
    (tmp_path / "link").symlink_to(source, target_is_directory=True)
    place = tmp_path / name / "exports"
    with one_writer_to(place, "expdesign export", source, "a.csv") as reading, reading:
        assert Holder.read(source).command == "expdesign export"


@contextmanager
def reading_of(source):
    with one_writer_to(source.parent / "away", "expdesign model", source, "c") as reading, reading:
        yield


@pytest.mark.slow
@pytest.mark.parametrize(
    "seconds", [0.7, *(pytest.param(wait, marks=pytest.mark.full) for wait in (0.0, 2.5))]
)
def test_a_pair_of_runs_never_mixes_a_folder(seconds, tmp_path):
    runs = []
    for seed in (0, 1):
        file = tmp_path / f"{seed}.yaml"
        run = tiny_run(
            design={"seed": seed},
            experiment={"seed": seed},
            export=[{"format": "csv", "segment": "1 ms"}],
        )
        with file.open("w", encoding="utf-8") as stream:
            YAML(typ="safe").dump(run, stream)
        command = [
            sys.executable,
            "-m",
            "expdesign",
            "run",
            str(file),
            "--out",
            str(tmp_path / "o"),
        ]
        runs.append(
            subprocess.Popen(
                command,
                env=environment(),
                stderr=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                text=True,
            )
        )
        time.sleep(seconds)
    ends = [(run.communicate()[1], run.returncode) for run in runs]
    refused = [text for text, status in ends if status == 2]
    assert sorted(status for _, status in ends) == [0, 2], ends
    assert "`expdesign run`, process" in refused[0]
    kept = next(seed for seed, (_, status) in enumerate(ends) if status == 0)
    folder = tmp_path / "o"
    assert f"seed: {kept}" in (folder / "run.yaml").read_text(encoding="utf-8")
    manifest = Manifest.read(folder)
    assert manifest.seeds["design"] == manifest.seeds["experiment"] == kept
    assert manifest.changed_files(folder) == []
    assert manifest.run_file == file_hash(folder / "run.yaml")
    design = json.loads(Path(folder / "design.json").read_text(encoding="utf-8"))
    assert design["format"] == 1
