"""The forward dynamics against MuJoCo: the forces that it finds make the motion they belong to."""

import numpy as np

from estimation.feedforward.closed_loop import ForwardDynamics, Model
from tests.multibody.inverse import ExactMachine
from tests.multibody.test_forces import BODIES, GEOMETRY, ROBOT, STATES


def test_mujocos_forces_make_the_motion():
    few = [values[::10] for values in STATES]
    forces = ExactMachine(GEOMETRY, BODIES).simulate(*few).forces
    model = Model(ROBOT, BODIES.parameters(GEOMETRY.platform_joints))
    found = ForwardDynamics(model, 1e-14).acceleration(np.hstack(few[:2]), forces)
    np.testing.assert_allclose(found, few[2], rtol=0, atol=1e-9)
