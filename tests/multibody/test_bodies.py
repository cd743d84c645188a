"""`bodies` of a robot file: the forces of MuJoCo's machine that has the same bodies."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.robot import load_robot, robot_from
from tests.multibody.inverse import ExactMachine
from tests.multibody.machine import Bodies, Body
from tests.multibody.test_forces import GEOMETRY, SMALL, STATES

# As CAD has it: in a frame of its own, inertia with products about its own axes.
PAYLOAD = {
    "mass": 3.5,
    "centre": [0.03, -0.02, 0.05],
    "inertia": [0.02, 0.025, 0.03, 0.004, -0.003, 0.002],
    "origin": [0.01, 0.04, 0.15],
    "rotation": [0.4, -0.3, 0.8],
}
IN_MUJOCO = (
    '<body pos="0.01 0.04 0.15" euler="0.4 -0.3 0.8"><inertial pos="0.03 -0.02 0.05" mass="3.5" '
    'fullinertia="0.02 0.025 0.03 0.004 -0.003 0.002"/></body>'
)
LATERAL = Body(4.0, (0.02, -0.03, 0.1), (0.05, 0.06, 0.08))


def _as_cad(body):
    return {"mass": body.mass, "centre": list(body.centre), "inertia": list(body.inertia)}


def _robot(bodies, **more):
    """Return PaLiDA whose parameters are those of bodies, and friction."""
    mapping = load_robot("palida").description.description.model_dump(mode="json", by_alias=True)
    friction = dict(
        zip(
            load_robot("palida").parameter_names,
            bodies.parameters(GEOMETRY.platform_joints),
            strict=True,
        )
    )
    parts = {name: _as_cad(getattr(bodies, name)) for name in ("ring", "stator", "slider")}
    mapping |= {
        "bodies": {**parts, "platform": _as_cad(bodies.platform), **more},
        "platform": "general",
        "parameters": {k: v for k, v in friction.items() if k[0] in "rv"},
    }
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


@pytest.mark.parametrize(
    ("bodies", "more"),
    [
        (Bodies(), {}),
        (replace(Bodies(), platform=LATERAL), {}),
        (replace(Bodies(), platform=LATERAL, payload=IN_MUJOCO), {"payload": PAYLOAD}),
    ],
    ids=["symmetric", "lateral", "payload"],
)
def test_bodies_make_the_forces_of_a_multibody_simulator(bodies, more):
    few = [values[::6] for values in STATES]
    expected = ExactMachine(GEOMETRY, bodies).simulate(*few).forces
    assert np.ptp(expected) > 200
    forces = _robot(bodies, **more).actuator_forces(*few)
    np.testing.assert_allclose(forces, expected, rtol=0, atol=SMALL)
