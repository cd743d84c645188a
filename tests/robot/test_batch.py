"""Many samples and few are evaluated in different ways, and to the same last bit."""

import casadi as ca
import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.mechanism.graph import Friction
from expdesign.robot import LimitModel, load_robot
from expdesign.robot.batch import BatchFunction
from expdesign.robot.instructions import BLOCK, FEWEST, Instructions

UNARY = (
    *(ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.sinh, ca.cosh, ca.tanh, ca.exp),
    *(ca.log, ca.sqrt, ca.fabs, ca.sign, ca.floor, ca.ceil, ca.erf, ca.logic_not),
    *(lambda x: -x, lambda x: x * x, lambda x: 2 * x, lambda x: 1 / x, lambda x: x**3),
)
BINARY = (
    *(ca.plus, ca.minus, ca.times, ca.rdivide, ca.fmin, ca.fmax, ca.atan2, ca.hypot, ca.power),
    *(ca.lt, ca.le, ca.eq, ca.ne, ca.logic_and, ca.logic_or, ca.fmod, ca.copysign),
    lambda x, y: ca.if_else(x < y, x, 3.0),
)
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-310, 1e308]


def in_pieces(function, varying, fixed, size=FEWEST - 1):
    """Evaluate few samples at a time."""
    pieces = [function(varying[k : k + size], *fixed) for k in range(0, len(varying), size)]
    return [np.concatenate(parts) for parts in zip(*pieces, strict=True)]


def test_every_operation_of_every_value():
    x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p", 2)
    outputs = [one(x) for one in UNARY] + [two(x, y) for two in BINARY]
    outputs.append(ca.horzcat(ca.vertcat(x * p[0], 7.0, 0), ca.vertcat(p[1], y, x)))
    function = BatchFunction("all", [ca.vertcat(x, y)], [p], outputs)
    assert function.instructions > len(outputs)
    special = np.stack(np.meshgrid(SPECIAL, SPECIAL), axis=-1).reshape(-1, 2)
    drawn = np.random.default_rng(0).normal(size=(2 * BLOCK + FEWEST + 5, 2))
    varying = np.concatenate([special, drawn, special])
    fixed = (np.array([0.3, -2.0]),)
    for many, few in zip(
        function(varying, *fixed), in_pieces(function, varying, fixed), strict=True
    ):
        np.testing.assert_array_equal(many, few)
    assert Instructions.of(function._function, 1) is not None


@pytest.mark.parametrize("friction", [Friction.EXACT, Friction.SMOOTH])
def test_limits_of_a_robot(friction):
    robot = load_robot("palida")
    limits = LimitModel.of(robot)
    assert len(limits.limits) > len(limit_definitions()) / 2
    drawn = np.random.default_rng(1).normal(size=(BLOCK + FEWEST, 18))
    states = np.concatenate([robot.home, np.zeros(12)]) + drawn * np.repeat([0.03, 0.5, 5.0], 6)
    fixed = limits._fixed() if friction is Friction.EXACT else limits._fixed(0.02)
    kernel = limits._kernel(friction, slopes=False)
    for many, few in zip(kernel(states, *fixed), in_pieces(kernel, states, fixed), strict=True):
        assert many.tobytes() == few.tobytes()


@pytest.mark.parametrize("count", [1, FEWEST, BLOCK + 1])
def test_inputs_of_another_size_are_refused(count):
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    function = BatchFunction("some", [x], [p], [ca.sum1(x) * p])
    assert function(np.ones((count, 3)), np.ones(2))[0].shape == (count, 2)
    for varying, fixed in ((np.ones((count, 1)), np.ones(2)), (np.ones((count, 3)), np.ones(1))):
        with pytest.raises(ValueError, match="values, not"):
            function(varying, fixed)


def test_no_samples():
    x = ca.SX.sym("x", 3)
    assert BatchFunction("none", [x], [], [x])(np.empty((0, 3)))[0].shape == (0, 3)
