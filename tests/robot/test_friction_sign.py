import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from expdesign.mechanism.term import smooth_sign

RATE = ca.SX.sym("rate")
SIGN = smooth_sign(RATE)
EVALUATED = ca.Function("sign", [RATE], [SIGN, ca.jacobian(SIGN, RATE)])


@given(rate=st.one_of(st.floats(-40, 40), st.floats(-1e300, 1e300), st.just(0.0)))
def test_the_smooth_sign_is_tanh_with_its_slope_however_steep(rate):
    sign, slope = map(float, EVALUATED(rate))
    assert abs(sign - np.tanh(rate)) < 1e-15
    assert abs(slope - (1 - np.tanh(rate)) * (1 + np.tanh(rate))) < 1e-15
