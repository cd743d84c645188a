"""What a call of a robot takes, one instant at a time and many at once: PaLiDA."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

import expdesign
from constraints.arrays import Array

TITLE = "Time of a call"

_MANY = 1000
_AT_ONCE = 50
"""Calls between two looks at the clock."""
_LONG_ENOUGH = 4.0
"""Seconds for each function."""


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each function: microseconds of a single call, and per instant of many."""
    robot = expdesign.load_robot("palida")
    rng = np.random.default_rng(0)
    poses = robot.home + 0.01 * rng.normal(size=(_MANY, 6))
    many = poses, rng.normal(size=(_MANY, 6)), rng.normal(size=(_MANY, 6))
    one = tuple(part[0].copy() for part in many)
    parameters = 1.1 * robot.parameters
    functions: dict[str, Callable[..., Any]] = {
        "actuator_forces": robot.actuator_forces,
        "actuator_forces, parameters=": partial(robot.actuator_forces, parameters=parameters),
        "regressor": robot.regressor,
        "strut_motion": robot.strut_motion,
        "inverse_kinematics": lambda pose, *_: robot.inverse_kinematics(pose),
        "length_jacobian": lambda pose, *_: robot.length_jacobian(pose),
    }
    for name, function in functions.items():
        single = _microseconds(function, one, _AT_ONCE)
        each = _microseconds(function, many, 1) / _MANY
        yield {
            "function": name,
            "single call, us: fastest": round(float(single.min()), 1),
            "median": round(float(np.median(single)), 1),
            f"of {_MANY} at once, us each: median": round(float(np.median(each)), 1),
        }


def _microseconds(function: Callable[..., Any], arguments: tuple[Array, ...], count: int) -> Array:
    """Return how long a call takes, over and over."""
    function(*arguments)
    taken, end = [], time.perf_counter() + _LONG_ENOUGH
    while time.perf_counter() < end:
        began = time.perf_counter()
        for _ in range(count):
            function(*arguments)
        taken.append((time.perf_counter() - began) / count * 1e6)
    return np.array(taken)


def summary(table: pd.DataFrame) -> str:
    """Return what a single call of the forces takes."""
    first = table.iloc[0]
    return (
        f"a single call of {first.iloc[0]} takes {first.iloc[1]} us at its fastest, "
        f"{first.iloc[2]} us in the median"
    )
