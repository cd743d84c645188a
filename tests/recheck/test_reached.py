"""Which limits are reached at which instant."""

import numpy as np
import pytest

from constraints import Limit, limit_definitions
from expdesign.recheck.limit_check import REACHED, reached_limits
from expdesign.robot import LimitModel, load_robot

PALIDA = load_robot("palida")
NEAR, FAR = 1 - 0.9 * (1 - REACHED), 1 - 1.1 * (1 - REACHED)


def rows_of(key, lower, upper, values):
    definition = limit_definitions()[key]
    limit = Limit(definition, np.array(lower), np.array(upper), tuple("abc"[: len(lower)]), "")
    return reached_limits(LimitModel(PALIDA, (limit,)), np.array(values)).tolist()


def test_of_two_sides_it_is_counted_from_the_middle():
    values = [[2 + NEAR], [2 - NEAR], [2 + FAR], [2.0], [9.0], [np.nan]]
    found = rows_of("strut_length", [1.0], [3.0], values)
    assert found == [[True], [True], [False], [False], [True], [True]]


@pytest.mark.parametrize("key", ["tilt", "jacobian_condition"])
def test_of_an_upper_bound(key):
    found = rows_of(key, [-np.inf], [0.5], [[0.5 * NEAR], [0.5 * FAR], [0.0], [0.7]])
    assert found == [[True], [False], [False], [True]]


def test_of_a_lower_bound():
    found = rows_of("strut_clearance", [0.1], [np.inf], [[0.1 / NEAR], [0.1 / FAR], [0.0], [5.0]])
    assert found == [[True], [False], [True], [False]]
    assert rows_of("strut_clearance", [0.0], [np.inf], [[0.3], [-1.0]]) == [[False], [True]]


def test_what_nothing_limits_is_never_reached():
    free = [-np.inf, -1.0, -np.inf], [np.inf, 1.0, np.inf]
    assert rows_of("rotation", *free, [[9.0, NEAR, np.nan], [0.0, 0.0, 0.0]]) == [
        [False, True, False],
        [False, False, False],
    ]
