"""Derived quantities: their derivatives, and those that a robot's terms determine."""

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import robot_from
from expdesign.robot.derived import ErrorShares, derived_quantities, known_quantities


def _robot(**changes):
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    return robot_from(load_run({"name": "case", "robot": {**palida, **changes}}).robot)


GENERAL = {
    "platform": "general",
    "drive": {"screw": {"lead": "5 mm", "inertia": 6.3e-5}},
    "terms": [
        *("struts", "rigid_platform", "passive_friction", "actuator_friction"),
        "force_offset",
    ],
}


@pytest.mark.parametrize("changes", [{}, GENERAL], ids=["symmetric", "general"])
def test_derivatives_are_those_of_the_values(changes):
    robot = _robot(**changes)
    rng = np.random.default_rng(1)
    values = robot.parameters + 0.03 * robot.scales * rng.uniform(-1, 1, len(robot.scales))
    found = derived_quantities(robot, values)
    assert len(found.names) == (11 if not changes else 17)
    for k, size in enumerate(1e-5 * robot.scales):
        step = size * np.eye(len(values))[k]
        ends = (derived_quantities(robot, values + sign * step).values for sign in (1, -1))
        slope = np.subtract(*ends) / (2 * size)
        scale = np.max(np.abs(found.jacobian[:, k])) + 1e-12
        np.testing.assert_allclose(slope / scale, found.jacobian[:, k] / scale, atol=1e-6)


def test_the_motor_has_the_inertia_of_the_file():
    found = derived_quantities(_robot(**GENERAL))
    assert found.values[found.names.index("motor_inertia")] == pytest.approx(6.3e-5)


@pytest.mark.parametrize("platform", ["symmetric", "general"])
def test_the_platform_alone_has_the_mass_centre_and_inertia_of_its_bodies(platform):
    body = {"mass": 12.0, "centre": [0, 0, 0.1], "inertia": [0.1, 0.12, 0.15]}
    others = {
        "stator": {"mass": 9.0, "centre": [0, 0, 0.064], "inertia": [0.05, 0.049, 0.0028]},
        "slider": {"mass": 2.5, "centre": [0, 0, -0.52], "inertia": [0.175, 0.175, 0.0003]},
        "payload": {"mass": 5.0, "centre": [0, 0, 0.2]},
    }
    known = load_robot_description("palida").description.parameters
    friction = {name: value for name, value in known.items() if name[0] != "p"}
    robot = _robot(platform=platform, parameters=friction, bodies={"platform": body, **others})
    found = derived_quantities(robot)
    values = dict(zip(found.names, found.values.tolist(), strict=True))
    assert values["mass"] == pytest.approx(12 + 6 * 2.5 + 5)
    assert values["platform_mass"] == pytest.approx(12)
    assert values["platform_centre_z"] == pytest.approx(0.1)
    moments = [values[f"platform_inertia_{axes}"] for axes in ("xx", "yy", "zz")]
    np.testing.assert_allclose(moments, body["inertia"], rtol=1e-12)
    if platform == "general":
        assert values["platform_centre_x"] == pytest.approx(0, abs=1e-12)


def test_forces_at_home_are_those_at_rest():
    robot = _robot()
    at_rest = robot.actuator_forces(robot.home, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(derived_quantities(robot).values[-6:], at_rest)


def test_only_quantities_of_identifiable_combinations_are_known():
    """Mass alone regroups into another parameter: nothing that depends on it is determined."""
    robot = _robot()
    count, mass = len(robot.parameters), robot.parameter_names.index("p10")
    regrouping = np.eye(count)
    regrouping[mass] = 0.0
    regrouping[robot.parameter_names.index("p3"), mass] = 0.1
    errors = ErrorShares(np.eye(count), np.zeros((count, 0)), ())
    found = list(known_quantities(derived_quantities(robot), errors, robot.scales, regrouping))
    assert [one.quantity for one in found] == ["inertia_zz"]
    assert {one.source for one in found} == {"noise"}
