from dataclasses import replace

import pytest

from estimation.controlmodel.model import ControlModel
from expdesign.configuration.parameters import Drive, Gear
from expdesign.robot import Robot, load_robot
from tests.controlmodel.machines import ORIGIN, every_term

ROBOTS = {"palida": lambda: load_robot("palida"), "every term": every_term}


@pytest.fixture(scope="session", params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]()


@pytest.fixture(scope="session")
def palida():
    """A control model with exact signs, of a machine with gears."""
    drive = Drive(gear=Gear(lead=0.01))
    robot = Robot(replace(load_robot("palida").description, drive=drive))
    return ControlModel(robot, ORIGIN, 0.0)


@pytest.fixture(scope="session", params=["palida", "every term"])
def model(request, palida):
    """A control model with exact signs, and one with every term and smoothed signs."""
    return palida if request.param == "palida" else ControlModel(every_term(), ORIGIN, 0.02)
