import copy

import pytest

from expdesign.configuration import InputError, load_run
from expdesign.configuration.robot import load_robot_description


@pytest.fixture(scope="session")
def _palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


@pytest.fixture
def robot_mapping(_palida):
    """PaLiDA as a mapping that a test may change."""
    return copy.deepcopy(_palida)


@pytest.fixture
def run_mapping(robot_mapping):
    """A run with its robot inline, that a test may change."""
    return {"name": "test", "robot": robot_mapping}


@pytest.fixture
def problems_of():
    """Return the problems of loading a run; fails when there are none."""

    def problems(source):
        with pytest.raises(InputError) as caught:
            load_run(source)
        return caught.value.problems

    return problems


@pytest.fixture
def the_problem(problems_of):
    """Return the only problem of loading a run."""

    def problem(source):
        (only,) = problems_of(source)
        return only

    return problem
