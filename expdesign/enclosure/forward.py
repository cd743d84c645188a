"""Forward kinematics with a proof: enclosures of the poses with given lengths of the struts.

In every cell of time a polynomial λ̂ is found that almost has the lengths q of the struts, and then
the pose near it is proved. With an inverse X of the Jacobian in the middle of the cell and
A = |1 − X ∂q/∂λ| over all poses within ρ of λ̂, Krawczyk's test |X (q(λ̂) − q)| + A ρ < ρ says
that at each instant exactly one pose within ρ has these lengths, and it is within
|X (q(λ̂) − q)| / (1 − A) of λ̂ (Neumaier, Interval methods for systems of equations, 1990, ch. 5).

A hexapod may have up to forty poses with the same lengths. A second proof shows that the machine
takes the pose found: the first cell's is connected with home, and at every instant that two cells
share, the pose of one of them is within the ρ of the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.enclosure.arithmetic import EPS, TERMS, UP
from expdesign.enclosure.instructions import EnclosedFunction
from expdesign.enclosure.matrices import TaylorMatrix
from expdesign.enclosure.paths import PiecewisePolynomials
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Term, kinematic_terms
from expdesign.robot import Robot

WITHIN = 1e-9
"""Smallest ρ, as a share of the characteristic length, and in rad."""
_TIMES_APART = 4.0
_LARGEST_CHANGE = 0.5
"""Largest A: cells in which the Jacobian changes more are divided."""
ACCURATE = 3e-9
"""Largest error of poses in the unit of `WITHIN`: cells with larger errors are divided."""
_DIVISIONS = 10
_STEPS, _MOST_STEPS = 16, 256
"""From the lengths at home, where a path begins, to the first ones; and from another pose."""
_BLOCK = 1024


class StrutLengths(Protocol):
    """Lengths of the six struts in time, m; continuous."""

    @property
    def times(self) -> Array:
        """(N + 1,), s, beginnings of the first cells and end of the last."""

    def over(self, edges: Array) -> list[TaylorModel]:
        """Return the models of the lengths over cells, (N', 2), s."""

    def with_rates(self, edges: Array) -> list[list[TaylorModel]]:
        """Return the models of lengths, speeds and accelerations over cells, (N', 2), s."""


@dataclass(frozen=True, eq=False)
class StrutPath:
    """The motion of a machine from home for lengths of the struts in time.

    Parameters
    ----------
    lengths : StrutLengths
    guess : callable
        Times (N,), s, → poses (N, 6), initial values for the poses.
    begin : float
        Time at which the path to be enclosed begins, s; before it the lengths lead from home.
    home : (6,), optional
        Pose that is connected with the first one, near or far, instead of the robot's home.
    """

    robot: Robot
    lengths: StrutLengths
    guess: Callable[[Array], Array]
    begin: float = -np.inf
    home: Array | None = None

    @cached_property
    def poses(self) -> PiecewisePolynomials:
        """The proved enclosures of the poses: see `enclosed_poses`."""
        if self.home is None:
            return enclosed_poses(self.robot, self.lengths, self.guess, self.robot.home)
        return enclosed_poses(self.robot, self.lengths, self.guess, self.home, _MOST_STEPS)

    @property
    def known_until(self) -> float:
        """Beginning of the first cell without proved poses, s; ∞ if all are proved."""
        unknown = np.flatnonzero(~np.isfinite(self.poses.error[0, 0]))
        return max(float(self.poses.times[unknown[0]]), self.begin) if unknown.size else np.inf

    @property
    def breaks(self) -> Array:
        """(K,), s, the times between which poses and lengths are one polynomial each."""
        times = self.poses.times
        return times[times >= self.begin]

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s.

        The jerk is unknown.
        """
        rough = self.poses.over(edges)
        lengths, speed, acceleration = self.lengths.with_rates(edges)
        with np.errstate(all="ignore"):  # unknown values are infinite or NaN
            pose = _tighten_poses(self._kinematics, rough, lengths)
            first, second = self._kinematics.motion(pose, speed, acceleration)
        return [*pose, *first, *second, *[TaylorModel.unknown()] * COORDINATES]

    @cached_property
    def _kinematics(self) -> EnclosedKinematics:
        return EnclosedKinematics(self.robot)


def enclosed_poses(
    robot: Robot,
    lengths: StrutLengths,
    guess: Callable[[Array], Array],
    home: Array,
    most_steps: int = _STEPS,
) -> PiecewisePolynomials:
    """Return the poses of a machine that starts at home, m and rad; arguments as of `StrutPath`.

    They are unknown from the first instant without a proof.

    Raises
    ------
    ForwardKinematicsError
        No pose with the lengths was found.
    """
    kinematics = EnclosedKinematics(robot)
    edges = np.stack([lengths.times[:-1], lengths.times[1:]], axis=1)
    found: list[_Poses] = []
    for division in range(_DIVISIONS + 1):
        parts = [
            _poses(kinematics, lengths, edges[start : start + _BLOCK], guess)
            for start in range(0, len(edges), _BLOCK)
        ]
        poses = _Poses.join(parts)
        again = ~(poses.error <= ACCURATE) & (division < _DIVISIONS)
        found.append(poses.among(~again))
        grid = np.stack([edges[again, 0], edges[again].mean(axis=1), edges[again, 1]], axis=1)
        edges = np.stack([grid[:, :-1], grid[:, 1:]], axis=2).reshape(-1, 2)
        if not len(edges):
            break
    every = _Poses.join(found)
    every = every.among(np.argsort(every.edges[:, 0], kind="stable"))
    return every.as_path(_reached_from_home(kinematics, lengths, every, home, most_steps))


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses in N cells with their proved errors."""

    edges: Array
    """(N, 2), s."""
    coefficients: Array
    """(`TERMS`, 6, N), of λ̂."""
    error: Array
    """(N,), largest distance of the pose from λ̂, as a share of the characteristic length, and in
    rad; infinite without a proof."""
    within: Array
    """(N,), ρ, within which there is no other pose, in the same unit."""
    scale: Array
    """(6,), unit of these distances in each coordinate."""

    @classmethod
    def join(cls, parts: list[_Poses]) -> _Poses:
        """Return the cells of all parts."""
        return cls(
            np.concatenate([part.edges for part in parts]),
            np.concatenate([part.coefficients for part in parts], axis=2),
            np.concatenate([part.error for part in parts]),
            np.concatenate([part.within for part in parts]),
            parts[0].scale,
        )

    def among(self, which: Mask | NDArray[np.intp]) -> _Poses:
        """Return some of the cells."""
        return _Poses(
            self.edges[which],
            self.coefficients[..., which],
            self.error[which],
            self.within[which],
            self.scale,
        )

    def at(self, end: float) -> Array:
        """Return λ̂ at the beginning (−1) or the end (1) of the cells, (N, 6)."""
        powers = end ** np.arange(TERMS)
        return np.asarray(np.tensordot(powers, self.coefficients, 1).T)

    def distances(self, first: Array, second: Array, size: Array) -> Array:
        """Return the distances of poses (N, 6), (N,), rounded up.

        `size` is the sum of the absolute terms of the poses.
        """
        rounding = 4 * TERMS * EPS * size
        return np.asarray(np.max((np.abs(first - second) + rounding) / self.scale, axis=1)) * UP

    def as_path(self, known: Mask) -> PiecewisePolynomials:
        """Return the poses as a path, unknown outside some of the cells (N,)."""
        error = np.zeros_like(self.coefficients)
        error[0] = self.scale[:, None] * np.where(known, self.error, np.inf) * UP
        times = np.append(self.edges[:, 0], self.edges[-1, 1])
        return PiecewisePolynomials(times, self.coefficients, error)


def _reached_from_home(
    kinematics: EnclosedKinematics,
    lengths: StrutLengths,
    poses: _Poses,
    start_pose: Array,
    most_steps: int,
) -> Mask:
    """Return the cells (N,) whose pose is proved to be reached from home.

    The lengths lead straight from those at home to those at the beginning of the first cell, in
    more steps if fewer prove nothing.
    """
    robot, first = kinematics.robot, lengths.over(poses.edges[:1])
    begin, slack = (
        np.concatenate(part)
        for part in zip(
            *((one.at(-np.ones(1)), one.radius + 8 * EPS * one.size) for one in first), strict=True
        )
    )
    at_home = robot.inverse_kinematics(start_pose)
    steps = _STEPS
    while True:
        way = at_home + np.linspace(0.0, 1.0, steps + 1)[:, None] * (begin - at_home)
        known = _reached(kinematics, poses, start_pose, way, slack)
        if known[0] or steps >= most_steps:
            return known
        steps = min(4 * steps, most_steps)


def _reached(
    kinematics: EnclosedKinematics, poses: _Poses, start_pose: Array, way: Array, slack: Array
) -> Mask:
    """Return the cells (N,) whose pose is reached by a way of lengths (K + 1, 6), m, and theirs."""
    steps = len(way) - 1
    start = kinematics.robot.forward_kinematics(way[:-1], np.tile(start_pose, (steps, 1)))
    start[0] = start_pose
    models = [TaylorModel(column[None, :].copy(), np.zeros(1)) for column in start.T]
    ways = []
    for model, ends, wide in zip(kinematics.lengths(models), way.T, slack, strict=True):
        least, most = model.bounds()
        low = np.minimum(ends[:-1], ends[1:]) - wide - most
        high = np.maximum(ends[:-1], ends[1:]) + wide - least
        ways.append(TaylorModel.within(np.minimum(low, 0.0), np.maximum(high, 0.0)))
    error, within = _prove_poses(kinematics, models, ways)
    errors = np.concatenate([error, poses.error])
    withins = np.concatenate([within, poses.within])
    sizes = np.concatenate([np.abs(start), np.abs(poses.coefficients).sum(axis=0).T])
    ends = np.concatenate([start, poses.at(1.0)[:-1]])
    begins = np.concatenate([start[1:], poses.at(-1.0)])
    gaps = poses.distances(begins, ends, sizes[1:] + sizes[:-1])
    # The pose of one of the two is within the ρ of the other.
    joined = (gaps + errors[1:] < withins[:-1]) | (gaps + errors[:-1] < withins[1:])
    joined &= np.isfinite(errors[1:]) & np.isfinite(errors[0])
    known: Mask = np.logical_and.accumulate(joined)[steps - 1 :]
    return known


def _poses(
    kinematics: EnclosedKinematics,
    lengths: StrutLengths,
    edges: Array,
    guess: Callable[[Array], Array],
) -> _Poses:
    """Find the poses in cells (N, 2), with their proofs."""
    robot, cells = kinematics.robot, len(edges)
    wanted = lengths.over(edges)
    nodes = np.cos(np.pi * (np.arange(TERMS) + 0.5) / TERMS)
    # (K, N, 6), lengths at the nodes of all cells
    values = np.stack(
        [np.stack([model.at(np.full(cells, node)) for model in wanted], axis=1) for node in nodes]
    )
    middle, half = edges.mean(axis=1), np.diff(edges, axis=1)[:, 0] / 2
    times = (middle + nodes[:, None] * half).ravel()
    solved = robot.forward_kinematics(values.reshape(-1, ACTUATORS), guess(times))
    at_nodes = solved.reshape(TERMS, cells, COORDINATES)
    inverse = np.linalg.inv(np.vander(nodes, TERMS, increasing=True))
    coefficients = np.tensordot(inverse, at_nodes, 1).swapaxes(1, 2)
    pose = [TaylorModel(coefficients[:, i].copy(), np.zeros(1)) for i in range(COORDINATES)]
    with np.errstate(all="ignore"):
        off = [a - b for a, b in zip(kinematics.lengths(pose), wanted, strict=True)]
        error, within = _prove_poses(kinematics, pose, off)
    return _Poses(edges, coefficients, error, within, _scale(robot))


def _tighten_poses(
    kinematics: EnclosedKinematics, pose: list[TaylorModel], lengths: list[TaylorModel]
) -> list[TaylorModel]:
    """Tighten known models of poses with the lengths of a shorter cell.

    The remainder of a polynomial shrinks with the cell, so a part of a cell gives tighter bounds
    than the cell.
    """
    scale = _scale(kinematics.robot)
    rough = [TaylorModel(model.coefficients, np.zeros(1)) for model in pose]
    x, usable = _inverse_at_middle(kinematics, rough)
    off = [a - b for a, b in zip(kinematics.lengths(rough), lengths, strict=True)]
    lacking = np.stack([_padded_coefficients(model) for model in off], axis=2)
    steps = (x @ lacking[..., None])[..., 0]
    steps = np.where(usable[:, None] & np.isfinite(steps), steps, 0.0)
    moved = [
        TaylorModel(_padded_coefficients(model) - steps[:, :, i], np.zeros(1))
        for i, model in enumerate(rough)
    ]
    # Both bounds hold: the known one, at this distance from the new polynomials, and the proof.
    shift = np.abs(steps).sum(axis=0)
    before = np.stack([model.radius + shift[:, i] for i, model in enumerate(pose)], axis=1)
    before += (
        4 * EPS * np.stack([np.abs(model.coefficients).sum(axis=0) for model in moved], axis=1)
    )
    least = np.max(before / scale, axis=1) * UP
    off = [a - b for a, b in zip(kinematics.lengths(moved), lengths, strict=True)]
    error, _ = _prove_poses(kinematics, moved, off, np.where(np.isfinite(least), least, 0.0))
    error = np.where(np.isfinite(least), np.minimum(error, least), np.inf) * UP
    return [
        TaylorModel(model.coefficients, share * error)
        for model, share in zip(moved, scale, strict=True)
    ]


def _inverse_at_middle(
    kinematics: EnclosedKinematics, pose: list[TaylorModel]
) -> tuple[Array, Mask]:
    """Return approximately (∂q/∂λ)⁻¹ in the middle of the cells, (N, 6, 6), and where it exists."""
    middle = np.stack([model.coefficients[0] for model in pose], axis=1)
    jacobian = kinematics.robot.length_jacobian(middle)
    usable: Mask = np.all(np.isfinite(jacobian), axis=(1, 2))
    jacobian = np.where(usable[:, None, None], jacobian, np.eye(ACTUATORS))
    usable &= np.linalg.det(jacobian) != 0
    return np.linalg.inv(np.where(usable[:, None, None], jacobian, np.eye(ACTUATORS))), usable


def _padded_coefficients(model: TaylorModel) -> Array:
    """Return the coefficients, filled up with zeros, (`TERMS`, N)."""
    found = np.zeros((TERMS, model.coefficients.shape[1]))
    found[: len(model.coefficients)] = model.coefficients
    return found


def _prove_poses(
    kinematics: EnclosedKinematics,
    pose: list[TaylorModel],
    off: list[TaylorModel],
    least: Array | float = WITHIN,
) -> tuple[Array, Array]:
    """Return the proved error of λ̂, whose lengths have the residual `off`, and ρ, (N,) each.

    ρ is at least `least`.
    """
    robot = kinematics.robot
    cells, scale = pose[0].coefficients.shape[1], _scale(robot)
    x, usable = _inverse_at_middle(kinematics, pose)
    sizes = np.stack([np.broadcast_to(model.size, cells) for model in off], axis=1)
    step = np.max((np.abs(x) @ sizes[:, :, None])[:, :, 0] / scale, axis=1) * UP
    within = np.maximum(least, _TIMES_APART * step)
    near = [
        TaylorModel(model.coefficients, model.radius + within * share * UP)
        for model, share in zip(pose, scale, strict=True)
    ]
    slope = kinematics.jacobian(near, cells)
    product = x @ slope.coefficients
    product[0] -= np.eye(ACTUATORS)
    size = np.abs(slope.coefficients).sum(axis=0)
    change = np.abs(product).sum(axis=0)
    change += np.abs(x) @ (slope.radius + 16 * EPS * size) + EPS
    share = np.max(change @ scale / scale, axis=1) * UP
    error = np.where(share < _LARGEST_CHANGE, step / (1 - share), np.inf) * UP
    return np.where(usable & (error < within), error, np.inf), within


def _scale(robot: Robot) -> Array:
    """Return the unit of each coordinate, (6,): the characteristic length, and 1 rad."""
    return np.repeat([robot.characteristic_length, 1.0], COORDINATES // 2)


class EnclosedKinematics:
    """The kinematics of a robot for Taylor models."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._functions = _functions(kinematic_terms(robot.terms))
        self._geometry = [TaylorModel.number(value) for value in robot.geometry_vector]

    def lengths(self, pose: list[TaylorModel]) -> list[TaylorModel]:
        """Return the six lengths of a pose, m."""
        return self._functions([pose, _zero_models(), self._geometry], [0])[0]

    def jacobian(self, pose: list[TaylorModel], cells: int) -> TaylorMatrix:
        """Return ∂q/∂λ."""
        entries = self._functions([pose, _zero_models(), self._geometry], [1])[1]
        return TaylorMatrix.of(entries, ACTUATORS, cells)

    def strut_rates(
        self, pose: list[TaylorModel], rate: list[TaylorModel], acceleration: list[TaylorModel]
    ) -> tuple[list[TaylorModel], list[TaylorModel]]:
        """Return speeds and accelerations of the struts."""
        cells = max(model.radius.size for model in pose)
        jacobian = self.jacobian(pose, cells)
        # q̈ = J λ̈ + J̇ λ̇; the graph gives the second part at λ̈ = 0.
        rest = self._functions([pose, rate, self._geometry], [2])[2]
        speed, linear = (_multiply_column(jacobian, one, cells) for one in (rate, acceleration))
        return speed, [one + other for one, other in zip(linear, rest, strict=True)]

    def rate(
        self, pose: list[TaylorModel], speed: list[TaylorModel]
    ) -> tuple[list[TaylorModel], TaylorMatrix]:
        """Return λ̇ at a pose and speeds of the struts, and (∂q/∂λ)⁻¹."""
        cells = max(model.radius.size for model in pose)
        inverse = self.jacobian(pose, cells).inverse()
        return _multiply_column(inverse, speed, cells), inverse

    def motion(
        self, pose: list[TaylorModel], speed: list[TaylorModel], acceleration: list[TaylorModel]
    ) -> tuple[list[TaylorModel], list[TaylorModel]]:
        """Return λ̇ and λ̈ at a pose, and speeds and accelerations of the struts."""
        rate, inverse = self.rate(pose, speed)
        # q̈ = J λ̈ + J̇ λ̇; the graph gives the second part at λ̈ = 0.
        rest = self._functions([pose, rate, self._geometry], [2])[2]
        left = [whole - part for whole, part in zip(acceleration, rest, strict=True)]
        return rate, _multiply_column(inverse, left, len(inverse.radius))


def _multiply_column(
    matrix: TaylorMatrix, column: list[TaylorModel], cells: int
) -> list[TaylorModel]:
    return (matrix @ TaylorMatrix.of(column, ACTUATORS, cells)).models()


def _zero_models() -> list[TaylorModel]:
    return [TaylorModel.number(0.0)] * COORDINATES


@cache
def _functions(terms: tuple[Term, ...]) -> EnclosedFunction:
    """Pose, rate, geometry → lengths, ∂q/∂λ column by column, and accelerations at λ̈ = 0."""
    graph = hexapod_graph(terms)
    lengths = graph.kinematic["strut_length"]
    none = ca.SX.zeros(COORDINATES)
    rest = ca.substitute(graph.kinematic["strut_acceleration"], graph.acceleration, none)
    outputs = [lengths, ca.vec(ca.densify(ca.jacobian(lengths, graph.pose))), rest]
    return EnclosedFunction([graph.pose, graph.rate, graph.geometry.vector], outputs)
