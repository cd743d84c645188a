"""The same study on a Dask cluster of two worker processes."""

import builtins
from collections import deque
from functools import partial

import pytest

from estimation.montecarlo import run_study
from estimation.montecarlo.study import Workbench
from expdesign.configuration import InputError
from expdesign.workers import ClusterError, cluster_jobs
from tests.montecarlo.examples import DESIGN, Watcher, repetition_rows, small


def on_cluster(address, repetitions=4):
    return small(repetitions, workers=None, scheduler=address)


@pytest.mark.slow
def test_a_cluster_gives_the_same_digits(address, study, tmp_path):
    journal = tmp_path / "journal"
    first = Watcher(stop_at=2)
    part = run_study(on_cluster(address), DESIGN, journal, first)
    assert first.seen == [(0, 4), (1, 4), (2, 4)]
    assert part.interrupted
    whole = run_study(on_cluster(address), DESIGN, journal)
    assert repetition_rows(whole).equals(repetition_rows(study))


@pytest.mark.slow
def test_bad_input_that_shows_on_the_cluster(address, tmp_path):
    configuration = small(
        2,
        estimate={"noise": "estimated"},
        experiment={"periods": 1, "sampling": 60},
        workers=None,
        scheduler=address,
    )
    with pytest.raises(InputError) as error:
        run_study(configuration, DESIGN, tmp_path / "journal")
    assert error.value.problems[0].key == "estimate.noise"


def test_no_scheduler_there(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("expdesign.workers.cluster._CONNECT_SECONDS", 1)
    with pytest.raises(ClusterError, match=r"tcp://127.0.0.1:9 cannot be reached"):
        run_study(on_cluster("tcp://127.0.0.1:9"), DESIGN)


@pytest.mark.slow
def test_a_cluster_without_workers(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("expdesign.workers.cluster._CONNECT_SECONDS", 2)
    with (
        distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=":0") as cluster,
        pytest.raises(ClusterError, match="no workers"),
    ):
        run_study(on_cluster(cluster.scheduler_address), DESIGN)


def test_dask_is_optional(monkeypatch):
    original = builtins.__import__

    def without(name, *arguments):
        if name == "distributed":
            raise ImportError(name)
        return original(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError) as error:
        list(
            cluster_jobs(
                "tcp://127.0.0.1:9", partial(Workbench.of, small(), DESIGN), deque(), lambda: False
            )
        )
    assert error.value.problems[0].key == "scheduler"
    assert "expdesign[dask]" in error.value.problems[0].allowed
