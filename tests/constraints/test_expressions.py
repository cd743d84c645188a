"""Every limit's expressions against independent NumPy computations."""

import itertools
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from constraints import limit_definitions

PAIRS = list(itertools.combinations(range(6), 2))
SEGMENT = "base_joints", "platform_joints"


def _evaluate(key, form, **values):
    """Return (N, rows) of a limit's expression for N instants; values (N, …)."""
    definition = limit_definitions()[key]
    symbols = {name: ca.SX.sym(name, *(value.shape[1:] or (1,))) for name, value in values.items()}
    expression = definition.smooth or definition.natural if form == "smooth" else definition.natural
    function = ca.Function("f", list(symbols.values()), [ca.densify(expression(symbols))])
    count = len(next(iter(values.values())))
    rows = np.array(
        [function(*(value[k] for value in values.values())).full().ravel() for k in range(count)]
    )
    numerical = definition.numerical if form == "natural" else None
    return rows if numerical is None else numerical(rows)


def _rotations(rng, count):
    matrices, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    return matrices * np.sign(np.linalg.det(matrices))[:, None, None]


def _unit(vectors, axis):
    return vectors / np.linalg.norm(vectors, axis=axis, keepdims=True)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_what_there_is():
    # A user's own may be there as well.
    assert list(limit_definitions()) == sorted(limit_definitions())
    assert set(limit_definitions()) >= {
        "actuator_force",
        "alpha",
        "attitude",
        "beta",
        "jacobian_condition",
        "platform_joint_angle",
        "position",
        "rotation",
        "strut_acceleration",
        "strut_clearance",
        "strut_length",
        "strut_speed",
        "tilt",
    }


@pytest.mark.parametrize(
    ("key", "quantity", "size"),
    [
        ("actuator_force", "actuator_force", 6),
        ("alpha", "alpha", 6),
        ("beta", "beta", 6),
        ("position", "position", 3),
        ("rotation", "rotation_angles", 3),
        ("strut_acceleration", "strut_acceleration", 6),
        ("strut_length", "strut_length", 6),
        ("strut_speed", "strut_speed", 6),
    ],
)
def test_limits_that_are_quantities(key, quantity, size, rng):
    values = rng.normal(size=(5, size))
    np.testing.assert_array_equal(_evaluate(key, "natural", **{quantity: values}), values)
    definition = limit_definitions()[key]
    assert quantity in definition.requires
    assert not definition.decreasing
    if definition.components:
        assert len(definition.components) == size
    else:
        assert definition.per_actuator


@pytest.mark.parametrize("key", list(limit_definitions()))
def test_definitions_read_what_they_say(key):
    definition = limit_definitions()[key]

    shapes = {
        "rotation_matrix": (3, 3),
        **dict.fromkeys(("inverse_jacobian", "jacobian"), (6, 6)),
        **dict.fromkeys(("strut_direction", "platform_joint_axes", *SEGMENT), (3, 6)),
    }

    class Recorder(dict):
        def __missing__(self, name):
            self[name] = ca.SX.sym(name, *shapes.get(name, (6, 1)))
            return self[name]

    asked = Recorder()
    natural = definition.natural(asked)
    smooth = (definition.smooth or definition.natural)(asked)
    assert set(asked) == set(definition.requires)
    numerical = definition.numerical or (lambda values: values)
    read = numerical(np.ones((3, natural.shape[0])))
    assert natural.shape[1] == smooth.shape[1] == 1
    assert read.shape == (3, smooth.shape[0])
    assert (definition.smooth is not None) or not definition.decreasing
    assert definition.kind in ("interval", "symmetric", "upper", "lower")
    assert definition.title
    rows = 6 if definition.per_actuator else 15 if definition.pairs else 1
    if not definition.components:
        assert smooth.shape[0] == rows


# --- β --------------------------------------------------------------------------------------------


def test_beta(rng):
    beta = rng.uniform(-1.5, 1.5, (40, 6))
    smooth = _evaluate("beta", "smooth", beta=beta, sin_beta=np.sin(beta))
    np.testing.assert_allclose(np.arcsin(smooth), beta, rtol=1e-12)


# --- tilt -----------------------------------------------------------------------------------------


def test_tilt_is_the_angle_between_the_z_axes(rng):
    R = _rotations(rng, 200)
    expected = np.arccos(R[:, 2, 2])
    natural = _evaluate("tilt", "natural", rotation_matrix=R)[:, 0]
    np.testing.assert_allclose(natural, expected, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.cos(natural), R[:, 2, 2], rtol=0, atol=1e-14)
    smooth = _evaluate("tilt", "smooth", rotation_matrix=R)[:, 0]
    np.testing.assert_array_equal(smooth, R[:, 2, 2])


def test_tilt_keeps_its_digits_when_it_is_small():
    angles = np.array([0.0, 1e-12, 1e-8, 1e-4, 0.3, np.pi])
    zero, one = 0 * angles, 0 * angles + 1
    R = np.array(
        [
            [np.cos(angles), zero, np.sin(angles)],
            [zero, one, zero],
            [-np.sin(angles), zero, np.cos(angles)],
        ]
    ).transpose(2, 0, 1)
    natural = _evaluate("tilt", "natural", rotation_matrix=R)[:, 0]
    np.testing.assert_allclose(natural, angles, rtol=1e-14)


def test_tilt_does_not_see_a_turn_about_either_z_axis(rng):
    R = _rotations(rng, 20)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    for turned in (R @ turn, turn @ R):
        np.testing.assert_allclose(
            _evaluate("tilt", "natural", rotation_matrix=turned),
            _evaluate("tilt", "natural", rotation_matrix=R),
            rtol=1e-12,
        )


# --- platform joints ------------------------------------------------------------------------------


def test_platform_joint_angle(rng):
    u, c = (_unit(rng.normal(size=(60, 3, 6)), axis=1) for _ in range(2))
    values = {"strut_direction": u, "platform_joint_axes": c}
    cosines = np.sum(u * c, axis=1)
    natural = _evaluate("platform_joint_angle", "natural", **values)
    np.testing.assert_allclose(natural, np.arccos(cosines), rtol=0, atol=1e-7)
    smooth = _evaluate("platform_joint_angle", "smooth", **values)
    np.testing.assert_allclose(smooth, cosines, rtol=0, atol=1e-15)
    aligned = _evaluate("platform_joint_angle", "natural", strut_direction=u, platform_joint_axes=u)
    np.testing.assert_allclose(aligned, 0, atol=1e-15)


# --- clearance ------------------------------------------------------------------------------------


def _distance(a, b, c, d):
    """Distance of the segments ab and cd by bounded least squares."""
    matrix = np.column_stack([b - a, c - d])
    found = lsq_linear(matrix, c - a, bounds=(0, 1), tol=1e-14, method="bvls")
    return np.linalg.norm(matrix @ found.x - (c - a))


def _distance_by_cases(a, b, c, d):
    """Distance of the segments ab and cd: inside both, or from an end of one to the other."""

    def to_segment(point, start, end):
        along = end - start
        s = np.clip((point - start) @ along / (along @ along), 0, 1)
        return np.linalg.norm(start + s * along - point)

    best = min(to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b))
    matrix = np.column_stack([b - a, c - d])
    st, *_ = np.linalg.lstsq(matrix, c - a, rcond=None)
    if np.all((st >= 0) & (st <= 1)):
        best = min(best, np.linalg.norm(matrix @ st - (c - a)))
    return best


def _clearances(A, B, distance=_distance_by_cases):
    return np.array(
        [[distance(a[i], b[i], a[j], b[j]) for i, j in PAIRS] for a, b in zip(A, B, strict=True)]
    )


def _natural_clearance(A, B, form="natural"):
    columns = {
        "base_joints": A.transpose(0, 2, 1),
        "platform_joints": B.transpose(0, 2, 1),
    }
    return _evaluate("strut_clearance", form, **columns)


def test_clearance_is_the_distance_of_segments(rng):
    A, B = rng.normal(size=(2, 60, 6, 3))
    natural = _natural_clearance(A, B)
    assert natural.shape == (60, 15)
    np.testing.assert_allclose(natural, _clearances(A, B), rtol=0, atol=1e-12)
    np.testing.assert_allclose(natural[:4], _clearances(A[:4], B[:4], _distance), rtol=0, atol=1e-7)
    smooth = _natural_clearance(A, B, "smooth")
    np.testing.assert_allclose(smooth, natural**2, rtol=1e-12, atol=1e-14)


def test_clearance_of_slender_bundles(rng):
    # Struts as they stand in a hexapod: nearly parallel, long against their distance.
    A = rng.normal(size=(60, 6, 3)) * [1, 1, 0.01]
    B = A + [0, 0, 5] + 0.2 * rng.normal(size=(60, 6, 3))
    np.testing.assert_allclose(_natural_clearance(A, B), _clearances(A, B), rtol=0, atol=1e-11)


@pytest.mark.parametrize("slope", [0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-2])
def test_clearance_of_parallel_and_nearly_parallel_struts(slope, rng):
    A = rng.normal(size=(20, 6, 3)) * [1, 1, 0.5]
    B = A + [0, 0, 2] + slope * rng.normal(size=(20, 6, 3))
    expected = _clearances(A, B)
    # The guard against 0/0 shifts the nearest points, by which the distance changes by the slope.
    tolerance = 1e-9 + (2e-6 if slope < 1e-5 else 0)
    np.testing.assert_allclose(_natural_clearance(A, B), expected, rtol=0, atol=tolerance)


def test_clearance_of_parallel_struts_that_do_not_overlap():
    A, B = np.zeros((1, 6, 3)), np.zeros((1, 6, 3))
    for j in range(6):
        A[0, j], B[0, j] = [j, 0, 3 * j], [j, 0, 3 * j + 1]
    expected = [np.hypot(j - i, 3 * (j - i) - 1) for i, j in PAIRS]
    np.testing.assert_allclose(_natural_clearance(A, B)[0], expected, rtol=1e-12)


def test_clearance_of_crossing_and_touching_struts():
    A = np.array([[[-1, 0, 0], [0, -1, 0], [0, 0, 1], [5, 5, 5], [5, 6, 5], [9, 9, 9]]], float)
    B = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 4], [6, 5, 5], [6, 6, 5], [9, 9, 10]]], float)
    natural = dict(zip(PAIRS, _natural_clearance(A, B)[0], strict=True))
    assert natural[0, 1] == 0
    assert natural[0, 2] == 1
    assert natural[3, 4] == 1
    np.testing.assert_allclose(list(natural.values()), _clearances(A, B)[0], atol=1e-12)


def test_clearance_is_symmetric(rng):
    A, B = rng.normal(size=(2, 10, 6, 3))
    natural = _natural_clearance(A, B)
    # Upside down, and numbered the other way round.
    np.testing.assert_allclose(_natural_clearance(B, A), natural, rtol=0, atol=1e-12)
    backwards = _natural_clearance(A[:, ::-1], B[:, ::-1])
    order = [PAIRS.index((5 - j, 5 - i)) for i, j in PAIRS]
    np.testing.assert_allclose(backwards[:, order], natural, rtol=0, atol=1e-12)


def test_squared_clearance_has_derivatives(rng):
    A, B = rng.normal(size=(2, 3, 6, 3))
    definition = limit_definitions()["strut_clearance"]
    a, b = ca.SX.sym("a", 3, 6), ca.SX.sym("b", 3, 6)
    rows = definition.smooth({"base_joints": a, "platform_joints": b})
    slope = ca.Function("s", [a, b], [ca.jacobian(rows, ca.vec(b))])
    h = 1e-6
    for k in range(3):
        found = slope(A[k].T, B[k].T).full()
        for entry in range(18):
            step = h * np.eye(18)[entry].reshape(6, 3)
            above = _natural_clearance(A[k : k + 1], B[k : k + 1] + step, "smooth")[0]
            below = _natural_clearance(A[k : k + 1], B[k : k + 1] - step, "smooth")[0]
            np.testing.assert_allclose(
                found[:, entry], (above - below) / (2 * h), rtol=0, atol=1e-5
            )


# --- condition ------------------------------------------------------------------------------------


def _matrices(rng):
    """Of condition 1 to 1e6, with single, clustered and equal extreme singular values."""
    for condition in (1, 1.001, 2, 10, 1e3, 1e6):
        for spectrum in (
            np.geomspace(1, condition, 6),
            [1, 1, 1, condition, condition, condition],
            [1, condition, condition, condition, condition, condition],
            [1, 1, 1, 1, 1, condition],
            [1, *rng.uniform(1, condition, 4), condition],
        ):
            for scale in (1e-3, 1, 1e4):
                U, V = (np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(2))
                yield scale * (U * spectrum) @ V.T


def test_condition_by_the_norms_of_a_matrix_and_its_inverse(rng):
    permuted = np.eye(6)[rng.permutation(6)]
    shear = np.eye(6) + np.triu(np.ones((6, 6)), 1)
    blocks = np.kron(np.diag([1.0, 2, 3]), [[1, 1], [-1, 1]])
    matrices = np.array([np.eye(6), -permuted, shear, shear.T, blocks, *_matrices(rng)])
    natural = _evaluate("jacobian_condition", "natural", inverse_jacobian=matrices)[:, 0]
    squares = [
        np.linalg.eigvalsh(m.swapaxes(1, 2) @ m) for m in (matrices, np.linalg.inv(matrices))
    ]
    expected = np.sqrt(squares[0][:, -1] * squares[1][:, -1])
    np.testing.assert_allclose(natural, expected, rtol=1e-8)


def test_rows_by_numpy_alone_are_refused():
    with pytest.raises(ValueError, match="needs `smooth`"):
        replace(limit_definitions()["jacobian_condition"], smooth=None)


def test_condition_of_what_is_no_number(rng):
    matrices = rng.normal(size=(3, 6, 6))
    matrices[1, 2, 3] = np.nan
    natural = _evaluate("jacobian_condition", "natural", inverse_jacobian=matrices)[:, 0]
    np.testing.assert_array_equal(np.isnan(natural), [False, True, False])


def test_condition_of_singular_matrices(rng):
    singular = rng.normal(size=(6, 6))
    singular[:, 2] = singular[:, 4]
    matrices = np.array([singular, singular.T, np.diag([0.0, 1, 1, 1, 1, 1])])
    natural = _evaluate("jacobian_condition", "natural", inverse_jacobian=matrices)[:, 0]
    assert np.all(natural > 1e12)


def test_condition_of_the_optimiser_is_never_below_the_true_one(rng):
    matrices = np.array([*_matrices(rng), *rng.normal(size=(300, 6, 6))])
    natural = np.linalg.cond(matrices)
    matrices, natural = matrices[natural < 1e4], natural[natural < 1e4]
    definition = limit_definitions()["jacobian_condition"]
    assert definition.conservative
    both = {"inverse_jacobian": matrices, "jacobian": np.linalg.inv(matrices)}
    smooth = _evaluate("jacobian_condition", "smooth", **both)[:, 0]
    above = smooth - definition.transform(natural)
    assert np.min(above) > -1e-9
    # Documented: at most 2 log(6)/p with p = 16.
    assert np.max(above) <= 2 * np.log(6) / 16 + 1e-9


def test_condition_of_the_optimiser_has_derivatives_where_singular_values_coincide():
    definition = limit_definitions()["jacobian_condition"]
    matrix = ca.SX.sym("G", 6, 6)
    smooth = definition.smooth({"inverse_jacobian": matrix, "jacobian": ca.inv(matrix)})
    slope = ca.Function("s", [matrix], [ca.jacobian(smooth, ca.vec(matrix))])
    for spectrum in ([1.0] * 6, [1, 1, 2, 2, 3, 3]):
        assert np.all(np.isfinite(slope(np.diag(spectrum)).full()))


def test_theta_is_counted_from_the_nearest_of_zero_and_a_half_turn():
    theta = np.radians([0, 30, -80, 89, 100, 170, 180, -170, -100])
    zero, cosine, sine = 0 * theta, np.cos(theta), np.sin(theta)
    about_y = np.array([[cosine, zero, sine], [zero, zero + 1, zero], [-sine, zero, cosine]])
    about_y = about_y.transpose(2, 0, 1)
    turned = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]]) @ about_y
    spun = turned @ np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    for rotation in (about_y, turned, spun):
        found = _evaluate("attitude", "natural", rotation_matrix=rotation)[:, 0]
        np.testing.assert_allclose(
            np.degrees(found), [0, 30, -80, 89, 80, 10, 0, -10, -80], atol=1e-9
        )


# --- both forms of a limit ------------------------------------------------------------------------


def _instants(rng, count):
    """Random values of the quantities that smooth limits read, consistent with each other."""
    beta = rng.uniform(-1.5, 1.5, (count, 6))
    base, tips, direction, axes = rng.normal(size=(4, count, 3, 6))
    inverse = rng.normal(size=(count, 6, 6))
    return {
        "beta": beta,
        "sin_beta": np.sin(beta),
        "rotation_matrix": _rotations(rng, count),
        "strut_direction": _unit(direction, axis=1),
        "platform_joint_axes": _unit(axes, axis=1),
        "base_joints": base,
        "platform_joints": tips,
        "inverse_jacobian": inverse,
        "jacobian": np.linalg.inv(inverse),
    }


@pytest.mark.parametrize(
    "key", [key for key, definition in limit_definitions().items() if definition.smooth]
)
def test_both_forms_agree_on_what_is_admitted(key, rng):
    definition = limit_definitions()[key]
    instants = _instants(rng, 60)
    values = {name: instants[name] for name in definition.requires}
    natural, smooth = (_evaluate(key, form, **values) for form in ("natural", "smooth"))
    for bound in np.quantile(natural, [0.03, 0.2, 0.5, 0.8, 0.97]):
        there = definition.transform(np.array(bound))
        above = smooth - there if not definition.decreasing else there - smooth
        clear = np.abs(natural - bound) > 1e-9
        if definition.conservative:
            # What the optimiser admits, the user admits; the converse need not hold.
            assert definition.kind == "upper"
            assert np.all(natural[(above <= 0) & clear] <= bound)
        else:
            np.testing.assert_array_equal((above > 0)[clear], (natural > bound)[clear])


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [
        ("attitude", -np.pi / 2, np.pi / 2),
        ("beta", -np.pi / 2, np.pi / 2),
        ("tilt", 0, np.pi),
        ("platform_joint_angle", 0, np.pi),
        ("strut_clearance", 0, 10),
        ("jacobian_condition", 1, 1e6),
    ],
)
def test_transforms_are_monotone(key, low, high):
    definition = limit_definitions()[key]
    steps = np.diff(definition.transform(np.linspace(low, high, 1001)))
    assert np.all(-steps > 0 if definition.decreasing else steps > 0)
