import pytest

from estimation.controlmodel.model import ControlModel
from expdesign.robot import load_robot
from tests.controlmodel.machines import ORIGIN, every_term

ROBOTS = {"palida": lambda: load_robot("palida"), "every term": every_term}


@pytest.fixture(scope="session", params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]()


@pytest.fixture(scope="session")
def palida():
    """A control model with exact signs."""
    return ControlModel(ROBOTS["palida"](), ORIGIN, 0.0)


@pytest.fixture(scope="session", params=["palida", "every term"])
def model(request, palida):
    """A control model with exact signs, and one with every term and smoothed signs."""
    return palida if request.param == "palida" else ControlModel(every_term(), ORIGIN, 0.02)
