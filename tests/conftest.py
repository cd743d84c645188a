"""What all tests share: the programs that some need, and how examples are drawn."""

import contextlib
import copy
import importlib
import os
import shutil

import pytest
from hypothesis import settings

import expdesign

# How long an example takes is not what is tested; continuous integration draws the same ones.
settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_collection_modifyitems(items):
    """Begin with the files that take long: a long test at the end would run alone."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True)
def _system_programs(request):
    """Skip a test whose marker `system` names a missing program; fail it where that is a must."""
    for marker in request.node.iter_markers("system"):
        if not marker.args or not all(isinstance(name, str) for name in marker.args):
            pytest.fail('the marker `system` names the programs needed, e.g. system("chromium")')
        missing = [name for name in marker.args if shutil.which(name) is None]
        if missing:
            reason = f"needs the program {', '.join(missing)}, which is not installed"
            if os.environ.get("EXPDESIGN_REQUIRE_SYSTEM") == "1":
                pytest.fail(reason)
            pytest.skip(reason)


_TINY = {
    "name": "tiny",
    "robot": "palida",
    "trajectory": {
        "harmonics": 2,
        "frequency": [0.2, 0.6],
        "samples": 24,
        "controller_period": 0.01,
    },
    "design": {"starts": 1, "seed": 0, "smoothing": [0.4, 0.2], "max_iterations": 10},
    "experiment": {"sampling": 100, "periods": 3},
    "workers": 1,
}


@pytest.fixture(scope="session")
def tiny():
    """Return a maker of run mappings for PaLiDA that take seconds; keywords change sections."""

    def mapping(**changes):
        found = copy.deepcopy(_TINY)
        for key, value in changes.items():
            if isinstance(value, dict) and isinstance(found.get(key, {}), dict):
                found[key] = {**found.get(key, {}), **value}
            else:
                found[key] = value
        return found

    return mapping


@pytest.fixture(scope="session")
def tiny_result(tiny):
    """Return the design of the tiny run: with the full recheck and finish, in this process."""
    return expdesign.design(tiny())


@pytest.fixture(scope="session")
def cheaper():
    """Return a context in which the finish has one round, on a coarser grid, in this process."""

    @contextlib.contextmanager
    def context():
        recheck, jobs = (
            importlib.import_module(f"expdesign.{name}")
            for name in ("recheck.judge", "solver.jobs")
        )
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recheck, "LEAST_POINTS", 400)
            patch.setattr(jobs, "_FINISH_ROUNDS", 1)
            yield

    return context


@pytest.fixture
def cheap_finish(cheaper):
    """Let the finish have one round, on a coarser grid, for tests that are about other things.

    It holds in this process only: not with several workers.
    """
    with cheaper():
        yield
