"""The public robot: numbers in, numbers out, all from the shared symbolic graph."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.robot import add_lacking_terms
from expdesign.evaluation.batch import BatchFunction, Graph, kernel
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.realisable import Realisable
from expdesign.mechanism.strut import cardan_frames
from expdesign.mechanism.term import Friction, Term, kinematic_terms, parameters_of, scales_of
from expdesign.mechanism.terms.rigid_platform import MASS


@dataclass(frozen=True)
class StrutMotion:
    """Motion of all struts: (N, 6) each, or (6,) for a single state; m, rad, s."""

    length: Array
    length_rate: Array
    length_acceleration: Array
    alpha: Array
    alpha_rate: Array
    beta: Array
    beta_rate: Array


@kernel
def _length_kernel(terms: tuple[Term, ...]) -> Graph:
    """Pose (6) → strut lengths (6) and their Jacobian to the pose (6, 6)."""
    graph = hexapod_graph(terms)
    lengths = graph.kinematic["strut_length"]
    slope = ca.jacobian(lengths, graph.pose)
    return Graph("lengths", [graph.pose], [graph.geometry.vector], [lengths, slope])


@kernel
def _motion_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → the fields of `StrutMotion` (6 each)."""
    graph = hexapod_graph(terms)
    lengths = ("strut_length", "strut_speed", "strut_acceleration")
    names = (*lengths, "alpha", "alpha_rate", "beta", "beta_rate")
    outputs = [graph.kinematic[name] for name in names]
    return Graph("strut_motion", [graph.state], [graph.geometry.vector], outputs)


@kernel
def _regressor_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → regressor (6, m) with the exact signs of dry friction."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.EXACT)
    return Graph("regressor", [graph.state], [graph.machine], [regressor])


@kernel
def _force_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → forces (6) with the exact signs of dry friction."""
    graph = hexapod_graph(terms)
    forces = graph.force_with(Friction.EXACT)
    return Graph("forces", [graph.state], [graph.machine, graph.parameters], [forces])


@dataclass(frozen=True)
class Robot:
    """A 6-UPS hexapod: the numbers of its file, evaluated by the shared graph.

    A pose λ = (x, y, z, φ, θ, ψ), m and rad, is that of the TCP and the platform in the base frame,
    with R = Rx(φ) Ry(θ) Rz(ψ).
    """

    description: ResolvedRobot
    """Content of its file, in SI units."""
    load_parameters: tuple[float, ...] | None = None
    """(m,) parameters of the load of the actuators; None: the nominal ones."""
    lacking_parameters: tuple[float, ...] = ()
    """Parameters of the lacking terms in `extended`; empty: zero."""
    delay_std: float = 0.0
    """Standard deviation of the forces' delay, s, for which the signs of friction allow."""

    def __repr__(self) -> str:
        """Name, kind of platform, and limits."""
        limits = ", ".join(self.description.limits) or "none"
        return (
            f"Robot({self.name!r}, {self.description.platform} platform, "
            f"{len(self.parameter_names)} parameters, limits: {limits})"
        )

    @property
    def name(self) -> str:
        """Name from the robot's file."""
        return self.description.name

    @property
    def terms(self) -> tuple[Term, ...]:
        """Blocks of the regressor."""
        return self.description.terms

    @property
    def home(self) -> Array:
        """(6,) home pose: m, rad."""
        return self.description.home

    @property
    def characteristic_length(self) -> float:
        """Length that makes rotations comparable with translations, m."""
        return self.description.characteristic_length

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the regressor's columns."""
        return tuple(parameter.name for parameter in parameters_of(self.terms))

    @cached_property
    def parameters(self) -> Array:
        """(m,) nominal parameters, SI."""
        values = np.array([self.description.parameters[name] for name in self.parameter_names])
        values.setflags(write=False)
        return values

    @cached_property
    def scales(self) -> Array:
        """(m,) scales of the parameters, SI (`expdesign.mechanism.term.scales_of`)."""
        return scales_of(
            parameters_of(self.terms),
            self.parameters,
            self.description.parameters.get(MASS, 0.0),
            self.characteristic_length,
            float(np.linalg.norm(self.description.gravity)),
        )

    @cached_property
    def realisable(self) -> Realisable:
        """The physically consistent parameters."""
        joints = self.description.platform_joints
        return Realisable.of(parameters_of(self.terms), self.scales, joints)

    @cached_property
    def extended(self) -> Robot:
        """The robot with the terms that it lacks and whose parameters have a tolerance.

        They follow its own terms, with `lacking_parameters`. Without any it is the robot itself.
        """
        if not self.description.lacking_terms:
            return self
        extended = add_lacking_terms(self.description, self.lacking_parameters)
        further = tuple(extended.parameters.values())[len(self.parameters) :]
        load = self.load_parameters and (*self.load_parameters, *further)
        return replace(self, description=extended, load_parameters=load, lacking_parameters=())

    @property
    def graph(self) -> HexapodGraph:
        """The symbolic graph, shared by all robots with these terms."""
        return hexapod_graph(self.terms)

    @cached_property
    def cardan_frames(self) -> Array:
        """(6, 3, 3), C of each strut, columns x (first cardan axis), y, z in the base frame."""
        about = self.description
        joints = about.struts_at(about.home).joints
        return cardan_frames(about.base_joints, about.alpha_axes, joints)

    @cached_property
    def _kinematic_terms(self) -> tuple[Term, ...]:
        return kinematic_terms(self.terms)

    @property
    def _lengths(self) -> BatchFunction:
        # Not kept: a kernel that has been called is bound to the memory of its process.
        return _length_kernel(self._kinematic_terms)

    @cached_property
    def geometry_vector(self) -> Array:
        """(g,) geometry input of the graph, in the order of `GeometrySymbols`."""
        about = self.description
        joints = np.ravel(about.base_joints), np.ravel(about.platform_joints)
        frames, axes = np.ravel(self.cardan_frames), np.ravel(about.platform_joint_axes)
        parts = [*joints, frames, axes, about.gravity]
        if about.platform_cardan_axes is not None:
            parts += [np.ravel(about.platform_cardan_axes), np.array([about.thread_lead])]
        return np.concatenate(parts)

    @cached_property
    def machine(self) -> Array:
        """(g + c + m,) geometry, constants, parameters of the load: input of kernels with terms."""
        load = self.parameters if self.load_parameters is None else self.load_parameters
        return np.concatenate([self.geometry_vector, self.description.constants, load])

    def with_load_at(self, parameters: ArrayLike) -> Robot:
        """Return the robot with the load of the actuators at given parameters, (m,).

        It is the robot itself if no term depends on the load, also of the lacking ones.
        """
        if not self.extended.graph.loaded:
            return self
        values = np.asarray(parameters, dtype=np.float64)
        return replace(self, load_parameters=tuple(values.tolist()))

    @property
    def limits(self) -> tuple[Limit, ...]:
        """The limits of robot and run, in the order of the catalogue."""
        return tuple(self.description.limits.values())

    def limit(self, key: str) -> Limit | None:
        """Return a limit by its key, None without one."""
        return self.description.limits.get(key)

    def inverse_kinematics(self, pose: ArrayLike) -> Array:
        """Return strut lengths, m: (6,) or (N, 6) like the pose (m, rad)."""
        return _evaluate(self._lengths, (self.geometry_vector,), pose)[0]

    def length_jacobian(self, pose: ArrayLike) -> Array:
        """Return ∂q/∂λ, (6, 6) or (N, 6, 6), of the strut lengths to the pose."""
        return _evaluate(self._lengths, (self.geometry_vector,), pose)[1]

    def lengths_and_jacobian(self, poses: Array) -> tuple[Array, Array]:
        """Return strut lengths (N, 6), m, and ∂q/∂λ (N, 6, 6) at poses (N, 6)."""
        lengths, jacobian = self._lengths(poses, self.geometry_vector)
        return lengths, jacobian

    def forward_kinematics(self, lengths: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Return the pose, m and rad, of strut lengths, m, on the guess's assembly branch.

        All are (6,) or (N, 6); the guess is the home pose by default. Raises
        `ForwardKinematicsError` if no pose with these lengths is found.
        """
        rows, single = _rows("lengths", lengths)
        start, _ = _rows("guess", self.home if guess is None else guess)
        start = np.array(np.broadcast_to(start, rows.shape))
        poses = solve_pose(self.lengths_and_jacobian, rows, start)
        return poses[0] if single else poses

    def strut_motion(
        self, pose: ArrayLike, rate: ArrayLike, acceleration: ArrayLike
    ) -> StrutMotion:
        """Return the motion of all struts at λ, λ̇, λ̈, (6,) or (N, 6) each: m, rad, s."""
        kernel = _motion_kernel(self._kinematic_terms)
        state = pose, rate, acceleration
        return StrutMotion(*_evaluate(kernel, (self.geometry_vector,), *state))

    def pose_motion(self, pose: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
        """Return λ̇ and λ̈ at poses, with the struts' rates and accelerations, (N, 6) each: m, s."""
        jacobian = self.length_jacobian(pose)
        rate = solve_rows(jacobian, rates)
        # q̈ = J λ̈ + J̇ λ̇; the graph gives the second part at λ̈ = 0.
        rest = self.strut_motion(pose, rate, np.zeros_like(rate)).length_acceleration
        return rate, solve_rows(jacobian, accelerations - rest)

    def regressor(self, pose: ArrayLike, rate: ArrayLike, acceleration: ArrayLike) -> Array:
        """Return A of Q = A p with the exact signs of dry friction: (6, m) or (N, 6, m).

        Rates of a machine at rest, up to rounding, have no sign.
        """
        state = pose, _rates(rate), acceleration
        return _evaluate(_regressor_kernel(self.terms), (self.machine,), *state)[0]

    def actuator_forces(
        self,
        pose: ArrayLike,
        rate: ArrayLike,
        acceleration: ArrayLike,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Return actuator forces, N, positive when they extend: (6,) or (N, 6).

        Pose, rate and acceleration, λ, λ̇, λ̈, are (6,) or (N, 6): m, rad, s. Parameters are (m,),
        SI, in the order of `parameter_names`; the nominal ones by default. Terms that depend on the
        load of the actuators take it at the same parameters.
        """
        values = self.parameters if parameters is None else np.asarray(parameters, dtype=float)
        if values.shape != (len(self.parameter_names),):
            raise ValueError(
                f"parameters: expected {len(self.parameter_names)} values, got {values.shape}"
            )
        one = _one_instant(pose, _rates(rate), acceleration)
        if one is not None:
            machine = self.machine
            if parameters is not None:
                machine = np.concatenate([machine[: -len(values)], values])
            return _force_kernel(self.terms).at(one, machine, values)[0]
        loaded = self if parameters is None else self.with_load_at(values)
        return loaded.regressor(pose, rate, acceleration) @ values


_AT_REST = 1e-12
"""Largest rounding error of the rates of a machine at rest, m/s and rad/s."""


def _rates(rate: ArrayLike) -> Array:
    """Return rates, (6,) or (N, 6), zero where all six are rounding errors."""
    rates = np.atleast_1d(np.asarray(rate, dtype=np.float64))
    still = np.max(np.abs(rates), axis=-1, keepdims=True, initial=0.0) <= _AT_REST
    return np.where(still, 0.0, rates) if np.any(still) else rates


def _rows(name: str, value: ArrayLike) -> tuple[Array, bool]:
    array = np.asarray(value, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != ACTUATORS:
        raise ValueError(f"{name}: expected the shape (6,) or (N, 6), got {array.shape}")
    return np.atleast_2d(array), array.ndim == 1


def _one_instant(*parts: ArrayLike) -> Array | None:
    """Return vectors of (6,) behind each other; None if one has another shape."""
    vectors = [np.asarray(part, dtype=np.float64) for part in parts]
    return np.concatenate(vectors) if all(v.shape == (ACTUATORS,) for v in vectors) else None


def _evaluate(kernel: BatchFunction, fixed: tuple[Array, ...], *parts: ArrayLike) -> list[Array]:
    """Return the outputs of a kernel at one state of parts (6,), or at N states of (N, 6)."""
    one = _one_instant(*parts)
    if one is not None:
        return kernel.at(one, *fixed)
    names = ("pose", "rate", "acceleration")
    rows = {name: _rows(name, part)[0] for name, part in zip(names, parts, strict=False)}
    count = max(len(array) for array in rows.values())
    for name, array in rows.items():
        if len(array) not in (1, count):
            raise ValueError(f"{name}: has {len(array)} rows, the others have {count}")
    stacked = [np.broadcast_to(array, (count, ACTUATORS)) for array in rows.values()]
    return kernel(np.concatenate(stacked, axis=1), *fixed)


def solve_rows(matrices: Array, vectors: Array) -> Array:
    """Solve one system for each of N matrices (N, 6, 6) and vectors (N, 6)."""
    return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0], dtype=np.float64)


LengthsAndJacobian = Callable[[Array], tuple[Array, Array]]
TOLERANCE = 1e-12
"""Largest residual of a solved pose, relative to the strut length."""
_NEWTON_STEPS = 40
_WALK = np.linspace(0, 1, 11)[1:]
_WALK_TOLERANCE = 1e-8
_HALVINGS = 30


class ForwardKinematicsError(ArithmeticError):
    """No pose was found with the strut lengths in the rows `samples`."""

    def __init__(self, samples: tuple[int, ...], residual: float) -> None:
        self.samples = samples
        shown = ", ".join(str(k) for k in samples[:5]) + (" …" if len(samples) > 5 else "")  # noqa: PLR2004
        super().__init__(
            f"forward kinematics did not converge for sample(s) {shown}: the strut lengths are "
            f"missed by up to {residual:.3g} m; are they out of reach, or in another "
            "order, sign or unit?"
        )


def solve_pose(function: LengthsAndJacobian, lengths: Array, guess: Array) -> Array:
    """Return the poses (N, 6) of the lengths (N, 6) on the guess's assembly branch.

    Damped Newton from the guess; rows that do not converge are solved again in small steps along
    the straight line from the guess's lengths to theirs, which stays on the branch of the guess.
    The function maps poses (N, 6) to lengths (N, 6) and their Jacobian (N, 6, 6); m, rad. Rows
    without a solution raise `ForwardKinematicsError`.
    """
    poses, residual = _newton(function, lengths, guess)
    bound = TOLERANCE * np.max(np.abs(lengths), axis=1)
    # Newton may also jump to another assembly branch: far solutions are checked in small steps.
    far = np.max(np.abs(poses[:, 3:] - guess[:, 3:]), axis=1) > np.pi / 4
    again = np.flatnonzero((residual > bound) | far)
    if again.size:
        poses[again], residual[again] = _follow(function, lengths[again], guess[again])
    failed = np.flatnonzero(~(residual <= bound))
    if failed.size:
        raise ForwardKinematicsError(tuple(int(k) for k in failed), float(np.max(residual[failed])))
    return poses


def _newton(
    function: LengthsAndJacobian, lengths: Array, guess: Array, tolerance: float = TOLERANCE
) -> tuple[Array, Array]:
    poses = guess.copy()
    bound = tolerance * np.max(np.abs(lengths), axis=1)
    values, jacobian = function(poses)
    residual = np.max(np.abs(values - lengths), axis=1)
    rows = np.arange(len(poses))
    for _ in range(_NEWTON_STEPS):
        reached = residual[rows] <= bound[rows]
        step = _newton_step(jacobian[rows], lengths[rows] - values[rows])
        worse = rows
        for halving in range(_HALVINGS):
            trial = poses[worse] + step / 2**halving
            new_values, new_jacobian = function(trial)
            new_residual = np.max(np.abs(new_values - lengths[worse]), axis=1)
            better = new_residual <= residual[worse]
            done = worse[better]
            poses[done], values[done] = trial[better], new_values[better]
            jacobian[done], residual[done] = new_jacobian[better], new_residual[better]
            worse, step = worse[~better], step[~better]
            if not worse.size:
                break
        # One step beyond the tolerance: convergence is quadratic, and it costs no more.
        rows = rows[~reached & ~np.isin(rows, worse)]
        if not rows.size:
            break
    return poses, residual


def _newton_step(jacobian: Array, mismatch: Array) -> Array:
    try:
        return solve_rows(jacobian, mismatch)
    except np.linalg.LinAlgError:
        pairs = zip(jacobian, mismatch, strict=True)
        steps = [np.linalg.lstsq(j, r, rcond=1e-12)[0] for j, r in pairs]
        return np.array(steps, dtype=np.float64)


def _follow(function: LengthsAndJacobian, lengths: Array, guess: Array) -> tuple[Array, Array]:
    """Solve in steps from the guess; a row that misses one has left its branch and ends there."""
    start, _ = function(guess)
    poses, rows = guess.copy(), np.arange(len(guess))
    for share in _WALK:
        tolerance = TOLERANCE if share == 1 else _WALK_TOLERANCE
        wanted = start[rows] + share * (lengths[rows] - start[rows])
        poses[rows], residual = _newton(function, wanted, poses[rows], tolerance)
        rows = rows[residual <= tolerance * np.max(np.abs(wanted), axis=1)]
        if not rows.size:
            break
    found, _ = function(poses)
    return poses, np.max(np.abs(found - lengths), axis=1)
