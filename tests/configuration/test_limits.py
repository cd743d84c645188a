import math

import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.configuration import InputError
from expdesign.configuration.document import Document, Located
from expdesign.configuration.errors import collect
from expdesign.configuration.limits import Limits, limits_as_written, resolve_limits
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.schema import Section, validate


class _File(Section):
    limits: Limits


def _resolve(*raws):
    sources, problems = [], []
    for raw in raws:
        with collect(problems):
            file = validate(_File, {"limits": raw}, Document({}))
            sources.append(Located(file.limits, Document({}), ("limits",)))
    if problems:
        raise InputError(problems)
    return resolve_limits(sources)


def _problem(raw):
    with pytest.raises(InputError) as caught:
        _resolve(raw)
    (problem,) = caught.value.problems
    return problem


@pytest.mark.parametrize(
    ("raw", "lower", "upper"),
    [
        ({"strut_length": [0.4, "900 mm"]}, [0.4] * 6, [0.9] * 6),
        (
            {"strut_length": [[0.4, 0.9]] * 5 + [[0.5, 0.8]]},
            [0.4] * 5 + [0.5],
            [0.9] * 5 + [0.8],
        ),
        ({"strut_speed": 2}, [-2] * 6, [2] * 6),
        ({"strut_speed": ["1 m/s", 2, 3, 4, 5, 6]}, [-1, -2, -3, -4, -5, -6], [1, 2, 3, 4, 5, 6]),
        ({"actuator_force": [-100, 230]}, [-100] * 6, [230] * 6),
        ({"actuator_force": [[-1, 2]] * 6}, [-1] * 6, [2] * 6),
        ({"actuator_force": [[-1, 2], 3, 3, 3, 3, 3]}, [-1, *[-3] * 5], [2, *[3] * 5]),
        ({"tilt": "20 deg"}, [-math.inf], [math.radians(20)]),
        ({"jacobian_condition": 10}, [-math.inf], [10]),
        ({"strut_clearance": "15 mm"}, [0.015] * 15, [math.inf] * 15),
        ({"strut_clearance": 0}, [0] * 15, [math.inf] * 15),
        ({"platform_joint_angle": "30 deg"}, [-math.inf] * 6, [math.radians(30)] * 6),
        ({"platform_joint_angle": [1, 2, 3, 1, 2, 3]}, [-math.inf] * 6, [1, 2, 3, 1, 2, 3]),
        (
            {"position": {"x": [-0.1, 0.2], "z": [-0.8, -0.5]}},
            [-0.1, -math.inf, -0.8],
            [0.2, math.inf, -0.5],
        ),
        (
            {"rotation": {"psi": ["-60 deg", "60 deg"]}},
            [-math.inf, -math.inf, -math.radians(60)],
            [math.inf, math.inf, math.radians(60)],
        ),
        ({"alpha": ["-35 deg", "35 deg"]}, [-math.radians(35)] * 6, [math.radians(35)] * 6),
    ],
)
def test_bounds(raw, lower, upper):
    limits, _ = _resolve(raw)
    (limit,) = limits.values()
    assert limit.key in raw
    np.testing.assert_array_equal(limit.lower, lower)
    np.testing.assert_array_equal(limit.upper, upper)
    assert limit.origin == f"configuration: limits.{limit.key}"
    # Written and read again they are the same.
    again, _ = _resolve(limits_as_written(limits, 0.1))
    np.testing.assert_array_equal(again[limit.key].lower, limit.lower)
    np.testing.assert_array_equal(again[limit.key].upper, limit.upper)


def test_unknown_limit_and_component_name_the_nearest():
    problem = _problem({"strut_lenght": [0.1, 0.2]})
    assert problem.nearest == "strut_length"
    assert "tilt" in problem.allowed
    assert "characteristic_length" in problem.allowed
    problem = _problem({"rotation": {"phy": [-1, 1]}})
    assert problem.nearest == "phi"


def test_all_problems_are_reported():
    with pytest.raises(InputError) as caught:
        _resolve({"tilt": -1, "strut_speed": 0, "unknown": 1}, {"alpha": 3})
    keys = [p.key for p in caught.value.problems]
    assert keys == ["limits.tilt", "limits.strut_speed", "limits.unknown", "limits.alpha"]


def test_later_sources_override_key_by_key():
    limits, length = _resolve(
        {
            "tilt": 0.3,
            "strut_speed": 2,
            "position": {"x": [-1, 1], "y": [-1, 1]},
            "characteristic_length": 0.1,
        },
        {"strut_speed": 1, "position": {"x": [-0.1, 0.1]}, "characteristic_length": "200 mm"},
    )
    assert limits["tilt"].upper.tolist() == [0.3]
    assert limits["strut_speed"].upper.tolist() == [1] * 6
    assert limits["position"].upper.tolist() == [0.1, 1, math.inf]
    assert length == 0.2


def test_order_is_that_of_the_catalogue():
    limits, _ = _resolve({"tilt": 0.3, "alpha": [-1, 1]})
    assert list(limits) == [key for key in limit_definitions() if key in ("alpha", "tilt")]


def test_origin_and_line():
    limit = load_robot_description("palida").limits["strut_speed"]
    assert limit.origin == "palida.yaml: limits.strut_speed"
    assert limit.file.name == "palida.yaml"
    assert limit.line > 50
