"""The search as a whole, on tiny problems: what it may depend on, and what not."""

import dataclasses
import importlib
import pickle

import numpy as np
import pytest

from expdesign.solver.jobs import Candidate, hop_job, newcomer_job, random_job
from expdesign.solver.search import NoDesignError, search
from expdesign.solver.start import GIVEN_UP, Screening
from expdesign.workers import Job, Monitor, run_jobs

QUICK = {"max_iterations": 4}


class Recorder:
    """A monitor that keeps the events."""

    def __init__(self):
        self.events = []

    def report(self, event):
        self.events.append(event)

    def stop_requested(self):
        return False


@pytest.fixture(scope="module")
def run(build, task, cheaper):
    """Search with another plan; return the result."""

    def searched(monitor=None, **changes):
        plan = dataclasses.replace(task.plan, iterations=4, **changes)
        with cheaper():
            return search(build(design=QUICK), plan, monitor or Monitor())

    return searched


@pytest.fixture(scope="module")
def one_start(run):
    return run(starts=1)


@pytest.fixture(scope="module")
def hopped(run):
    return run(starts=1, hops=3)


def merit(result, task):
    return task.evaluator.merit(result.finished.trajectory, task.problem.cost.samples)


def test_seed_and_starts(run, one_start, build, task):
    """More starts begin like fewer, and come to no less."""
    monitor = Recorder()
    # The plan that a job uses is the one that its workshop was built with.
    assert build(design=QUICK)().plan.seed == 0
    one = one_start
    two = run(monitor, starts=2)
    np.testing.assert_array_equal(two.starts[0].variables, one.starts[0].variables)
    assert two.starts[0].merit == one.starts[0].merit
    assert merit(two, task) >= merit(one, task)
    assert np.max(np.abs(two.starts[0].variables - two.starts[1].variables)) > 1e-2
    _events_tell_everything(monitor.events, two)


def _events_tell_everything(events, result):
    for start in result.starts:
        mine = [event for event in events if event.start == start.index]
        own = [event for event in mine if event.phase not in {"done", "finish", "finished"}]
        assert [event.iteration for event in own] == [point.iteration for point in start.trace]
        (done,) = (event for event in mine if event.phase == "done")
        assert done.status == start.status
        assert done.objective == start.merit
        assert done.iteration == start.iterations
    assert any(event.phase == "finish" for event in events)
    told = {event.start: event.objective for event in events if event.phase == "finished"}
    assert told == result.finished_merits
    assert max(told, key=told.get) == result.best.index


def test_seeds_differ(task):
    reached = []
    for seed in (1, 2):
        plan = dataclasses.replace(task.plan, seed=seed, iterations=2)
        reached.append(random_job(dataclasses.replace(task, plan=plan), Monitor(), 1))
    assert np.max(np.abs(reached[0].variables - reached[1].variables)) > 1e-2


def test_hopping_is_never_worse_than_the_starts_alone(hopped, one_start, task):
    alone = one_start
    assert [start.kind for start in hopped.starts] == ["random", "hop", "random", "hop"]
    assert [start.index for start in hopped.starts] == [1, 2, 3, 4]
    np.testing.assert_array_equal(hopped.starts[0].variables, alone.starts[0].variables)
    assert merit(hopped, task) >= merit(alone, task)
    assert hopped.finished.check.passed
    assert hopped.best.index in {start.index for start in hopped.starts}


def test_every_other_hop_is_the_random_start_of_that_number(hopped, build):
    newcomer, alone = hopped.starts[2], random_job(build(design=QUICK)(), Monitor(), 3)
    assert newcomer.kind == "random"
    shared = min(len(newcomer.trace), len(alone.trace))
    assert shared > 0
    assert newcomer.trace[:shared] == alone.trace[:shared]


class Hops:
    """Stands for hops and newcomers; what they gain is given, and what they set out from kept."""

    def __init__(self, gains, one):
        self.gains, self.one, self.seen = gains, one, []

    def hop(self, task, monitor, index, origin):
        self.seen.append(("hop", origin.merit))
        return self._result(index, "hop", origin.lineage)

    def newcomer(self, task, monitor, index, screening):
        self.seen.append(("newcomer", *(one.objective for one in screening.reference)))
        return self._result(index, "random", index)

    def _result(self, index, kind, lineage):
        gain = self.gains[len(self.seen) - 1]
        record = dataclasses.replace(self.one.starts[0].stages[-1], objective=gain)
        result = dataclasses.replace(
            self.one.starts[0], index=index, kind=kind, stages=(record, record)
        )
        if not np.isfinite(gain):
            return dataclasses.replace(result, merit=gain), None
        # Marked by its gain, to tell whose motion is the search's result.
        mu = self.one.finished.trajectory.mu.copy()
        mu[0, 0] = gain
        trajectory = dataclasses.replace(self.one.finished.trajectory, mu=mu)
        finished = dataclasses.replace(self.one.finished, trajectory=trajectory)
        return result, Candidate(1000.0 + gain, finished, result, lineage)


def test_hops_set_out_from_the_best_of_the_batches_before_in_turn(
    run, one_start, monkeypatch, task
):
    """Four at a time, whoever is first; what was given up changes nothing."""
    module = importlib.import_module("expdesign.solver.search")
    one = one_start
    hops = Hops([2.0, 1.0, -np.inf, -np.inf, 1.5, 3.0, -2000.0, 0.5, 4.0, -np.inf], one)
    monkeypatch.setattr(module, "hop_job", hops.hop)
    monkeypatch.setattr(module, "newcomer_job", hops.newcomer)
    monkeypatch.setattr(module, "proof_job", lambda _task, _monitor, _index, one: (1.0, one))
    result = run(starts=1, hops=10)
    # The start's motion as it is before anything is proved of it.
    known = hops.seen[0][1]
    assert np.isfinite(known)
    assert hops.seen[:4] == [("hop", known), ("newcomer",)] * 2
    # The first hop's 1002 took the start's place, the newcomer's 1001 is second. There is room.
    assert hops.seen[4:8] == [("hop", 1002.0), ("newcomer",), ("hop", 1001.0), ("newcomer",)]
    # Neither the 1001.5 from 1002 nor the -1000 from 1001 is any better. 1003 joined, the 1000.5
    # was the fourth: whoever comes is measured by the 1001. The fifth turn is the second's.
    assert hops.seen[8:] == [("hop", 1002.0), ("newcomer", 1.0)]
    assert result.finished.trajectory.mu[0, 0] == 4.0
    assert result.best.index == 10
    assert len(result.starts) == 11


def test_a_newcomer_and_a_hop_know_their_descent_and_are_given_up(task, one_start, cheap_finish):
    """A newcomer begins a lineage of its own, a hop goes on with its origin's."""
    start = one_start.starts[0]
    quick = dataclasses.replace(task, plan=dataclasses.replace(task.plan, iterations=4))
    out_of_reach = tuple(dataclasses.replace(one, objective=-1e9) for one in start.stages)
    result, newcomer = newcomer_job(quick, Monitor(), 5, Screening(()))
    assert (newcomer.lineage, newcomer.start.index) == (5, 5)
    assert newcomer.merit == merit(newcomer, quick)
    given_up, nobody = newcomer_job(quick, Monitor(), 5, Screening(out_of_reach[-1:]))
    assert nobody is None
    assert given_up.merit == -np.inf
    assert given_up.status == GIVEN_UP
    assert len(given_up.stages) == len(result.stages)

    lax = dataclasses.replace(newcomer, start=dataclasses.replace(result, stages=()))
    _, descendant = hop_job(quick, Monitor(), 6, lax)
    assert (descendant.lineage, descendant.start.index) == (5, 6)
    far = dataclasses.replace(newcomer, start=dataclasses.replace(result, stages=out_of_reach))
    given_up, nobody = hop_job(quick, Monitor(), 6, far)
    assert nobody is None
    assert given_up.status == GIVEN_UP


def test_hops_and_newcomers_in_other_processes_are_the_same(build, tiny_result):
    found = tiny_result.search
    out_of_reach = tuple(dataclasses.replace(one, objective=-1e9) for one in found.best.stages)
    start = dataclasses.replace(found.best, stages=out_of_reach)
    origin = Candidate(0.0, found.finished, start, lineage=1)
    jobs = [Job(hop_job, (6, origin)), Job(newcomer_job, (7, Screening(out_of_reach[-1:])))]
    make = build(design={"max_iterations": 2})
    one, two = (list(run_jobs(make, jobs, workers, Monitor())) for workers in (1, 2))
    for (a, nobody), (b, no_other) in zip(one, two, strict=True):
        assert nobody is no_other is None
        np.testing.assert_array_equal(a.variables, b.variables)
        assert (a.trace, a.status) == (b.trace, GIVEN_UP)
    again = pickle.loads(pickle.dumps(origin))
    assert (again.rank, again.lineage) == (origin.rank, origin.lineage)


def test_no_start_keeps_the_limits(run, monkeypatch):
    """What the starts came to is said and kept."""
    from expdesign.solver import start as module
    from expdesign.solver.finish import Shrunk

    def hopeless(problem, trajectory):
        return Shrunk(trajectory, 0.8, kept=False)

    monkeypatch.setattr(module, "shrink_to_limits", hopeless)
    with pytest.raises(NoDesignError, match="none of 1 starts") as caught:
        run(starts=1)
    assert len(caught.value.starts) == 1
    assert caught.value.starts[0].merit == -np.inf
    assert caught.value.starts[0].status in str(caught.value)
