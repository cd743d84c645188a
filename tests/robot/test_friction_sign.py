import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from expdesign.mechanism.term import smooth_sign
from expdesign.robot import load_robot

RATE = ca.SX.sym("rate")
SIGN = smooth_sign(RATE)
EVALUATED = ca.Function("sign", [RATE], [SIGN, ca.jacobian(SIGN, RATE)])


@given(rate=st.one_of(st.floats(-40, 40), st.floats(-1e300, 1e300), st.just(0.0)))
def test_the_smooth_sign_is_tanh_with_its_slope_however_steep(rate):
    sign, slope = map(float, EVALUATED(rate))
    assert abs(sign - np.tanh(rate)) < 1e-15
    assert abs(slope - (1 - np.tanh(rate)) * (1 + np.tanh(rate))) < 1e-15


def test_rounding_errors_of_rates_at_rest_have_no_sign():
    robot = load_robot("palida")
    pose, rest = robot.home, np.zeros(6)
    rounded = 1e-17 * np.array([0, 1.6, -1.4, -0.5, -0.9, -1.9])
    still = robot.actuator_forces(pose, rest, rest)
    np.testing.assert_array_equal(robot.actuator_forces(pose, rounded, rest), still)
    rows = np.tile(pose, (2, 1)), np.stack([rounded, 1e9 * rounded]), np.zeros((2, 6))
    first, slow = robot.actuator_forces(*rows)
    np.testing.assert_allclose(first, still, rtol=1e-12)
    assert np.all(np.abs(slow - still) > 0.5)
