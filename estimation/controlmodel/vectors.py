"""States with what the model returns there: what every format tests itself against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.functions import sliding_speeds
from estimation.controlmodel.uncertainty import WRITTEN_BY
from expdesign.evaluation.batch import BatchFunction, Graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction
from expdesign.robot import LimitModel, Robot
from expdesign.robot.limit_model import states_at_rest
from expdesign.runfolder import ArrayTable, strutwise
from expdesign.runfolder.fields import ACCELERATION_COLUMNS, POSE_COLUMNS, RATE_COLUMNS

_TILT = 0.35
"""Rotations about home that are tried, rad."""
_SPEED, _ACCELERATION = 0.5, 5.0
"""Of the struts where the robot does not limit them, m/s and m/s²."""
_CLEAR = 1e-3
"""Speeds, m/s, below which a state is not taken: in single precision the sign may be another."""
_GIMBAL = 0.05
"""Sine of the angle, 3°, between a strut and the first axis of its cardan joint below which a state
is not taken: the joint locks there, and its accelerations grow without bound."""
_MOVING = frozenset({"actuator_force", "strut_speed", "strut_acceleration"})
_ROUNDS = 24


@dataclass(frozen=True, eq=False)
class Vectors:
    """States (N, 18) with forces, lengths and speeds (N, 6) there; the first is rest at home."""

    state: Annotated[Array, POSE_COLUMNS, RATE_COLUMNS, ACCELERATION_COLUMNS]
    forces: Annotated[Array, strutwise("Q", "N", "force of the actuator")]
    rest: Annotated[
        Array, strutwise("Q", "N", "force that holds the platform still", suffix="_rest")
    ]
    friction: Annotated[
        Array, strutwise("Q", "N", "the friction's share of the force", suffix="_friction")
    ]
    lengths: Annotated[Array, strutwise("q", "m", "coordinate of the actuator")]
    rates: Annotated[Array, strutwise("dq", "m/s", "its rate")]


VECTORS = ArrayTable("test_vectors.csv", WRITTEN_BY, Vectors)


def vectors_of(robot: Robot, width: float, count: int, seed: int) -> Vectors:
    """Return states within the robot's limits, and what its own graph returns there.

    Parameters
    ----------
    robot : Robot
    width : float
        Of the sign of dry friction, m/s; 0: the exact one.
    count : int
        Of the states.
    seed : int
    """
    states = random_states(robot, count, seed)
    motion = robot.strut_motion(*np.split(states, 3, axis=1))
    sliding = np.array([bool(term.rates) for term in robot.terms for _ in term.parameters])
    regressors = _regressors(robot, states, width)
    return Vectors(
        states,
        regressors @ robot.parameters,
        _regressors(robot, states_at_rest(states[:, :COORDINATES]), width) @ robot.parameters,
        regressors @ np.where(sliding, robot.parameters, 0.0),
        motion.length,
        motion.length_rate,
    )


def _regressors(robot: Robot, states: Array, width: float) -> Array:
    loaded = robot.with_load_at(robot.parameters)
    if width == 0:
        return loaded.regressor(*np.split(states, 3, axis=1))
    graph = robot.graph
    smooth = BatchFunction(
        Graph(
            "smoothed_regressor",
            [graph.state],
            [graph.machine, graph.width],
            [graph.regressor_with(Friction.SMOOTH)],
        )
    )
    return smooth(states, loaded.machine, np.array([width]))[0]


def random_states(robot: Robot, count: int, seed: int) -> Array:
    """Return states (N, 18) whose poses keep the limits, the first at rest at home.

    Speeds and accelerations of the struts are up to their limits. Where dry friction changes its
    sign nearby, or a cardan joint locks, a state is not taken.
    """
    rng = np.random.default_rng(seed)
    reach, found = 1.0, [states_at_rest(robot.home[None])]
    for _ in range(_ROUNDS):
        made = _evaluate_states(robot, 4 * count, reach, rng)
        found.append(made)
        if sum(map(len, found)) >= count:
            break
        # Of a robot with little room: nearer to home, which keeps all limits.
        reach *= 1.0 if len(made) > count // 4 else 0.5
    return np.concatenate(found)[:count]


def _evaluate_states(robot: Robot, count: int, reach: float, rng: np.random.Generator) -> Array:
    size = robot.characteristic_length
    room = robot.limit("position")
    low, high = np.full((2, 3), size) * [[-1], [1]]
    if room is not None:
        low = np.maximum(low, np.array(room.lower) - robot.home[:3])
        high = np.minimum(high, np.array(room.upper) - robot.home[:3])
    low, high = np.append(low, [-_TILT] * 3), np.append(high, [_TILT] * 3)
    pose = robot.home + reach * rng.uniform(low, high, (count, COORDINATES))
    pose = pose[_keep_states(robot, pose)]
    unit = np.array([1.0] * 3 + [1 / size] * 3)
    rate, acceleration = unit * rng.normal(size=(2, len(pose), COORDINATES))
    slope = robot.length_jacobian(pose)
    rate *= _share(robot, "strut_speed", _SPEED, slope, rate, rng)
    acceleration *= _share(robot, "strut_acceleration", _ACCELERATION, slope, acceleration, rng)
    states = np.concatenate([pose, rate, acceleration], axis=1)
    return states[_clear(robot, states)]


def _keep_states(robot: Robot, pose: Array) -> Array:
    model = LimitModel.of(robot)
    values = model.values(states_at_rest(pose))
    kept = np.ones(len(pose), dtype=bool)
    for limit, columns in zip(model.limits, model.columns, strict=True):
        if limit.key not in _MOVING:
            here = values[:, columns]
            kept &= np.all((here >= limit.lower) & (here <= limit.upper), axis=1)
    return kept


def _share(
    robot: Robot,
    key: str,
    otherwise: float,
    slope: Array,
    motion: Array,
    rng: np.random.Generator,
) -> Array:
    """Return factors (N, 1) that take the struts of a motion to shares of their limit."""
    limit = robot.limit(key)
    bound = otherwise if limit is None else float(np.min(np.abs(limit.upper)))
    struts = np.max(np.abs(np.einsum("nij,nj->ni", slope, motion)), axis=1, keepdims=True)
    return bound * rng.uniform(0.05, 1.0, struts.shape) / struts


def _clear(robot: Robot, states: Array) -> Array:
    graph = robot.graph
    kinematic, geometry = graph.kinematic, graph.geometry
    squares = [1 - kinematic["sin_beta"] ** 2]
    if graph.turning:
        axes = kinematic["rotation_matrix"] @ geometry.platform_cardan_axes
        squares.append(1 - ca.sum1(axes * kinematic["strut_direction"]).T ** 2)
    clear = ca.vertcat(ca.fabs(sliding_speeds(graph)) / _CLEAR, ca.vertcat(*squares) / _GIMBAL**2)
    kernel = BatchFunction(Graph("clear", [graph.state], [geometry.vector], [ca.densify(clear)]))
    (found,) = kernel(states, robot.geometry_vector)
    return np.all(found > 1, axis=1)
