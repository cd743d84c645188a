from functools import partial

import pytest

from expdesign.configuration import load_run
from expdesign.experiment.setup import design_task


@pytest.fixture(scope="package")
def build(tiny):
    """Return what builds the workshop of the tiny run; keywords change its sections."""

    def maker(**changes):
        return partial(design_task, load_run(tiny(**changes)))

    return maker


@pytest.fixture(scope="package")
def task(build):
    return build()()


@pytest.fixture(scope="package")
def problem(task):
    return task.problem
