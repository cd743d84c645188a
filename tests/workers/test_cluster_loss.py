"""A cluster that loses workers or its scheduler: nothing that ended is lost, and it is named."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path

import pytest

from expdesign.workers import ClusterError, Job, JobJournal, JobRunner, Monitor, cluster_jobs
from tests.killed_runs import ROOT
from tests.workers.numbered import Square, build, slow_square

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow


class Cluster:
    """A scheduler and workers in processes that a test may kill."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{port}"
        self.workers = []
        self.scheduler = self._start("distributed.cli.dask_scheduler", "--port", port)

    def _start(self, module, *options):
        command = [sys.executable, "-m", module, "--host", "127.0.0.1", "--no-dashboard", *options]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def add_worker(self):
        options = ("--no-nanny", "--nthreads", "1")
        self.workers.append(self._start("distributed.cli.dask_worker", self.address, *options))

    def kill_workers(self):
        for worker in self.workers:
            worker.send_signal(signal.SIGKILL)
            worker.wait()
        self.workers.clear()

    def end(self):
        self.kill_workers()
        self.scheduler.kill()
        self.scheduler.wait()


@pytest.fixture
def cluster(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path.cwd()), *sys.path]))
    monkeypatch.setattr("expdesign.workers.cluster._RETURN_SECONDS", 3)
    found = Cluster()
    found.add_worker()
    yield found
    found.end()


def jobs(count=12, seconds=0.2):
    return [Job(slow_square, (k, seconds), name=f"number {k}") for k in range(count)]


def journal(tmp_path, *, resume):
    return JobJournal(tmp_path / "jobs.jsonl", "inputs", Square, resume=resume)


def kill_all(cluster):
    cluster.scheduler.kill()
    cluster.kill_workers()


@pytest.mark.parametrize(
    "kill", [Cluster.kill_workers, lambda cluster: cluster.scheduler.kill(), kill_all]
)
def test_what_ended_is_kept_and_the_rest_is_done_on_resuming(kill, cluster, tmp_path):
    runner = JobRunner(build, 1, cluster.address, journal=journal(tmp_path, resume=False))
    found = []
    for result in runner.run(jobs(), Monitor()):
        found.append(result)
        if len(found) == 3:
            kill(cluster)
    assert cluster.address in runner.lost.message
    assert 3 <= len(found) < 12
    again = journal(tmp_path, resume=True)
    assert again.count >= len(found)
    here = JobRunner(build, 1, journal=again)
    assert list(here.run(jobs(), Monitor())) == [Square(k, k * k) for k in range(12)]
    assert list(JobRunner(build, 1, journal=again).run(jobs(seconds=60), Monitor())) == [
        Square(k, k * k) for k in range(12)
    ]


def test_after_the_loss_the_jobs_that_run_even_after_a_stop_are_done_here(cluster):
    runner = JobRunner(build, 1, cluster.address)
    results = runner.run(jobs(), Monitor(), after_stop=True)
    found = [next(results)]
    kill_all(cluster)
    found += results
    assert found == [Square(k, k * k) for k in range(12)]
    assert isinstance(runner.lost, ClusterError)


def test_workers_that_come_back_are_used(cluster):
    cluster.add_worker()
    found = []
    for result in cluster_jobs(cluster.address, build, deque(jobs()), lambda: False):
        found.append(result.number)
        if len(found) in (2, 6):
            cluster.kill_workers()
            threading.Timer(1, cluster.add_worker).start()
    assert sorted(found) == list(range(12))


def test_a_stop_does_not_wait_for_a_long_job(cluster):
    began = time.monotonic()
    stop = threading.Event()
    threading.Timer(4, stop.set).start()
    results = cluster_jobs(cluster.address, build, deque(jobs(seconds=30)), stop.is_set)
    assert list(results) == []
    assert time.monotonic() - began < 15


_TRIAL = """
import json, pathlib, sys
from benchmarks import kills
import expdesign.workers.cluster as cluster
cluster._RETURN_SECONDS = 3
command, target, place = sys.argv[1:]
print(json.dumps(kills.KillTrials(command, pathlib.Path(place)).judge(target, 2, 0.0)["findings"]))
"""


@pytest.mark.parametrize(
    ("command", "target"),
    [
        pytest.param("sweep", "workers", marks=pytest.mark.full),
        pytest.param("sweep", "scheduler", marks=pytest.mark.full),
        ("montecarlo", "both"),
    ],
)
def test_a_command_that_loses_its_cluster_goes_on(command, target, tmp_path):
    """In a process of its own, without threads: the parts of the trial are copies of it."""
    line = [sys.executable, "-c", _TRIAL, command, target, str(tmp_path / "trials")]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == ""
