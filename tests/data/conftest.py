"""The robot whose recordings are read."""

import pytest

from estimation.data.formats import FileFormat
from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError
from expdesign.configuration.robot import load_robot_description
from tests.data.forked import load_forked
from tests.data.recordings import recording


@pytest.fixture(scope="session")
def palida():
    return load_robot_description("palida")


@pytest.fixture
def forked(monkeypatch):
    """Let libraries that may crash read in a copy of this process, without starting Python."""
    monkeypatch.setattr(FileFormat, "_load_apart", load_forked)


@pytest.fixture
def rec():
    return recording()


@pytest.fixture
def read(palida):
    """Read a file; keywords are those of `data:`."""

    def reading(path, **section):
        return read_measurement(path, DataSection.model_validate(section), palida)

    return reading


@pytest.fixture
def refused(read):
    """Return the problems for which a file is refused."""

    def problems(path, **section):
        with pytest.raises(InputError) as caught:
            read(path, **section)
        found = caught.value.problems
        assert all(problem.file == path for problem in found)
        return found

    return problems
