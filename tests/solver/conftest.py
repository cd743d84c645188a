from functools import partial

import pytest

from expdesign.configuration import load_run
from expdesign.experiment.design import build_workshop


@pytest.fixture(scope="package")
def build(tiny):
    """Return what builds the workshop of the tiny run; keywords change its sections."""

    def maker(**changes):
        return partial(build_workshop, load_run(tiny(**changes)))

    return maker


@pytest.fixture(scope="package")
def shop(build):
    return build()()


@pytest.fixture(scope="package")
def problem(shop):
    return shop.problem
