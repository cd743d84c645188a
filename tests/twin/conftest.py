import pytest

from estimation.twin import Twin
from tests.twin.examples import TINY, configuration, motion


@pytest.fixture
def twin():
    """Return a maker of twins: keywords are those of `experiment`, and `noise`, `frequency`."""

    def make(frequency=0.5, seed=None, noise=None, **experiment):
        return Twin.of(configuration(noise, **experiment), motion(frequency), seed)

    return make


@pytest.fixture
def quiet(twin):
    """Return a maker of twins whose noise is far below everything that is looked at."""

    def make(**experiment):
        return twin(noise=TINY, **experiment)

    return make
