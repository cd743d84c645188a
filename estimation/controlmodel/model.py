"""Control model: functions of a robot, origin and uncertainty of its numbers, and test vectors.

Poses, rates and accelerations are λ, λ̇, λ̈: (6, 1) each, SI and radians.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Annotated

import casadi as ca
import numpy as np

from constraints.arrays import Array
from estimation.uncertainty.forces import ForceUncertainty
from expdesign.configuration.tolerances import machine_name
from expdesign.evaluation.batch import BatchFunction, Graph
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction, Term, parameters_of
from expdesign.recheck import excitable
from expdesign.robot import Robot
from expdesign.robot.limit_model import states_at_rest
from expdesign.runfolder import ArrayTable, described, strutwise
from expdesign.runfolder.fields import ACCELERATION_COLUMNS, POSE_COLUMNS, RATE_COLUMNS

_COUNT, _SEED = 100, 0
"""States that a format tests itself with."""
DOUBLE, SINGLE = 4e-12, 1e-5
"""Deviation of a force that is allowed in double and single precision, as a share of the largest:
1e-9 N and 2.3 mN of 230 N."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a model's numbers."""

    file: Annotated[str, described("", "the robot file")]
    sha256: Annotated[str, described("", "its SHA-256")]
    made: Annotated[str, described("", "when the estimate ended, UTC; empty: not known")]
    version: Annotated[str, described("", "version of expdesign that made the model")]
    run: Annotated[str, described("", "run of the estimate; empty: not from an estimate")] = ""
    estimator: Annotated[str, described("", "ls, gm or ml")] = ""
    verdict: Annotated[str, described("", "verdict of its diagnostics")] = ""

    @property
    def sentence(self) -> str:
        """The same in words."""
        if not self.run:
            return f"nominal values of {self.file}: no estimate"
        when = f", {self.made}" if self.made else ""
        return f"run {self.run}, estimator {self.estimator}, verdict: {self.verdict}{when}"


@dataclass(frozen=True, eq=False)
class ControlModel:
    """Common input of all formats."""

    robot: Robot
    origin: Origin
    width: float
    """Of the sign of dry friction, m/s; 0: the exact one."""
    uncertainty: ForceUncertainty | None = None
    """Along a motion; None without an estimate or a motion."""

    @property
    def prefix(self) -> str:
        """The robot's name as an identifier of C, with which all names begin."""
        name = re.sub(r"\W", "_", machine_name(self.robot.name), flags=re.ASCII)
        return f"{'robot_' if name[0].isdigit() else ''}{name}_model"

    @cached_property
    def parameter_std(self) -> Array | None:
        """(m,), standard deviations of the parameters; None without an estimate."""
        if (known := self.robot.description.description.identification) is None:
            return None
        shares = known.covariance_random, known.covariance_systematic
        variances = np.sum([np.diag(np.array(share)) for share in shares], axis=0)
        return np.sqrt(np.maximum(variances[: len(self.robot.parameters)], 0.0))

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Estimated parameters that are impossible or not identified, with advice, in words."""
        robot, std = self.robot, self.parameter_std
        if std is None:
            return ()
        values, parts = robot.parameters, parameters_of(robot.terms)
        impossible = [
            f"{one.name} = {value:.3g} ± {spread:.2g} {one.unit}"
            for one, value, spread in zip(parts, values, std, strict=True)
            if value < one.lower or (one.strict and value == one.lower)
        ]
        found = []
        if impossible or not robot.realisable.consistent(values):
            which = f" ({', '.join(impossible)})" if impossible else ""
            found.append(
                f"no machine has these parameters{which}: the forces hold on motions like that of "
                "the recording, within their standard deviations; elsewhere they may not, and a "
                "mass matrix of the model may not be positive definite. What to do: estimate again "
                "with `estimate.consistent: true` for the nearest possible ones"
            )
        weak = (std > 0) & (std >= IDENTIFIABLE * robot.scales)
        if np.any(weak):
            names = ", ".join(one.name for one, is_weak in zip(parts, weak, strict=True) if is_weak)
            found.append(
                f"not identified (σ of half of their scale or more): {names}. Forces may be wrong "
                "on motions that excite them more than the recording. What to do: record such a "
                "motion as well, or state what is known (`estimate.fixed`, `estimate.prior`)"
            )
        return tuple(found)

    @cached_property
    def vectors(self) -> Vectors:
        """Test states with the model's outputs."""
        return vectors_of(self.robot, self.width, _COUNT, _SEED)

    @property
    def torque_per_force(self) -> float | None:
        """Torque of the motors per force, N m/N; None without a lead of the drives."""
        return self.robot.description.drive.torque_per_force

    @property
    def largest_force(self) -> float:
        """Limit of the actuators' forces, N; without a limit, the largest force of the vectors."""
        limit = self.robot.limit("actuator_force")
        return float(abs(self.vectors.forces).max() if limit is None else max(limit.upper))


POSE, RATE, ACCELERATION = "pose", "rate", "acceleration"


@dataclass(frozen=True, eq=False)
class ModelFunction:
    """A function of a control model."""

    inputs: tuple[str, ...]
    """Of pose, rate and acceleration."""
    function: ca.Function
    """(inputs, geometry (g), constants (c), parameters (m)) → outputs.

    Forces are given as Gᵀ column by column, w, and f of Q = G⁻ᵀ w + f: elimination with pivots is a
    hundred times more exact in single precision than CasADi's own solution. If friction depends on
    the load of the actuators, which is such a Q itself, the load's w and f come first, and the load
    is the last input.
    """
    loaded: bool = False
    """Whether it depends on the load."""


@cache
def model_functions(terms: tuple[Term, ...]) -> Mapping[str, ModelFunction]:
    """Return the functions of robots with these terms, by name.

    Those of forces are ``forces``, ``rest`` and ``friction``; those of the struts' lengths, the
    coordinates of the actuators, are ``lengths``, ``rates``, and ``slope``: lengths and, row by
    row, ∂q/∂λ.
    """
    graph = hexapod_graph(terms, open_load=True)
    states = {POSE: graph.pose, RATE: graph.rate, ACCELERATION: graph.acceleration}
    machine = [graph.geometry.vector, graph.constants, graph.parameters]

    def of(inputs: tuple[str, ...], outputs: list[ca.SX]) -> ModelFunction:
        loaded = any(ca.depends_on(part, graph.load) for part in outputs)
        given = [*(states[key] for key in inputs), *machine, *([graph.load] if loaded else [])]
        dense = [ca.densify(value) for value in outputs]
        function = ca.Function("model", given, dense, {"cse": True})
        return ModelFunction(inputs, function, loaded)

    lengths, rates = graph.kinematic["strut_length"], graph.kinematic["strut_speed"]
    signs = (graph.signs, ca.sign(sliding_speeds(graph)))
    zeros = ca.SX.zeros(COORDINATES)
    still = (
        (graph.signs, ca.SX.zeros(graph.signs.shape)),
        (graph.rate, zeros),
        (graph.acceleration, zeros),
    )
    rubbing = [
        graph.parameters[k] if sliding else ca.SX(0)
        for k, sliding in enumerate(term.is_friction for term in terms for _ in term.parameters)
    ]
    return {
        "forces": of(tuple(states), _actuator_forces(graph, signs)),
        "rest": of((POSE,), _actuator_forces(graph, *still)),
        "friction": of(
            tuple(states), _actuator_forces(graph, signs, (graph.parameters, ca.vertcat(*rubbing)))
        ),
        "lengths": of((POSE,), [lengths]),
        "rates": of((POSE, RATE), [rates]),
        "slope": of((POSE,), [lengths, ca.vec(ca.jacobian(lengths, graph.pose).T)]),
    }


def sliding_speeds(graph: HexapodGraph) -> ca.SX:
    """Return the speeds (s, 1), m/s, whose signs dry friction takes: rates times their arms.

    They have the signs of the rates. Written so, a file may smooth them with one width in m/s.
    """
    kinematic = graph.kinematic
    parts = [
        kinematic[rate.quantity] * (1 if rate.arm is None else kinematic[rate.arm])
        for rate in graph.rates
    ]
    return ca.vertcat(ca.SX(0, 1), *parts)


def _actuator_forces(graph: HexapodGraph, *pairs: tuple[ca.SX, ca.SX]) -> list[ca.SX]:
    """Return Gᵀ, w and f, with values for symbols; w and f of the load before, where it counts."""
    borne = list(graph.wrench_and_direct_forces(Friction.HELD))
    # All at once: the signs are expressions of pose and rate.
    symbols, values = map(list, zip(*pairs, strict=True))
    found = ca.substitute([ca.vec(graph.transposed), *borne], symbols, values)
    if any(ca.depends_on(part, graph.load) for part in found):
        loading = graph.parameters * ca.DM(graph.loading)
        load = ca.substitute(borne, [graph.parameters], [loading])
        others = [pair for pair in pairs if pair[0] is not graph.parameters]
        found[1:1] = ca.substitute(load, *map(list, zip(*others, strict=True)))
    return found


WRITTEN_BY = "`expdesign model`"
UNCERTAINTY = ArrayTable("uncertainty.csv", WRITTEN_BY, ForceUncertainty)


_CLEAR, _CLEAR_SHARE = 1e-3, 1e-2
"""Speeds, m/s and as a share of the struts' limit, below both of which a state is not taken: in
single precision the sign may be another."""
_GIMBAL = 0.05
"""Sine of the angle, 3°, between a strut and the first axis of its cardan joint below which a state
is not taken: the joint locks there, and its accelerations grow without bound."""
_TILT = 0.35
"""Largest rotation about home, rad: the pose of any state is found from any other."""
_DRAWN = 8
"""States drawn for each one that is returned."""


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
    """Return `count` states within the robot's limits, with the outputs of its graph there.

    `width` is that of the sign of dry friction, m/s; 0 for the exact sign.
    """
    states = random_states(robot, count, seed)
    motion = robot.strut_motion(*np.split(states, 3, axis=1))
    sliding = np.array([term.is_friction for term in robot.terms for _ in term.parameters])
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
    """Return states (N, 18) that keep the limits, the first at rest at home.

    Where dry friction changes its sign nearby, or a cardan joint locks, a state is not taken, nor
    one that is turned far from home.
    """
    home = states_at_rest(robot.home[None])
    drawn = np.concatenate(excitable.random_states(robot, _DRAWN * count, seed), axis=1)
    near = np.all(np.abs(drawn - home)[:, 3:COORDINATES] <= _TILT, axis=1)
    return np.concatenate([home, drawn[near & _clear(robot, drawn)]])[:count]


def _clear(robot: Robot, states: Array) -> Array:
    graph = robot.graph
    kinematic, geometry = graph.kinematic, graph.geometry
    squares = [1 - kinematic["sin_beta"] ** 2]
    if graph.turning:
        axes = kinematic["rotation_matrix"] @ geometry.platform_cardan_axes
        squares.append(1 - ca.sum1(axes * kinematic["strut_direction"]).T ** 2)
    limit = robot.limit("strut_speed")
    speed = _CLEAR if limit is None else min(_CLEAR, _CLEAR_SHARE * float(np.min(limit.upper)))
    clear = ca.vertcat(ca.fabs(sliding_speeds(graph)) / speed, ca.vertcat(*squares) / _GIMBAL**2)
    kernel = BatchFunction(Graph("clear", [graph.state], [geometry.vector], [ca.densify(clear)]))
    (found,) = kernel(states, robot.geometry_vector)
    return np.all(found > 1, axis=1)
