"""Jobs in this process and in others; their functions stand here so that workers find them."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info

from expdesign.interruption import ENDING
from expdesign.solver.phases import SearchEvent
from expdesign.workers import Job, Monitor, WorkerDiedError, job, run_in_copies, run_jobs
from expdesign.workers import local as process_module

pytestmark = pytest.mark.slow

WORKERS = (1, 2)


class Recorder:
    """A monitor that keeps the events, and asks to stop after some of them."""

    def __init__(self, stop_after=None):
        self.events = []
        self.stop_after = stop_after

    def report(self, event):
        self.events.append(event)

    def stop_requested(self):
        return self.stop_after is not None and len(self.events) >= self.stop_after


def build():
    return {"built": os.getpid()}


def sleeper(built, monitor, index, seconds):
    time.sleep(seconds)
    monitor.report(SearchEvent(index, "blunt", 1, 0.5, 0.0, 0.0))
    threads = max((library["num_threads"] for library in threadpool_info()), default=1)
    return index, os.getpid(), built["built"], threads


def failing(built, monitor, index):
    if index == 1:
        raise ZeroDivisionError("job 1 is broken")
    return index


def patient(built, monitor, index):
    """Report until it is asked to stop; give up after minutes."""
    for iteration in range(30_000):
        monitor.report(SearchEvent(index, "blunt", iteration, 0.0, 0.0, 0.0))
        if monitor.stop_requested():
            return "stopped"
        time.sleep(0.01)
    return "never asked"


def hardy(built, monitor, index):
    """Take every signal that a terminal or a system sends to all processes of a run."""
    for number in ENDING:
        os.kill(os.getpid(), number)
    return index


def killed(built, monitor, index):
    os.kill(os.getpid(), signal.SIGKILL)


def unspeakable(built, monitor, index):
    return lambda: index


@pytest.mark.parametrize("workers", WORKERS)
def test_results_come_in_the_order_of_the_jobs(workers):
    monitor = Recorder()
    jobs = [Job(sleeper, (k, seconds)) for k, seconds in enumerate((0.3, 0.0, 0.1, 0.0))]
    results = list(run_jobs(build, jobs, workers, monitor))
    assert [index for index, *_ in results] == [0, 1, 2, 3]
    # Every event has arrived when the results have. With several workers nothing is built here.
    assert sorted(event.start for event in monitor.events) == [0, 1, 2, 3]
    assert (os.getpid() in {built for *_, built, _ in results}) == (workers == 1)
    assert (os.getpid() in {process for _, process, *_ in results}) == (workers == 1)
    # One BLAS thread each.
    assert {threads for *_, threads in results} == {1}


def test_new_workers_are_copies_of_a_process_that_has_built():
    process_module._end_all()
    process_module.prepare_workers(build)
    results = list(run_jobs(build, [Job(sleeper, (k, 0.2)) for k in range(4)], 2, Recorder()))
    processes, builders = ({result[k] for result in results} for k in (1, 2))
    assert len(builders) == 1
    assert not builders & {*processes, os.getpid()}


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_jobs_follow_from_results_in_the_order_of_the_jobs(workers):
    """Which ones does not depend on who is done first."""
    seen = []

    def then(result):
        index = result[0]
        seen.append(index)
        # Later ones are done sooner; every second one has a successor.
        return Job(sleeper, (10 + index, 0.0)) if index % 2 == 0 and index < 30 else None

    jobs = [Job(sleeper, (k, 0.2 - 0.05 * k)) for k in range(4)]
    results = list(run_jobs(build, jobs, workers, Recorder(), then=then))
    assert [index for index, *_ in results] == seen == [0, 1, 2, 3, 10, 12, 20, 22, 30, 32]


def test_a_lane_does_not_wait_for_another():
    """The first lane's only job takes the time of all of the second, which keeps its order."""
    jobs = [
        Job(sleeper, (0, 0.5)),
        *(Job(sleeper, (k, 0.2 - 0.1 * k), lane=1) for k in (1, 2)),
    ]

    def then(result):
        return Job(sleeper, (result[0] + 2, 0.0), lane=1) if 0 < result[0] < 3 else None

    results = [index for index, *_ in run_jobs(build, jobs, 3, Recorder(), then=then)]
    assert [index for index in results if index] == [1, 2, 3, 4]
    assert results[-1] == 0


def briefly_idle(built, monitor, index, seconds):
    """Leave the worker so that it ends by itself after a second without a job."""
    job.IDLE_SECONDS = 1.0
    time.sleep(seconds)
    return index


def test_a_worker_that_ends_for_want_of_jobs_takes_nothing_with_it(monkeypatch):
    monkeypatch.setattr(process_module, "_idle", [])
    monkeypatch.setattr(process_module, "_KEPT", 0.8)
    jobs = [Job(briefly_idle, (0, 0.0)), Job(briefly_idle, (1, 3.0))]

    def then(result):
        return Job(briefly_idle, (result + 2, 0.0)) if result < 2 else None

    try:
        # The third job is there when the first worker has gone: its result comes after the second.
        results = list(run_jobs(build, jobs[::-1], 2, Monitor(), then=then))
        assert results == [1, 0, 3, 2]
    finally:
        for worker in process_module._idle:
            worker.end()


def _next(result):
    return Job(sleeper, (result[0] + 1, 0.0)) if result[0] < 30 else None


@pytest.mark.parametrize("workers", WORKERS)
def test_no_job_follows_after_a_request_to_stop(workers):
    monitor, jobs = Recorder(stop_after=3), [Job(sleeper, (0, 0.0))] * 2
    assert 2 <= len(list(run_jobs(build, jobs, workers, monitor, then=_next))) <= 5
    made = list(run_jobs(build, jobs, workers, monitor, after_stop=True, then=_next))
    assert len(made) == 62


@pytest.mark.parametrize("workers", WORKERS)
def test_what_goes_wrong_where_jobs_follow_comes_through(workers):
    def broken(result):
        raise ZeroDivisionError("no job follows")

    jobs = [Job(sleeper, (0, 0.0))] * 2
    with pytest.raises(ZeroDivisionError, match="no job follows"):
        list(run_jobs(build, jobs, workers, Recorder(), then=broken))
    # Nobody waits for what goes on for minutes.
    long = [jobs[0], Job(patient, (1,))]
    results = run_jobs(build, long, workers, Recorder(), then=_next)
    next(results)
    results.close()
    assert len(list(run_jobs(build, jobs, workers, Recorder()))) == 2


@pytest.mark.parametrize("workers", WORKERS)
def test_no_jobs(workers):
    assert list(run_jobs(build, [], workers, Recorder())) == []


def test_one_job_goes_to_a_worker_only_where_one_is_there(monkeypatch):
    monkeypatch.setattr(process_module, "_idle", [])

    def places(count, workers=2):
        jobs = [Job(sleeper, (k, 0.2)) for k in range(count)]
        return {process for _, process, *_ in run_jobs(build, jobs, workers, Recorder())}

    try:
        assert places(1) == {os.getpid()}
        others = places(2)
        assert places(1) < others
        assert places(1, workers=1) == {os.getpid()}
    finally:
        for worker in process_module._idle:
            worker.end()


@pytest.mark.parametrize("workers", WORKERS)
def test_a_jobs_exception_comes_through(workers):
    jobs = [Job(failing, (k,)) for k in range(3)]
    with pytest.raises(ZeroDivisionError, match="job 1 is broken"):
        list(run_jobs(build, jobs, workers, Recorder()))


@pytest.mark.parametrize("workers", WORKERS)
def test_a_request_to_stop_reaches_the_jobs(workers):
    """Those that run end, those that have not begun never do."""
    monitor = Recorder(stop_after=5)
    results = list(run_jobs(build, [Job(patient, (k,)) for k in range(6)], workers, monitor))
    assert 1 <= len(results) <= workers
    assert set(results) == {"stopped"}


@pytest.mark.parametrize("workers", WORKERS)
def test_after_a_request_to_stop_nothing_begins(workers):
    jobs = [Job(sleeper, (k, 0.0)) for k in range(3)]
    assert len(list(run_jobs(build, jobs, workers, Recorder(stop_after=0)))) <= workers


def test_shares_of_a_work_are_done_in_copies_of_this_process():
    """What a copy fails to return is done here."""
    here = os.getpid()

    def work(share):
        if share == 2 and os.getpid() != here:
            os._exit(3)
        return share, os.getpid() == here

    assert run_in_copies(work, 4) == [(0, True), (1, False), (2, True), (3, False)]


def test_workers_stay_with_what_they_have_built():
    jobs = [Job(sleeper, (k, 0.2)) for k in range(2)]
    first, second = (list(run_jobs(build, jobs, 2, Recorder())) for _ in range(2))
    assert {process for _, process, *_ in first} == {process for _, process, *_ in second}
    assert {built for *_, built, _ in first} == {built for *_, built, _ in second}
    assert os.getpid() not in {built for *_, built, _ in second}


def test_signals_that_end_a_run_do_not_end_its_workers():
    assert list(run_jobs(build, [Job(hardy, (k,)) for k in range(4)], 2, Recorder())) == [*range(4)]


def test_a_worker_that_dies_is_told_and_the_next_jobs_have_others():
    with pytest.raises(WorkerDiedError):
        list(run_jobs(build, [Job(killed, (k,)) for k in range(2)], 2, Recorder()))
    assert (
        len(list(run_jobs(build, [Job(sleeper, (k, 0.0)) for k in range(2)], 2, Recorder()))) == 2
    )


def test_a_result_that_cannot_be_sent_is_an_error():
    with pytest.raises((AttributeError, pickle.PicklingError, TypeError)):
        list(run_jobs(build, [Job(unspeakable, (k,)) for k in range(2)], 2, Recorder()))


def test_results_that_are_not_waited_for_end_the_jobs():
    """The third job never ends by itself."""
    jobs = [Job(sleeper, (0, 0.0)), Job(sleeper, (1, 0.0)), Job(patient, (2,))]
    results = run_jobs(build, jobs, 2, Monitor())
    assert next(results)[0] == 0
    results.close()


PROGRAM = """
import sys
from expdesign.workers import Job, Monitor, run_jobs
from tests.workers.test_pool import build, patient

class Begun:
    begun = set()
    def stop_requested(self):
        return False
    def report(self, event):
        self.begun.add(event.start)
        if len(self.begun) == 2:
            print("begun", flush=True)

list(run_jobs(build, [Job(patient, (k,)) for k in range(2)], 2, Begun()))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_their_run_whatever_ends_it(number, tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path]),
            "TMPDIR": str(tmp_path),
        },
    )
    try:
        assert process.stdout.readline() == b"begun\n"
        process.send_signal(number)
        # Every process of the run has these pipes: their end is the end of the last of them.
        process.communicate(timeout=120)
    finally:
        process.kill()
    assert list(tmp_path.iterdir()) == []
