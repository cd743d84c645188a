"""The derivative of the forces, found without differentiating a factorisation, against CasADi's."""

import casadi as ca
import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.term import Friction
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import robot_from

MORE = [
    "force_offset",
    {"cable": {"rest_length": 0.6}},
    {"cogging": {"pitch": 0.024}},
    "cogging_second",
    {"gravity_compensation": {"base_x": 0.1, "base_y": 0, "base_z": -1.3, "length": 0.7}},
    {"payload": {"x": 0.05, "z": 0.11}},
    "load_friction",
    "asymmetric_friction",
    "quadratic_friction",
    "cubic_friction",
    {"stribeck": {"velocity": 0.05}},
    {"position_friction": {"length": 0.6}},
    {"force_saturation": {"force": 150}},
    "passive_viscous_friction",
    "platform_wrench",
    "platform_spring",
    "platform_drag",
]


@pytest.mark.parametrize("friction", [Friction.HELD, Friction.SMOOTH])
@pytest.mark.parametrize("terms", [[], MORE], ids=["default", "all"])
def test_it_is_the_derivative_of_the_forces(friction, terms):
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    run = {"name": "n", "robot": palida | {"terms": [*DEFAULT, *terms]}}
    robot = robot_from(load_run(run).robot)
    graph = robot.graph
    inputs = graph.inputs(friction)
    forces = graph.regressor_with(friction) @ graph.parameters
    outputs = [graph.force_slope(friction, graph.state), ca.jacobian(forces, graph.state)]
    both = ca.Function("slopes", inputs, outputs)
    rng = np.random.default_rng(0)
    parameters = rng.normal(size=len(robot.parameter_names))
    signs = {Friction.HELD: rng.choice([-1.0, 1.0], graph.signs.numel()), Friction.SMOOTH: 0.1}
    for _ in range(5):
        state = np.concatenate([robot.home + 0.03 * rng.normal(size=6), rng.normal(size=12)])
        fixed = robot.machine, parameters, robot.characteristic_length, signs[friction]
        found, expected = (value.full() for value in both(state, *fixed))
        assert np.count_nonzero(expected) > 50
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
