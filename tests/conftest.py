"""What all tests share: the programs that some need, how examples are drawn, what is made once.

Fixtures import the packages: the process that only hands out tests starts its workers sooner.
"""

import contextlib
import fcntl
import functools
import gc
import importlib
import os
import pickle
import shutil
import time
from pathlib import Path

import pytest
from _pytest.mark.expression import Expression
from hypothesis import settings

# How long an example takes is not what is tested; continuous integration draws the same ones.
settings.register_profile("local", deadline=None, max_examples=50)
settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

MARKS = ("slow", "system", "full")


def pytest_ignore_collect(collection_path, config):
    """Import no file without marks where a test without one is not selected: three in four."""
    selected = config.option.markexpr
    if not selected or Expression.compile(selected).evaluate(lambda *_, **__: False):
        return None
    return (collection_path.suffix == ".py" and not _is_marked(collection_path)) or None


@functools.cache
def _is_marked(file):
    text = file.read_text(encoding="utf-8")
    return any(f"mark.{name}" in text for name in MARKS)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Let the second process begin with the last file: in a fresh clone each compiles half."""
    report = yield
    if os.environ.get("PYTEST_XDIST_WORKER") == "gw1" and isinstance(collector, pytest.Directory):
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items):
    """Begin with tests that need programs, for which they wait, and with the files of slow ones.

    At the end they would run alone.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    for item in items:
        if any(map(item.get_closest_marker, MARKS)) and not _is_marked(item.path):
            raise pytest.UsageError(f"{item.path}: write `pytest.mark.` with the mark in this file")

    def place(item):
        return item.get_closest_marker("system") is None, item.path not in slow, item.path

    items.sort(key=place)


@pytest.hookimpl(tryfirst=True)
def pytest_collection():
    """Collect no garbage while modules are imported: nearly all of it stays."""
    gc.disable()


def pytest_collection_finish():
    """Leave modules and collected tests out of the garbage collections, which are fewer then."""
    gc.enable()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Skip a test whose marker `system` names a missing program; fail it where that is a must."""
    for marker in item.iter_markers("system"):
        if not marker.args or not all(isinstance(name, str) for name in marker.args):
            pytest.fail('the marker `system` names the programs needed, e.g. system("chromium")')
        required = _programs_are_a_must()
        missing = [name for name in marker.args if shutil.which(name) is None]
        if missing:
            reason = f"needs the program {', '.join(missing)}, which is not installed"
            if required:
                pytest.fail(reason)
            pytest.skip(reason)


def _programs_are_a_must():
    """Tell whether programs have to be there; wait for those that are being installed.

    Where `EXPDESIGN_INSTALLING` names a folder, its file `under-way` is there until the
    installation has ended, and then its file `installed` if that went well.
    """
    folder = os.environ.get("EXPDESIGN_INSTALLING")
    if folder is None:
        return os.environ.get("EXPDESIGN_REQUIRE_SYSTEM") == "1"
    while Path(folder, "under-way").exists():
        time.sleep(0.2)
    return Path(folder, "installed").exists()


@pytest.fixture(scope="session", autouse=True)
def _started_sooner():
    """Build the command line once for all tests, and start workers when there are jobs for them.

    Typer builds it for every call. Workers are kept for one environment, and pytest writes the
    name of the test into it. The same robot has the same base parameters, and the same recording
    the same channels, whichever test asks.
    """
    from tests.remembered import remembered_checks

    typer = importlib.import_module("typer.main")
    surroundings = importlib.import_module("expdesign.workers.local")._surroundings

    def without_the_test():
        folder, environment = surroundings()
        return folder, {k: v for k, v in environment.items() if k != "PYTEST_CURRENT_TEST"}

    with remembered_checks(), pytest.MonkeyPatch.context() as patch:
        built = functools.cache(typer.get_command)
        patch.setattr("typer.main.get_command", built)
        patch.setattr("typer.testing._get_command", built)
        patch.setattr("expdesign.workers.local._surroundings", without_the_test)
        patch.setattr("expdesign.stages.execution.prepare_workers", lambda: None)
        patch.setattr("expdesign.cli.runs._prepare_search", lambda: None)
        yield


@pytest.fixture(scope="session")
def tiny():
    """Return a maker of run mappings for PaLiDA that take seconds; keywords change sections."""
    from tests.tiny_run import tiny_run

    return tiny_run


@pytest.fixture(scope="module")
def address():
    """Return the address of a Dask cluster of two worker processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="session")
def few_limits():
    """Return PaLiDA without those limits whose derivatives take processes of their own seconds."""
    from expdesign.configuration.robot import load_robot_description

    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    for key in ("actuator_force", "jacobian_condition", "strut_clearance"):
        del robot["limits"][key]
    return robot


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """Return a way to make a folder once for all processes of a test run; its tests only read it.

    The first that asks for a name makes it, the others wait.
    """
    place = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        place = place.parent

    def once(name, make):
        folder, done = place / name, place / f"{name}.done"
        with (place / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return once


@pytest.fixture(scope="session")
def tiny_result(tiny, made_once):
    """Return the design of the tiny run, with the full recheck and finish."""
    import expdesign

    def make(folder):
        (folder / "result").write_bytes(pickle.dumps(expdesign.design(tiny())))

    return pickle.loads((made_once("tiny-result", make) / "result").read_bytes())


@pytest.fixture(scope="module", autouse=True)
def consistency_draws():
    """Draw less for the consistency of estimates; modules of tests about it override this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("estimation.uncertainty.consistency.DRAWS", 19)
        patch.setattr("estimation.uncertainty.consistency.MOST_DRAWS", 39)
        yield


@pytest.fixture(scope="session")
def cheaper():
    """Return a context in which the finish has one round, on a coarser grid, in this process."""

    @contextlib.contextmanager
    def context():
        recheck, finish = (
            importlib.import_module(f"expdesign.{name}")
            for name in ("recheck.limit_check", "solver.finish")
        )
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recheck, "LEAST_POINTS", 400)
            patch.setattr(finish, "_ROUNDS", 1)
            yield

    return context


@pytest.fixture
def cheap_finish(cheaper):
    """Let the finish have one round, on a coarser grid, for tests that are about other things.

    It holds in this process only: not with several workers.
    """
    with cheaper():
        yield
