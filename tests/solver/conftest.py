from functools import partial

import pytest

from expdesign.configuration import load_run
from expdesign.experiment.setup import plan_search


@pytest.fixture(scope="package")
def build(tiny):
    """Return what builds the workshop of the tiny run; keywords change its sections."""

    def maker(**changes):
        return partial(plan_search, load_run(tiny(**changes)))

    return maker


@pytest.fixture(scope="package")
def plan(build):
    return build()()


@pytest.fixture(scope="package")
def problem(plan):
    return plan.problem
