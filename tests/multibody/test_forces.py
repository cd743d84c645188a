"""Lengths and forces of the model against MuJoCo's, for the same rigid bodies."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from expdesign.robot import load_robot
from tests.multibody.driven import motion
from tests.multibody.inverse import ExactMachine
from tests.multibody.machine import Bodies, Body, Geometry

ROBOT = load_robot("palida")
GEOMETRY = Geometry.of(ROBOT)
BODIES = Bodies()
DESIGN = json.loads(
    (Path(__file__).parents[2] / "benchmarks" / "designs" / "palida.json").read_text()
)
STATES = motion(DESIGN, np.linspace(0, 2 * np.pi / DESIGN["omega"], 120, endpoint=False))
SMALL = 1e-9
"""N: what MuJoCo's rounding leaves of 230 N, with room to spare."""


@pytest.fixture(scope="module")
def exact():
    return ExactMachine(GEOMETRY, BODIES).simulate(*STATES)


def test_the_struts_move_as_the_model_says(exact):
    expected = ROBOT.strut_motion(*STATES)
    for ours, name in ((expected.length, 2), (expected.alpha, 0), (expected.beta, 1)):
        np.testing.assert_allclose(exact.joints[:, 6 + name :: 3], ours, rtol=0, atol=1e-12)
    for ours, name in (
        (expected.length_rate, 2),
        (expected.alpha_rate, 0),
        (expected.beta_rate, 1),
    ):
        np.testing.assert_allclose(exact.rates[:, 6 + name :: 3], ours, rtol=0, atol=1e-11)


def test_the_forces_are_those_of_the_model(exact):
    parameters = BODIES.parameters(GEOMETRY.platform_joints)
    forces = ROBOT.actuator_forces(*STATES, parameters)
    assert np.ptp(forces) > 200
    np.testing.assert_allclose(exact.forces, forces, rtol=0, atol=SMALL)


@pytest.mark.parametrize(
    ("part", "changed"),
    [
        ("ring", Body(0.6, (0, 0, 0), (0.4, 0.3, 0.3))),
        ("stator", Body(4.0, (0, 0, 0.2), (0.5, 0.3, 0.25))),
        ("slider", Body(1.5, (0, 0, -0.3), (0.3, 0.2, 0.15))),
        ("platform", Body(6.0, (0, 0, -0.15), (0.2, 0.3, 0.4))),
    ],
)
def test_every_body_counts_as_the_model_says(part, changed):
    bodies = replace(BODIES, **{part: changed})
    few = [values[::12] for values in STATES]
    forces = ExactMachine(GEOMETRY, bodies).simulate(*few).forces
    ours = ROBOT.actuator_forces(*few, bodies.parameters(GEOMETRY.platform_joints))
    assert np.abs(ours - ROBOT.actuator_forces(*few)).max() > 1
    np.testing.assert_allclose(forces, ours, rtol=0, atol=SMALL)


def test_what_the_model_does_not_have_is_seen():
    """A slider whose centre is 10 mm off the strut's axis is no machine of the model."""
    slider = replace(BODIES.slider, centre=(0.01, 0, BODIES.slider.centre[2]))
    bodies = replace(BODIES, slider=slider)
    few = [values[::12] for values in STATES]
    forces = ExactMachine(GEOMETRY, bodies).simulate(*few).forces
    ours = ROBOT.actuator_forces(*few, bodies.parameters(GEOMETRY.platform_joints))
    assert np.abs(forces - ours).max() > 0.1
