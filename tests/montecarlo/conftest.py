import pytest

from estimation.montecarlo import run_study
from tests.montecarlo.examples import DESIGN, small


@pytest.fixture(scope="session")
def study():
    """Return a study of four repetitions."""
    return run_study(small(), DESIGN)
