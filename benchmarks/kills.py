"""Workers, the scheduler, or both killed while a command uses a Dask cluster.

The commands are a design, a sweep and a Monte-Carlo study. Each trial has a cluster in processes
that are killed when some jobs have ended, after a random time. Lost workers may come back within
3 s here. The command ends without a traceback; every job that had ended before is in its journal or
result; the same command with ``--resume`` gives the files of a run that nothing disturbed.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import signal
import socket
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pandas as pd
from distributed.cli import dask_scheduler, dask_worker

from benchmarks.folders import quick_robot, timeless_files
from expdesign.cli.app import app, run
from expdesign.runfolder.files import RUN_FILE
from tests.blank_figures import blank_figures
from tests.killed_runs import CopiedRun
from tests.tiny_run import tiny_run

TITLE = "Workers and schedulers killed"

_KILLS = 30
_JOURNALS = {
    "design": "search.jsonl",
    "sweep": "designs/*/search.jsonl",
    "montecarlo": "montecarlo/repetitions.jsonl",
}
"""Journal of the jobs that have ended, by command."""
_RUNS: dict[str, dict[str, Any]] = {
    "design": {},
    "sweep": {"sweep": {"experiment.periods": [3, 4]}, "report": None},
    "montecarlo": {"montecarlo": {"repetitions": 8, "estimators": ["ls"]}},
}
_TARGETS = ("workers", "workers that come back", "scheduler", "both")
_RETURN_SECONDS = 3.0
"""s, for lost workers; the product waits for a minute."""
_LONGEST = 600.0
"""s, that a command may take."""


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each kill."""
    chosen = random.Random(0)
    patience = patch("expdesign.workers.cluster._RETURN_SECONDS", _RETURN_SECONDS)
    with patience, tempfile.TemporaryDirectory(prefix="expdesign-kills-") as folder:
        trials = {name: KillTrials(name, Path(folder) / name) for name in _RUNS}
        for number in range(_KILLS):
            command = list(_RUNS)[number % len(_RUNS)]
            target = _TARGETS[number // len(_RUNS) % len(_TARGETS)]
            ended, later = chosen.randint(0, 3), round(chosen.uniform(0, 1), 2)
            yield {"kill": number + 1, **trials[command].judge(target, ended, later)}


def summary(table: pd.DataFrame) -> str:
    """Return the number of kills without a finding."""
    good = int((table["findings"] == "").sum())
    return f"{good} of {len(table)} kills without a finding."


class KillTrials:
    """Runs of one command whose cluster is killed, and its undisturbed result."""

    def __init__(self, command: str, place: Path) -> None:
        self.command, self.place, self.folder = command, place, place / "out"
        place.mkdir(parents=True)
        # It also loads all modules and kernels into this process.
        with blank_figures():
            if run(app, self._line(None)):
                raise RuntimeError("the undisturbed run failed")
        self.undisturbed = self._files()
        shutil.rmtree(self.folder)

    def _line(self, scheduler: str | None) -> list[str]:
        """Write the run file; return the command line with a cluster or local processes."""
        design = {"starts": 4, "smoothing": [0.4], "max_iterations": 4}
        made = tiny_run(robot=quick_robot(), design=design, **_RUNS[self.command])
        if scheduler is not None:
            made |= {"scheduler": scheduler, "workers": None}
        file = self.place / "run.yaml"
        wanted = {key: value for key, value in made.items() if value is not None}
        file.write_text(json.dumps(wanted), encoding="utf-8")
        return ["run", str(file), "--out", str(self.folder)]

    def judge(self, target: str, ended: int, later: float) -> dict[str, Any]:
        """Kill the target `later` seconds after this number of jobs has ended; return the row."""
        parts = KilledCluster()
        made = CopiedRun(self._line(parts.address))
        end = time.monotonic() + _LONGEST
        while made.is_running() and len(self._ended()) < ended and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(later)
        before = self._ended()
        parts.kill(target)
        while made.is_running() and time.monotonic() < end:
            time.sleep(0.1)
        if made.is_running():
            os.kill(made.process, signal.SIGKILL)
        status, (_, said) = made.end()
        parts.end()
        findings, after = list[str](), self._ended()
        if status not in (0, 1) or "Traceback" in said:
            findings.append(f"exit status {status}: {said[-300:]}")
        if status == 1 and parts.address not in said:
            findings.append("the cluster is not named")
        lost = [job for job in before - after if self._is_needed(job)]
        if status and lost:
            findings.append(f"{len(lost)} jobs lost that had ended")
        CopiedRun([*self._line(None), "--resume"]).end()
        found = self._files()
        findings += [
            f"{name} differs"
            for name in sorted(found.keys() | self.undisturbed)
            if found.get(name) != self.undisturbed.get(name)
        ]
        shutil.rmtree(self.folder)
        return {
            "command": self.command,
            "killed": target,
            "ended before": len(before),
            "later": later,
            "exit": status,
            "kept": len(after) if status else "all",
            "findings": "; ".join(findings),
        }

    def _ended(self) -> set[str]:
        """Return the finished designs of a sweep and the lines of the journals."""
        found = {str(path) for path in self.folder.glob("designs/*/design.json")}
        for path in self.folder.glob(_JOURNALS[self.command]):
            found |= {f"{path}: {line}" for line in path.read_text().splitlines()[1:]}
        return found

    def _files(self) -> dict[str, Any]:
        """Return the content of the files, except for times, orders of ends and the cluster."""
        found = timeless_files(self.folder)
        if journal := found.get(_JOURNALS["montecarlo"]):
            found[_JOURNALS["montecarlo"]] = sorted(journal.splitlines())  # in the order of ends
        # run.yaml states the cluster.
        return {name: found[name] for name in found if not name.endswith(RUN_FILE)}

    def _is_needed(self, job: str) -> bool:
        """Return whether a job has to be kept: a complete design of a sweep has no journal."""
        return self.command != "sweep" or Path(job.partition(": ")[0]).is_file()


class KilledCluster:
    """A scheduler and a worker in copies of this process that are killed."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{port}"
        self._scheduler = _start_part(dask_scheduler.main, "--port", port)
        self._workers = [self._worker()]

    def _worker(self) -> int:
        options = ("--no-nanny", "--nthreads", "1")
        return _start_part(dask_worker.main, self.address, *options)

    def kill(self, target: str) -> None:
        """Kill the workers, the scheduler or both; new workers may follow."""
        if target in ("scheduler", "both"):
            os.kill(self._scheduler, signal.SIGKILL)
        if target != "scheduler":
            for worker in self._workers:
                os.kill(worker, signal.SIGKILL)
        if target == "workers that come back":
            self._workers.append(self._worker())

    def end(self) -> None:
        """End all processes."""
        for part in (*self._workers, self._scheduler):
            os.kill(part, signal.SIGKILL)
            os.waitpid(part, 0)


def _start_part(main: Callable[[list[str]], Any], *options: str) -> int:
    """Start a part of the cluster in a copy of this process; return the number of the process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: the copy uses none
        process = os.fork()
    if process == 0:
        with contextlib.suppress(BaseException):
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)
            main(["--host", "127.0.0.1", "--no-dashboard", *options])
        os._exit(0)
    return process
