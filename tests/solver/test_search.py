"""The search as a whole, on tiny problems: what it may depend on, and what not."""

import dataclasses
import importlib

import numpy as np
import pytest

from expdesign.solver import NoDesignError, SilentMonitor, search
from expdesign.solver.pool import Job, run_jobs
from expdesign.solver.search import _random_job

QUICK = {"max_iterations": 4}


class Recorder:
    """A monitor that keeps the events."""

    def __init__(self):
        self.events = []

    def report(self, event):
        self.events.append(event)

    def stop_requested(self):
        return False


@pytest.fixture
def run(build, shop, cheap_finish):
    """Search with another plan; return the result."""

    def searched(monitor=None, **changes):
        plan = dataclasses.replace(shop.plan, iterations=4, **changes)
        return search(build(design=QUICK), plan, monitor or SilentMonitor())

    return searched


def merit(result, shop):
    return shop.judge.merit(result.finished.trajectory, shop.problem.cost.samples)


def test_seed_and_starts(run, build, shop):
    """More starts begin like fewer, and come to no less."""
    monitor = Recorder()
    # The plan that a job uses is the one that its workshop was built with.
    assert build(design=QUICK)().plan.seed == 0
    one = run(starts=1)
    two = run(monitor, starts=2)
    np.testing.assert_array_equal(two.starts[0].variables, one.starts[0].variables)
    assert two.starts[0].merit == one.starts[0].merit
    assert merit(two, shop) >= merit(one, shop)
    assert np.max(np.abs(two.starts[0].variables - two.starts[1].variables)) > 1e-2
    _events_tell_everything(monitor.events, two)


def _events_tell_everything(events, result):
    for start in result.starts:
        mine = [event for event in events if event.start == start.index]
        own = [event for event in mine if event.phase not in {"done", "finish"}]
        assert [event.iteration for event in own] == [point.iteration for point in start.trace]
        (done,) = (event for event in mine if event.phase == "done")
        assert done.status == start.status
        assert done.objective == start.merit
        assert done.iteration == start.iterations
    assert any(event.phase == "finish" for event in events)


def test_seeds_differ(shop):
    reached = []
    for seed in (1, 2):
        plan = dataclasses.replace(shop.plan, seed=seed, iterations=2)
        reached.append(_random_job(dataclasses.replace(shop, plan=plan), SilentMonitor(), 1))
    assert np.max(np.abs(reached[0].variables - reached[1].variables)) > 1e-2


def test_hopping_is_never_worse_than_the_starts_alone(run, shop):
    alone = run(starts=1)
    hopped = run(starts=1, hops=2)
    assert [start.kind for start in hopped.starts] == ["random", "hop", "hop"]
    assert len({start.index for start in hopped.starts}) == 3
    np.testing.assert_array_equal(hopped.starts[0].variables, alone.starts[0].variables)
    assert merit(hopped, shop) >= merit(alone, shop)
    assert hopped.finished.check.passed
    assert hopped.best.index in {start.index for start in hopped.starts}


def test_hops_set_out_from_the_best_finished_motion_of_the_batches_before(run, monkeypatch):
    """Four at a time, whoever is first; a hop that was given up changes nothing."""
    module = importlib.import_module("expdesign.solver.search")
    one = run(starts=1)
    gains = [-1.0, -np.inf, 2.0, 1.0, 1.5, 3.0]
    seen = []

    def hop(shop, monitor, index, origin, screening):
        gain = gains[len(seen)]
        seen.append((origin.mu[0, 0], screening))
        record = dataclasses.replace(one.starts[0].stages[-1], objective=gain)
        result = dataclasses.replace(one.starts[0], index=index, kind="hop", stages=(record,))
        if not np.isfinite(gain):
            return dataclasses.replace(result, merit=gain), None
        # Marked by its gain, so that the next origin tells where it came from.
        mu = one.finished.trajectory.mu.copy()
        mu[0, 0] = gain
        trajectory = dataclasses.replace(one.finished.trajectory, mu=mu)
        finished = dataclasses.replace(one.finished, trajectory=trajectory)
        return result, module._Candidate(1000.0 + gain, finished, result)

    monkeypatch.setattr(module, "_hop_job", hop)
    result = run(starts=1, hops=6)
    first = one.finished.trajectory.mu[0, 0]
    assert [origin for origin, _ in seen] == [first] * 4 + [2.0] * 2
    assert [screening.reference[-1].objective for _, screening in seen[4:]] == [2.0, 2.0]
    assert result.finished.trajectory.mu[0, 0] == 3.0
    assert result.best.index == 7
    assert len(result.starts) == 7


def test_the_number_of_workers_changes_nothing(build):
    make = build(design={"max_iterations": 2})
    jobs = [Job(_random_job, (index,)) for index in (1, 2)]
    one, two = (list(run_jobs(make, jobs, workers, SilentMonitor())) for workers in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.variables, b.variables)
        assert (a.index, a.merit, a.iterations, a.trace) == (
            b.index,
            b.merit,
            b.iterations,
            b.trace,
        )


def test_no_start_keeps_the_limits(run, monkeypatch):
    """What the starts came to is said and kept."""
    from expdesign.solver import start as module
    from expdesign.solver.shrink import Shrunk

    def hopeless(problem, trajectory):
        return Shrunk(trajectory, 0.8, kept=False)

    monkeypatch.setattr(module, "shrink_to_limits", hopeless)
    with pytest.raises(NoDesignError, match="none of 1 starts") as caught:
        run(starts=1)
    assert len(caught.value.starts) == 1
    assert caught.value.starts[0].merit == -np.inf
    assert caught.value.starts[0].status in str(caught.value)
