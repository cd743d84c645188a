"""Jobs that are done ahead by idle workers: when their results are used, and when they end."""

import time
from functools import partial
from pathlib import Path

import pytest

from expdesign.workers import (
    Job,
    JobJournal,
    JobRunner,
    Monitor,
    foresee_nothing,
    unknown_jobs,
)
from tests.workers.numbered import Square

pytestmark = pytest.mark.slow


def build():
    return "built"


def logged(built, monitor, index, seconds, log):
    """Write the beginning to a file and report the end."""
    with Path(log).open("a") as file:
        file.write(f"{index}\n")
    end = time.monotonic() + seconds
    while time.monotonic() < end and not monitor.stop_requested():
        time.sleep(0.01)
    monitor.report(index)
    return index**2


def failing(built, monitor):
    raise ZeroDivisionError("broken")


def busy(built, monitor, index, seconds):
    """Use processor time and report the end."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    monitor.report(index)
    return index


def leading(runner, monitor):
    """Have a job run, and wait for a stop."""
    assert list(runner.run([Job(busy, (1, 0.3))], Monitor())) == [1]
    waiting_for(monitor.stop_requested)


def squared(built, monitor, number):
    return Square(number, number**2)


@pytest.fixture
def job(tmp_path):
    """Return what makes jobs; with `begun` the numbers of those that have begun."""
    log = tmp_path / "log"
    log.touch()

    def make(index, seconds=0.05, **changes):
        return Job(logged, (index, seconds, str(log)), **changes)

    def begun():
        return sorted(int(line) for line in log.read_text().split())

    make.begun = begun
    return make


@pytest.fixture
def runner():
    found = JobRunner(build, 2)
    yield found
    found.close()


def foreseen(*jobs):
    return lambda _known, _is_idle_for_long: jobs


def waiting_for(condition):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize("seconds", [0.0, 1.5])
def test_a_job_done_ahead_or_under_way_is_not_done_again(runner, job, seconds):
    events = []
    monitor = Monitor(report=events.append)
    assert list(runner.run([job(1, 1.0)], monitor, foresee=foreseen(job(2, seconds)))) == [1]
    assert events == [1]
    assert runner.has_begun(job(2, seconds))
    assert list(runner.run([job(2, seconds), job(3)], monitor, foresee=foresee_nothing)) == [4, 9]
    assert job.begun() == [1, 2, 3]
    assert sorted(events) == [1, 2, 3]


def test_required_jobs_do_not_wait_for_jobs_ahead(runner, job):
    endless = job(9, 600.0)
    assert list(runner.run([job(1, 1.0)], Monitor(), foresee=foreseen(endless))) == [1]
    assert 9 in job.begun()
    jobs = [job(2), job(3)]
    assert list(runner.run(jobs, Monitor(), foresee=foresee_nothing)) == [4, 9]
    assert not runner.has_begun(endless)


def test_a_job_that_is_not_foreseen_any_more_makes_room_for_another(runner, job):
    wanted = [job(9, 600.0)]

    def foresee(_known, _is_idle_for_long):
        if 9 in job.begun():
            wanted[:] = [job(5)]
        return list(wanted)

    list(runner.run([job(1, 2.0)], Monitor(), foresee=foresee))
    assert runner.known(job(5)) == 25
    assert not runner.has_begun(job(9, 600.0))


def test_an_error_ahead_is_raised_when_the_job_is_required(runner, job):
    broken = Job(failing, ())
    list(runner.run([job(1, 0.5)], Monitor(), foresee=foreseen(broken)))
    with pytest.raises(ZeroDivisionError, match="broken"):
        list(runner.run([broken], Monitor(), foresee=foresee_nothing))


def test_a_single_worker_does_nothing_ahead(job):
    runner = JobRunner(build, 1)
    assert list(runner.run([job(1)], Monitor(), foresee=foreseen(job(2)))) == [1]
    assert job.begun() == [1]


def test_a_stop_ends_the_jobs_ahead(runner, job):
    monitor = Monitor(lambda: job.begun() == [1, 9])
    list(runner.run([job(1, 600.0)], monitor, foresee=foreseen(job(9, 600.0))))
    assert not runner.has_begun(job(9, 600.0))


@pytest.mark.parametrize("is_needed", [True, False])
def test_a_job_led_here_counts_if_its_companions_do_not_change_it(runner, job, is_needed):
    companion, led = job(2, 0.3), job(3, 1.0 if is_needed else 600.0)

    def foresee(known, _is_idle_for_long):
        assert known(companion) == 4
        return [led] if is_needed else []

    runner.lead("built", led, Monitor(), [companion], foresee)
    assert runner.known(led) == (9 if is_needed else None)
    assert list(runner.run([companion], Monitor(), foresee=foresee_nothing)) == [4]
    assert job.begun() == [2, 3]
    assert runner.free == 2


@pytest.mark.parametrize("is_ahead", [False, True])
def test_processor_time_and_events_of_a_companion_count_once(is_ahead):
    events = []
    monitor = Monitor(report=events.append)
    runner = JobRunner(build, 2, keep_event=bool)
    companion, led = Job(busy, (2, 1.0)), Job(busy, (3, 0.5))
    if is_ahead:
        first = Job(busy, (1, 0.3))
        list(runner.run([first], monitor, foresee=foreseen(companion)))
        assert runner.has_begun(companion)
    runner.lead("built", led, monitor, [companion], foreseen(led))
    for job in (companion, led):
        list(runner.run([job], monitor, foresee=foresee_nothing))
    runner.close()
    assert sorted(events) == [*([1] if is_ahead else []), 2, 3]
    assert 1.5 <= runner.cpu_seconds - 0.3 * is_ahead < 2.0


def test_jobs_of_a_led_job_that_is_not_needed_do_not_count(runner, job):
    runner.lead(runner, Job(leading, ()), Monitor(), [job(2, 0.3)], foreseen())
    assert runner.cpu_seconds == 0.0
    assert runner.known(Job(leading, ())) is None


@pytest.mark.parametrize("is_needed", [True, False])
def test_an_error_of_a_led_job_counts_if_the_job_is_needed(runner, job, is_needed):
    companion, led = job(2, 0.3), Job(failing, ())
    lead = partial(runner.lead, "built", led, Monitor(), [companion])
    if is_needed:
        with pytest.raises(ZeroDivisionError, match="broken"):
            lead(foreseen(led))
    else:
        lead(foreseen())
    assert runner.known(companion) == 4


def test_a_result_in_the_journal_is_known(tmp_path):
    named = Job(squared, (3,), "three")
    for resume in (False, True):
        journal = JobJournal(tmp_path / "jobs.jsonl", "inputs", Square, resume=resume)
        runner = JobRunner(build, 2, journal=journal)
        assert runner.known(named) == (Square(3, 9) if resume else None)
        assert runner.known(Job(squared, (4,))) is None
        list(runner.run([named], Monitor(), foresee=foresee_nothing))
        runner.close()


def test_a_procedure_is_foreseen_as_far_as_results_are_known_or_expected():
    one, two, three = (Job(abs, (number,)) for number in (1, 2, 3))
    expecting = Job(abs, (4,), expected=4)

    def procedure():
        results = yield [one, two]
        results += yield [expecting]
        results += yield [three]
        yield [Job(abs, (sum(results),))]

    def unknown(known):
        jobs = unknown_jobs(procedure(), lambda job: known.get(job.arguments[0]))
        return [job.arguments[0] for job in jobs]

    assert unknown({}) == [1, 2]
    assert unknown({1: 1, 2: 2}) == [4, 3]
    assert unknown({1: 1, 2: 2, 3: 3}) == [4, 10]
    assert unknown({1: 1, 2: 2, 3: 3, 4: 40}) == [46]
    assert unknown({1: 1, 2: 2, 3: 3, 4: 40, 46: 0}) == []
