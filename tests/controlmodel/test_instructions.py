"""CasADi's instructions as lines of NumPy and C, against CasADi."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from estimation.controlmodel.rendering import NUMPY, C, lines
from expdesign.evaluation.vector_code import LIBRARY, UnknownInstructionError

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "atanh"),
    *("exp", "log", "expm1", "log1p", "sqrt", "fabs", "floor", "ceil", "sign"),
)
EXPRESSIONS = {
    **{name: getattr(ca, name)(X / 4 + 0.3) for name in UNARY},
    "acosh": ca.acosh(2 + X / 4),
    **{name: getattr(ca, name)(X, Y) for name in ("atan2", "fmin", "fmax", "fmod", "hypot")},
    "copysign": ca.copysign(X, Y),
    "pow": (2 + X) ** (Y / 3),
    "arithmetic": (X + Y * X - 1 / (3 + X)) / (-Y + X**2) + 2 * X,
    "negative constant": X - (-2.5) * Y,
    "less": (Y > X) + 2 * (X <= Y) + 4 * (X == Y) + 8 * (X != Y),
    "logic": ca.logic_and(X > 0, Y > 0) + 2 * ca.logic_or(X > 0, Y > 0) + 4 * ca.logic_not(X),
    "if": ca.if_else(X > Y, X * Y, X - Y),
}
POINTS = np.random.default_rng(0).uniform(-1, 1, (25, 2))
FUNCTION = ca.Function("all", [ca.vertcat(X, Y)], [ca.vertcat(*EXPRESSIONS.values())])
EXPECTED = np.array([FUNCTION(point).full().ravel() for point in POINTS])
PLACES = [f"out[{k}]" for k in range(len(EXPRESSIONS))]


def test_numpy_gives_casadis_numbers():
    found = lines(FUNCTION, [["x", "y"]], [PLACES], NUMPY)
    here = {"np": np, "sign_of": np.sign, "out": [0.0] * len(PLACES), "x": POINTS[:, 0]}
    exec("\n".join(found.statements), here | {"y": POINTS[:, 1]})
    values = np.stack(np.broadcast_arrays(*here["out"]), axis=1)
    np.testing.assert_allclose(values, EXPECTED, rtol=1e-13, atol=1e-15)
    assert found.read == {"x", "y"}


@pytest.mark.system("cc")
def test_c_gives_casadis_numbers(tmp_path):
    found = lines(FUNCTION, [["in[0]", "in[1]"]], [PLACES], C)
    source = f"""
    #include <math.h>
    #define R(number) number
    #define F(name) name
    static double sign_of(double x) {{ return (x > 0) - (x < 0); }}
    void all(const double *in, double *out)
    {{
        double {", ".join(found.variables)};
        {" ".join(found.statements)}
    }}"""
    (tmp_path / "all.c").write_text(source)
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o", "all.so"]
    subprocess.run([*command, "all.c", "-lm"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "all.so"))
    values = np.empty_like(EXPECTED)
    for point, row in zip(POINTS, values, strict=True):
        library.all(ctypes.c_void_p(point.ctypes.data), ctypes.c_void_p(row.ctypes.data))
    np.testing.assert_allclose(values, EXPECTED, rtol=1e-13, atol=1e-15)


def test_every_function_of_the_c_library_has_a_name_in_numpy():
    for name in set(LIBRARY.values()) - {"erf", "remainder"}:
        assert callable(getattr(np, NUMPY.called(name).removeprefix("np.")))


@pytest.mark.parametrize("expression", [ca.erf(X), ca.remainder(X, Y)])
def test_what_numpy_has_not_is_refused(expression):
    function = ca.Function("one", [X, Y], [expression])
    with pytest.raises(UnknownInstructionError):
        lines(function, [["x"], ["y"]], [["out"]], NUMPY)
