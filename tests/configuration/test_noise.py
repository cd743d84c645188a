import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from expdesign.configuration import InputError
from expdesign.configuration.document import Document, Located
from expdesign.configuration.errors import collect
from expdesign.configuration.noise import NoiseDescription, resolve_noise
from expdesign.configuration.schema import validate

STD = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
RING = [[0.5 ** min(abs(i - j), 6 - abs(i - j)) for j in range(6)] for i in range(6)]


def _resolve(*raws):
    sources, problems = [], []
    for raw in raws:
        with collect(problems):
            description = validate(NoiseDescription, raw, Document({}), ("noise",))
            sources.append(Located(description, Document({}), ("noise",)))
    with collect(problems):
        noise = resolve_noise(sources)[1]
    if problems:
        raise InputError(problems)
    return noise


def _problem(*raws):
    with pytest.raises(InputError) as caught:
        _resolve(*raws)
    (problem,) = caught.value.problems
    return problem


def test_standard_deviations_alone():
    noise = _resolve({"force_std": STD})
    np.testing.assert_array_equal(noise.force_covariance, np.diag(np.square(STD)))
    assert noise.length_covariance is None


def test_standard_deviations_with_correlation():
    noise = _resolve(
        {"length_std": [f"{s} mm" for s in STD], "length_correlation": RING, "force_std": STD}
    )
    expected = np.array(RING) * np.outer(STD, STD) * 1e-6
    np.testing.assert_allclose(noise.length_covariance, expected, rtol=1e-14)
    assert not noise.length_covariance.flags.writeable


def test_covariance():
    covariance = (np.array(RING) * np.outer(STD, STD)).tolist()
    covariance[0][0] = "1 N^2"
    noise = _resolve({"force_covariance": covariance})
    np.testing.assert_allclose(noise.force_covariance, np.array(RING) * np.outer(STD, STD))


def test_no_noise():
    assert resolve_noise([]) == (None, None)
    assert _resolve({}).force_covariance is None


@pytest.mark.parametrize(
    ("raw", "says", "key"),
    [
        (
            {"force_std": STD, "force_covariance": np.eye(6).tolist()},
            "force_covariance and force_std are both given",
            "noise.force_covariance",
        ),
        (
            {"length_correlation": RING, "length_covariance": np.eye(6).tolist()},
            "both given",
            "noise.length_covariance",
        ),
        ({"force_correlation": RING}, "without force_std", "noise.force_correlation"),
        (
            {"force_std": STD, "force_correlation": (2 * np.eye(6)).tolist()},
            "diagonal of a correlation is not 1",
            "noise.force_correlation",
        ),
        (
            {"force_covariance": (np.eye(6) - 2 * np.eye(6)[[1, 0, 2, 3, 4, 5]]).tolist()},
            "not positive definite",
            "noise.force_covariance",
        ),
        (
            {"force_covariance": np.diag([1, 1, 0, 1, 1, 1]).tolist()},
            "the entry [3][3] is 0",
            "noise.force_covariance",
        ),
        (
            {"force_std": STD, "force_correlation": np.ones((6, 6)).tolist()},
            "not positive definite",
            "noise.force_correlation",
        ),
        (
            {"force_covariance": (np.eye(6) + np.eye(6, k=2) / 10).tolist()},
            "not symmetric: the entry [1][3] is 0.1, [3][1] is 0",
            "noise.force_covariance",
        ),
    ],
)
def test_a_matrix_is_refused(raw, says, key):
    problem = _problem(raw)
    assert says in problem.message
    assert problem.key == key
    assert problem.allowed


def test_override_takes_the_place_of_what_it_contradicts():
    first = {"force_std": STD, "force_correlation": RING, "length_std": STD}
    noise = _resolve(first, {"force_covariance": np.eye(6).tolist()})
    np.testing.assert_array_equal(noise.force_covariance, np.eye(6))
    np.testing.assert_array_equal(noise.length_covariance, np.diag(np.square(STD)))
    noise = _resolve({"force_covariance": np.eye(6).tolist()}, {"force_std": STD})
    np.testing.assert_array_equal(noise.force_covariance, np.diag(np.square(STD)))
    noise = _resolve(first, {"force_std": [1] * 6})
    np.testing.assert_allclose(noise.force_covariance, RING)
    noise = _resolve(first, {"force_correlation": np.eye(6).tolist()})
    np.testing.assert_array_equal(noise.force_covariance, np.diag(np.square(STD)))


def test_order_of_magnitude_does_not_decide_about_definiteness():
    scale = 10.0 ** np.arange(-6, 6, 2)
    covariance = np.array(RING) * np.outer(scale, scale)
    noise = _resolve({"force_covariance": covariance.tolist()})
    np.testing.assert_allclose(noise.force_covariance, covariance)


@given(
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=6, max_size=6),
        min_size=6,
        max_size=6,
    )
)
def test_any_matrix_is_a_covariance_or_refused(matrix):
    try:
        noise = _resolve({"force_covariance": matrix})
    except InputError:
        return
    np.linalg.cholesky(noise.force_covariance)


def test_a_correlation_alone_does_not_go_with_an_earlier_covariance():
    problem = _problem({"force_covariance": np.eye(6).tolist()}, {"force_correlation": RING})
    assert "without force_std" in problem.message
