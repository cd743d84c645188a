import dataclasses

import casadi as ca
import numpy as np
import pytest

from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.term import Friction, parameters_of
from expdesign.mechanism.terms import DEFAULT, parameter_unit, terms_named
from expdesign.robot import Robot, load_robot
from expdesign.robot.robot import _regressor_kernel

SYMMETRIC, GENERAL = (terms_named(DEFAULT, general=general) for general in (False, True))
PASSIVE = slice(10, 12)
DRY = slice(12, 18)
VISCOUS = slice(18, 24)


@pytest.fixture(scope="module")
def palida():
    return load_robot("palida")


@pytest.fixture(scope="module")
def states(palida):
    rng = np.random.default_rng(0)
    size = np.repeat([0.1, 0.2], 3)
    return tuple(
        center + scale * size * rng.normal(size=(30, 6))
        for center, scale in ((palida.home, 0.5), (0, 2.0), (0, 8.0))
    )


def _regressors(robot, states, friction, extra):
    graph = robot.graph
    state, geometry, _, _, symbol = graph.inputs(friction)
    function = ca.Function("A", [state, geometry, symbol], [graph.regressor_with(friction)])
    rows = np.concatenate(states, axis=1)
    return np.array(
        [
            function(row, robot.machine, symbol_value).full()
            for row, symbol_value in zip(rows, extra, strict=True)
        ]
    )


def _sliding(robot, states):
    motion = robot.strut_motion(*states)
    return np.concatenate([motion.alpha_rate, motion.beta_rate, motion.length_rate], axis=1)


# --- one graph ------------------------------------------------------------------------------------


def test_one_graph_serves_all_robots():
    first = load_robot("palida").graph
    for name in ("palida", "linuxcnc", "rubin", "mathworks", "dehaeze"):
        assert load_robot(name).graph is first
    assert hexapod_graph(SYMMETRIC) is first
    assert hexapod_graph(GENERAL) is hexapod_graph(GENERAL)
    assert hexapod_graph(GENERAL) is not first


def test_kernels_are_compiled_once():
    for terms in (SYMMETRIC, GENERAL):
        assert _regressor_kernel(terms) is _regressor_kernel(terms)


@pytest.mark.parametrize(("terms", "columns"), [(SYMMETRIC, 24), (GENERAL, 29), ((), 0)])
@pytest.mark.parametrize("friction", list(Friction))
def test_nothing_but_the_inputs_is_in_the_graph(terms, columns, friction):
    graph = hexapod_graph(terms)
    inputs = graph.inputs(friction)
    quantities = graph.quantities(friction)
    outputs = [graph.regressor_with(friction), *quantities.values()]
    # CasADi refuses free variables.
    function = ca.Function("all", inputs, outputs)
    assert not function.has_free()
    assert function.size1_out(0) == 6
    assert function.size2_out(0) == columns


def test_the_geometry_is_an_input(palida, states):
    # The same compiled functions, other numbers.
    moved = dataclasses.replace(palida.description, gravity=np.array([3.0, -4.0, 5.0]))
    forces = palida.actuator_forces(*states)
    turned = Robot(moved).actuator_forces(*states)
    assert np.min(np.max(np.abs(turned - forces), axis=1)) > 1
    np.testing.assert_array_equal(palida.actuator_forces(*states), forces)


def test_size_of_the_regressor():
    # The hand-structured regressor; the energies' automatic derivatives need 8 000 and more.
    assert _regressor_kernel(SYMMETRIC).instructions < 4500


def test_quantities_have_their_documented_shapes(palida):
    quantities = palida.graph.quantities(Friction.EXACT)
    shapes = {name: value.shape for name, value in quantities.items()}
    columns = [
        "strut_length",
        "strut_speed",
        "strut_acceleration",
        "alpha",
        "beta",
        "sin_beta",
        "alpha_rate",
        "beta_rate",
        "actuator_force",
        "platform_rate",
    ]
    assert shapes == {
        "position": (3, 1),
        "rotation_angles": (3, 1),
        "rotation_matrix": (3, 3),
        **dict.fromkeys(columns, (6, 1)),
        "strut_direction": (3, 6),
        "base_joints": (3, 6),
        "platform_joints": (3, 6),
        "platform_joint_axes": (3, 6),
        "inverse_jacobian": (6, 6),
        "jacobian": (6, 6),
    }


def test_inverse_jacobian_maps_the_twist_to_the_strut_speeds(palida, states):
    graph = palida.graph
    function = ca.Function(
        "G",
        [graph.state, graph.geometry.vector, graph.length_scale],
        [graph.kinematic["inverse_jacobian"]],
    )
    length = 0.37
    speeds = palida.strut_motion(*states).length_rate
    for pose, rate, acceleration, expected in zip(*states, speeds, strict=True):
        phi, theta, _ = pose[3:]
        e_y = np.array([0, np.cos(phi), np.sin(phi)])
        e_z = np.array([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
        omega = np.column_stack([[1, 0, 0], e_y, e_z]) @ rate[3:]
        state = np.concatenate([pose, rate, acceleration])
        G = function(state, palida.geometry_vector, length).full()
        np.testing.assert_allclose(
            G @ np.concatenate([rate[:3], length * omega]), expected, rtol=0, atol=1e-12
        )


# --- dry friction ---------------------------------------------------------------------------------


def test_smooth_friction_is_exact_for_a_tiny_width(palida, states):
    assert np.min(np.abs(_sliding(palida, states))) > 1e-5
    exact = palida.regressor(*states)
    smooth = _regressors(palida, states, Friction.SMOOTH, [1e-9] * 30)
    np.testing.assert_allclose(smooth, exact, rtol=1e-12, atol=1e-12)


def test_held_friction_is_exact_for_the_signs_of_the_rates(palida, states):
    held = _regressors(palida, states, Friction.HELD, np.sign(_sliding(palida, states)))
    np.testing.assert_allclose(held, palida.regressor(*states), rtol=1e-12, atol=1e-12)


def test_held_friction_is_linear_in_the_signs(palida, states):
    ones, none = np.ones((30, 18)), np.zeros((30, 18))
    full = _regressors(palida, states, Friction.HELD, ones)
    half = _regressors(palida, states, Friction.HELD, ones / 2)
    zero = _regressors(palida, states, Friction.HELD, none)
    np.testing.assert_allclose(half, (full + zero) / 2, rtol=1e-12, atol=1e-12)
    assert not np.any(zero[:, :, PASSIVE])
    assert not np.any(zero[:, :, DRY])
    np.testing.assert_array_equal(full[:, :, DRY], np.tile(np.eye(6), (30, 1, 1)))


def test_smooth_friction_is_tanh_of_rate_over_width(palida, states):
    motion = palida.strut_motion(*states)
    width = 0.3
    smooth = _regressors(palida, states, Friction.SMOOTH, [width] * 30)
    diagonal = np.einsum("njj->nj", smooth[:, :, DRY])
    np.testing.assert_allclose(diagonal, np.tanh(motion.length_rate / width), rtol=1e-12)
    # The passive joints slide at the strut's end, so that one width serves all.
    signs = np.concatenate(
        [
            np.tanh(rate / width)
            for rate in (
                motion.alpha_rate * motion.length,
                motion.beta_rate * motion.length,
                motion.length_rate,
            )
        ],
        axis=1,
    )
    held = _regressors(palida, states, Friction.HELD, signs)
    np.testing.assert_allclose(smooth, held, rtol=1e-12, atol=1e-12)


def test_smooth_friction_vanishes_for_a_huge_width(palida, states):
    smooth = _regressors(palida, states, Friction.SMOOTH, [1e9] * 30)
    assert np.max(np.abs(smooth[:, :, PASSIVE])) < 1e-6
    assert np.max(np.abs(smooth[:, :, DRY])) < 1e-6


def test_friction_touches_only_its_columns(palida, states):
    exact = palida.regressor(*states)
    smooth = _regressors(palida, states, Friction.SMOOTH, [0.3] * 30)
    rest = np.r_[0:10, VISCOUS]
    np.testing.assert_allclose(smooth[:, :, rest], exact[:, :, rest], rtol=1e-12, atol=1e-12)


def test_sign_of_zero_is_zero(palida, states):
    poses = states[0]
    at_rest = palida.regressor(poses, np.zeros(6), states[2])
    assert not np.any(at_rest[:, :, PASSIVE])
    assert not np.any(at_rest[:, :, DRY])
    assert not np.any(at_rest[:, :, VISCOUS])


def test_friction_opposes_the_motion(palida, states):
    # Reversing the rates reverses friction and nothing else: inertia is quadratic in them.
    pose, rate, acceleration = states
    forward = palida.regressor(pose, rate, acceleration)
    backward = palida.regressor(pose, -rate, acceleration)
    np.testing.assert_allclose(backward[:, :, 10:], -forward[:, :, 10:], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(backward[:, :, :10], forward[:, :, :10], rtol=1e-9, atol=1e-9)


def test_friction_takes_power(palida, states):
    friction = np.where(np.arange(24) >= 10, np.abs(palida.parameters), 0)
    forces = palida.actuator_forces(*states, friction)
    motion = palida.strut_motion(*states)
    power = np.sum(forces * motion.length_rate, axis=1)
    # By virtual work it is exactly what the joints dissipate.
    p = dict(zip(palida.parameter_names, friction, strict=True))
    expected = (
        p["r_alpha"] * np.sum(np.abs(motion.alpha_rate), axis=1)
        + p["r_beta"] * np.sum(np.abs(motion.beta_rate), axis=1)
        + np.abs(motion.length_rate) @ friction[DRY]
        + motion.length_rate**2 @ friction[VISCOUS]
    )
    np.testing.assert_allclose(power, expected, rtol=1e-10)


# --- invariances ----------------------------------------------------------------------------------


def _with(robot, **changes):
    return Robot(dataclasses.replace(robot.description, **changes))


def test_order_of_the_struts(palida, states):
    order = np.array([3, 0, 5, 1, 4, 2])
    d = palida.description
    p = dict(d.parameters)
    p |= {f"{k}{j + 1}": d.parameters[f"{k}{order[j] + 1}"] for k in "rv" for j in range(6)}
    permuted = _with(
        palida,
        base_joints=d.base_joints[order],
        platform_joints=d.platform_joints[order],
        alpha_axes=d.alpha_axes[order],
        platform_joint_axes=d.platform_joint_axes[order],
        parameters=p,
    )
    np.testing.assert_allclose(
        permuted.actuator_forces(*states),
        palida.actuator_forces(*states)[:, order],
        rtol=1e-11,
        atol=1e-9,
    )
    ours, theirs = permuted.strut_motion(*states), palida.strut_motion(*states)
    for field in dataclasses.fields(ours):
        np.testing.assert_allclose(
            getattr(ours, field.name), getattr(theirs, field.name)[:, order], atol=1e-12
        )


def test_direction_of_the_first_cardan_axis_does_not_matter(palida, states):
    flipped = _with(palida, alpha_axes=-palida.description.alpha_axes)
    np.testing.assert_allclose(
        flipped.regressor(*states), palida.regressor(*states), rtol=1e-11, atol=1e-11
    )
    ours, theirs = flipped.strut_motion(*states), palida.strut_motion(*states)
    np.testing.assert_allclose(ours.alpha, -theirs.alpha, atol=1e-14)
    np.testing.assert_allclose(ours.beta, -theirs.beta, atol=1e-14)


EXPONENTS = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2)}


def _dimension(unit):
    """Return the powers of kg, m and s in a unit like ``kg m^2`` or ``N s/m``."""
    total = np.zeros(3)
    numerator, _, denominator = unit.partition("/")
    for side, sign in ((numerator, 1), (denominator, -1)):
        for factor in side.split():
            symbol, _, power = factor.partition("^")
            total += sign * int(power or 1) * np.array(EXPONENTS[symbol])
    return total


@pytest.mark.parametrize("terms", [SYMMETRIC, GENERAL])
def test_units_of_the_parameters(terms, palida, states):
    """Force / parameter has a dimension: it shows when lengths and times are rescaled."""
    stretch, slow = 3.0, 1.7
    d = palida.description
    names = [parameter.name for parameter in parameters_of(terms)]
    p = dict.fromkeys(names, 1.0)
    robot = _with(palida, terms=terms, parameters=p)
    other = _with(
        palida,
        terms=terms,
        parameters=p,
        base_joints=stretch * d.base_joints,
        platform_joints=stretch * d.platform_joints,
        home=d.home * [stretch, stretch, stretch, 1, 1, 1],
        gravity=d.gravity * stretch / slow**2,
    )
    size = np.repeat([stretch, 1.0], 3)
    pose, rate, acceleration = states
    there = other.regressor(pose * size, rate * size / slow, acceleration * size / slow**2)
    here = robot.regressor(*states)
    for k, name in enumerate(names):
        powers = _dimension("N") - _dimension(parameter_unit(name))
        assert powers[0] == 0
        factor = stretch ** powers[1] * slow ** powers[2]
        np.testing.assert_allclose(
            there[:, :, k], factor * here[:, :, k], rtol=1e-9, atol=1e-9, err_msg=name
        )


def test_names_of_the_parameters():
    symmetric, general = (
        tuple(p.name for p in parameters_of(terms)) for terms in (SYMMETRIC, GENERAL)
    )
    assert len(symmetric) == 24
    assert len(general) == 29
    assert symmetric[:12] == (*(f"p{k}" for k in range(1, 11)), "r_alpha", "r_beta")
    assert symmetric[12:] == (*(f"r{j}" for j in range(1, 7)), *(f"v{j}" for j in range(1, 7)))
    assert general[:15] == (*symmetric[:10], "sx", "sy", "Ixy", "Ixz", "Iyz")
    assert general[15:] == symmetric[10:]


def test_parameters_are_read_only_and_nominal(palida):
    assert palida.parameters.shape == (24,)
    assert palida.parameters[9] == 16.307
    with pytest.raises(ValueError, match="read-only"):
        palida.parameters[0] = 1


def test_the_state_is_not_changed(palida, states):
    copies = [part.copy() for part in states]
    palida.actuator_forces(*states)
    palida.strut_motion(*states)
    for part, copy in zip(states, copies, strict=True):
        np.testing.assert_array_equal(part, copy)
