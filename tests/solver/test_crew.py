"""The search on a Dask cluster of two worker processes: what one process finds."""

import dataclasses
import importlib

import numpy as np
import pytest

import expdesign
from expdesign.solver.search import search
from expdesign.solver.starts import StartResult, run_start
from expdesign.workers import Job, JobRunner, Monitor
from tests.solver.test_search import QUICK, Recorder


def ends_of(monitor):
    """Return the ends of all starts and finishes, as they are reported."""
    ends = [event for event in monitor.events if event.is_end]
    return sorted((e.phase, e.start, e.iteration, e.objective, e.status) for e in ends)


@pytest.mark.slow
def test_a_cluster_finds_the_same(address, build, plan):
    make = build(design=QUICK)
    plan = dataclasses.replace(plan, iterations=4, starts=3, hops=6)
    here, monitor = Recorder(), Recorder()
    local = search(make, plan, here)
    remote = search(make, dataclasses.replace(plan, scheduler=address), monitor)
    assert remote.best.index == local.best.index
    assert [start.index for start in remote.starts] == [*range(1, 10)]
    for mine, theirs in zip(local.starts, remote.starts, strict=True):
        np.testing.assert_array_equal(theirs.variables, mine.variables)
        assert (theirs.status, theirs.merit) == (mine.status, mine.merit)
    np.testing.assert_array_equal(remote.trajectory.vector(), local.trajectory.vector())
    assert ends_of(monitor) == ends_of(here)
    assert {start for phase, start, *_ in ends_of(monitor) if phase == "done"} == {*range(1, 10)}
    assert remote.cpu_seconds > 0


@pytest.mark.slow
def test_nothing_begins_on_the_cluster_after_a_stop(address, build, plan):
    runner = JobRunner(build(design=QUICK), plan.workers, address)
    stopped = Monitor(lambda: True)
    starts = [StartResult(index, "random", np.empty(0)) for index in (1, 2)]
    jobs = [Job(run_start, (start, 1)) for start in starts]
    assert list(runner.run(jobs, stopped)) == []
    results = list(runner.run(jobs, stopped, after_stop=True))
    assert [result.index for result in results] == [1, 2]
    assert all(isinstance(result, StartResult) for result in results)


@pytest.mark.slow
def test_the_designs_of_a_sweep_are_searched_for_on_the_cluster(
    address, tiny, few_limits, tmp_path, monkeypatch
):
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())
    asked = []
    module = importlib.import_module("expdesign.workers.cluster")
    on_cluster = module.cluster_jobs

    def counted(scheduler, build, jobs, stopped):
        done = []
        asked.append((scheduler, done))
        for result in on_cluster(scheduler, build, jobs, stopped):
            done.append(result)
            yield result

    monkeypatch.setattr(module, "cluster_jobs", counted)
    quick = {"starts": 2, "max_iterations": 4}
    run = tiny(robot=few_limits, design=quick, sweep={"trajectory.harmonics": [1, 2]})
    del run["workers"]
    expdesign.run(run | {"scheduler": address}, out=tmp_path / "out")
    assert len(list((tmp_path / "out" / "designs").iterdir())) == 2
    assert {scheduler for scheduler, _ in asked} == {address}
    assert sum(len(done) == 2 for _, done in asked) >= 2
