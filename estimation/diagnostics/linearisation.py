"""Linearisation of an experiment at an estimate: residuals and their sensitivities.

Near the estimate the residuals of the forces are e = ε − A δp − G δξ, G = ∂(A p)/∂ξ, those of the
lengths r = ε_l − L δξ, L = ∂l/∂ξ. Every diagnostic uses this linearisation, so that each of them
accounts for the errors of the parameters and of the motion.

Samples of equal phase form one row. Averaged recordings have the same phases in every period. In
other recordings a cell contains the samples within one controller step of the phase, near
replicates in the sense of the lack-of-fit test. Residuals and columns of the model are averaged
over the same cells with the same weights; the only approximation is a constant model error within a
step.

A `Signature` contains the columns that an effect adds to the forces and lengths. Those of candidate
effects (`CandidateEffects`) are evaluated at the estimate, along the estimated motion, and averaged
over the same cells; the load of the actuators is that of the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.special import ndtri

from constraints.arrays import Array
from estimation.estimators.experiment import (
    UNSURE,
    Experiment,
    regressors_along,
    regressors_at,
)
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.kinematics import add_time_spread, length_residuals, signs_along
from estimation.measurement_model import Motion
from estimation.measurement_model.banded import Matrix, dense
from estimation.measurement_model.prediction import chunks, held_regressor_kernel
from estimation.processing import NoiseEstimate, NoiseModel, PeriodSource
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import parameters_of
from expdesign.mechanism.terms import term_definitions
from expdesign.mechanism.terms.rigid_platform import GENERAL, LATERAL, SYMMETRIC
from expdesign.robot import Robot, deviation


@dataclass(frozen=True, eq=False)
class PhaseCells:
    """Assignment of rows to cells of equal phase."""

    index: NDArray[np.intp] | None
    """(T,), cell of each row; None: every row is its own cell (averaged recordings)."""
    weights: Array
    """(T,), number of samples (or weight) of each row."""
    totals: Array
    """(R,), weight of each cell."""

    @classmethod
    def rows(cls, weights: Array) -> PhaseCells:
        """Make every row its own cell."""
        return cls(None, weights, weights)

    @classmethod
    def of(cls, times: Array, weights: Array, period: float, step: float) -> PhaseCells:
        """Sort rows by their phase into cells of one step; times in s."""
        count = max(1, round(period / step))
        cell = np.floor(np.mod(times / period, 1.0) * count).astype(np.intp) % count
        used, index = np.unique(cell, return_inverse=True)
        totals = np.bincount(index, weights, minlength=len(used)).astype(np.float64)
        return cls(index, weights, totals)

    def mean(self, values: Array) -> Array:
        """Return the weighted mean in every cell, (R, …), of values (T, …)."""
        if self.index is None:
            return values
        count = len(values)
        flat = (values.T * self.weights).T.reshape(count, math.prod(values.shape[1:]))
        places = (self.index, np.arange(count))
        gather = sparse.csr_array((np.ones(count), places), (len(self.totals), count))
        return (gather @ flat / self.totals[:, None]).reshape(len(self.totals), *values.shape[1:])

    def expand(self, values: Array) -> Array:
        """Return the value of its cell for every row, (T, …), of values (R, …)."""
        return values if self.index is None else values[self.index]

    def deviations(self, values: Array) -> Array:
        """Return values, (T, …), less the means of their cells if these have two rows or more.

        They have the variance of the values about a signal that is constant in every cell.
        """
        size = None if self.index is None else np.bincount(self.index)[self.index]
        if size is None or np.min(size) < 2:  # noqa: PLR2004 - a deviation takes two
            return values
        scale = np.sqrt(size / (size - 1))
        return ((values - self.expand(self.mean(values))).T * scale).T

    def scatter(self, values: Array) -> NoiseEstimate | None:
        """Return the covariance of the scatter within cells; None if no cell has two rows."""
        if self.index is None:
            return None
        freedom = float(np.sum(self.weights**2) - len(self.totals))
        if freedom < 1:
            return None
        # Squares of the weights: outliers are not noise.
        rest = (values - self.expand(self.mean(values))) * self.weights[:, None]
        return NoiseEstimate(rest.T @ rest / freedom, freedom)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals and sensitivities of one experiment, one row per phase."""

    times: Array
    """(R,), times of the rows, s."""
    counts: Array
    """(R,), number of samples averaged in each row."""
    forces: Array
    """(R, 6), measured minus predicted, N: means over the periods."""
    regressors: Array
    """(R, 6, m), A of all parameters."""
    motion_columns: Array
    """(R, 6, x), G; x = 0 after pointwise kinematics."""
    free: NDArray[np.bool_]
    """(m,), parameters that were estimated."""
    sign_errors: Matrix
    """(6 R, s), errors of the predicted forces due to unknown signs of dry friction, N: each
    column has an unknown factor of unit variance. They remain unfiltered."""
    sign_precision: Array
    """(s,), prior precision of these factors in a fit: a sign that is almost certain is either
    right or wrong by 2, an error of many standard deviations. A fit allows for it."""
    lengths: Array | None
    """(R', 6), measured minus predicted, m; None after pointwise kinematics."""
    length_counts: Array
    """(R',), number of samples averaged in each row of the lengths."""
    length_columns: Array
    """(R', 6, x), L."""
    force_scatter: NoiseEstimate | None
    """Covariance of one sample about the means, from repetition alone."""
    position: Array
    speed: Array
    acceleration: Array
    """(R, 6), strut lengths and their derivatives along the motion, m, m/s and m/s²."""
    force_rows: Array
    """(T, 6), residuals of the recording's single rows, N."""
    length_rows: Array | None
    """(T, 6), residual lengths of the single rows, m."""
    cells: PhaseCells
    length_cells: PhaseCells
    """Cells in which forces and lengths were averaged."""

    @property
    def columns(self) -> Array:
        """(R, 6, k + x), columns of the free parameters and the motion."""
        return np.concatenate([self.regressors[:, :, self.free], self.motion_columns], axis=2)

    @property
    def sign_variance(self) -> Array:
        """(R, 6), variance of the predicted force due to unknown signs of dry friction, N²."""
        variance = (self.sign_errors**2).sum(axis=1)
        return np.asarray(variance).reshape(self.forces.shape)

    def filter_signs(self, operation: Callable[[Array], Array] | None) -> Matrix:
        """Return the errors due to unknown signs, (6 R, s), after a filter of series, (R, 6, …)."""
        if operation is None:
            return self.sign_errors
        whole = dense(self.sign_errors)
        return operation(whole.reshape(-1, ACTUATORS, whole.shape[1])).reshape(-1, whole.shape[1])

    def apply_filters(self, noise: NoiseModel) -> Linearisation:
        """Apply the filters that whiten coloured noise."""
        changes: dict[str, Any] = {}
        if noise.forces.filter is not None:
            names = ("forces", "regressors", "motion_columns")
            changes |= {name: noise.forces.filter(getattr(self, name)) for name in names}
            changes["counts"] = self.counts[: noise.forces.filter.count]
        if noise.lengths.filter is not None and self.lengths is not None:
            changes["lengths"] = noise.lengths.filter(self.lengths)
            changes["length_columns"] = noise.lengths.filter(self.length_columns)
            changes["length_counts"] = self.length_counts[: noise.lengths.filter.count]
        return replace(self, **changes) if changes else self


def linearise(
    robot: Robot,
    experiment: Experiment,
    values: Array,
    free: NDArray[np.bool_],
    motion: Motion | None,
) -> Linearisation:
    """Linearise an experiment at parameters, (m,), SI, and a motion; None: the pointwise one.

    `free`, (m,), are those that were estimated.
    """
    recording, times = experiment.recording, experiment.times
    cells = _cells(experiment, times, experiment.counts)
    length_cells = PhaseCells.rows(np.zeros(0))
    lengths, length_columns = None, np.zeros((0, ACTUATORS, 0))
    if motion is None:
        if experiment.pointwise is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        state, regressors = experiment.pointwise.state, experiment.fitted_regressors
        slope = np.zeros((len(times), ACTUATORS, 0))
        sign_errors, sign_precision = sparse.csr_array((ACTUATORS * len(times), 0)), np.zeros(0)
    else:
        state = motion.at(times).state()
        machine, none = PerturbedMachine.exact(robot), np.zeros_like(free)
        predicted = [
            machine.forces(experiment, motion, values, part) for part in chunks(len(times))
        ]
        regressors = np.concatenate([each.regressors for each in predicted])
        slope = np.concatenate([each.columns(none).dense() for each in predicted])
        signs = _sign_errors(robot, experiment, motion, cells, state, values)
        sign_errors, sign_precision = signs
        length_cells = _cells(experiment, recording.lengths.times, recording.lengths.counts)
        lengths = length_residuals(robot, recording, motion)
        slopes = [
            machine.lengths(experiment, motion, part).columns.dense()
            for part in chunks(recording.samples)
        ]
        length_columns = length_cells.mean(np.concatenate(slopes))
    rows = experiment.forces - regressors @ values
    struts = robot.strut_motion(*np.split(state, 3, axis=1))
    return Linearisation(
        times=times if cells.index is None else cells.mean(np.mod(times, recording.period)),
        counts=cells.totals,
        forces=cells.mean(rows),
        regressors=cells.mean(regressors),
        motion_columns=cells.mean(slope),
        free=free,
        sign_errors=sign_errors,
        sign_precision=sign_precision,
        lengths=None if lengths is None else length_cells.mean(lengths),
        length_counts=length_cells.totals,
        length_columns=length_columns,
        force_scatter=recording.forces.scatter if cells.index is None else cells.scatter(rows),
        position=cells.mean(struts.length),
        speed=cells.mean(struts.length_rate),
        acceleration=cells.mean(struts.length_acceleration),
        force_rows=recording.forces.as_recorded(rows),
        length_rows=None if lengths is None else recording.lengths.as_recorded(lengths),
        cells=cells,
        length_cells=length_cells,
    )


def _cells(experiment: Experiment, times: Array, counts: Array) -> PhaseCells:
    recording = experiment.recording
    if recording.averaged or recording.source is PeriodSource.NONE:
        return PhaseCells.rows(counts)
    return PhaseCells.of(times, counts, recording.period, recording.step)


def _sign_errors(
    robot: Robot,
    experiment: Experiment,
    motion: Motion,
    cells: PhaseCells,
    state: Array,
    values: Array,
) -> tuple[sparse.csr_array, Array]:
    """Return the columns of unknown signs in the means over the cells, (6 R, s), N.

    A rate has the same error δ at all rows of one reversal. With P = P(rate + δ > 0) the signs of
    two rows then have the covariance 4 (min(P, P') − P P'), a Brownian bridge over P. A delay is a
    deviation with a separate column: of its share ρ² in the variance of δ the part that is linear
    in the delay, 4 ρ ρ' φ φ' with the normal density φ, is left out. Returned with the precisions
    of their factors in a fit, (s,).
    """
    known = experiment.along_motion(motion)
    signs, spread = known.signs(robot, experiment.recording.forces.times), known.spread
    above = (1 + cells.mean(signs)) / 2
    first = np.arange(len(above))
    if cells.index is not None:
        _, first = np.unique(cells.index, return_index=True)
    size = ACTUATORS * len(above)
    columns, precision = [sparse.csr_array((size, 0))], [np.zeros(0)]
    for rate, share in enumerate(above.T):
        unsure = np.flatnonzero(4 * share * (1 - share) > UNSURE)
        for rows in np.split(unsure, np.flatnonzero(np.diff(unsure) > 1) + 1):
            if not len(rows):
                continue
            at, inside = first[rows], share[rows]
            jumps, _, change = deviation.force_jumps(robot, state[at], signs[at], values)
            density = np.exp(-(ndtri(inside) ** 2) / 2) / np.sqrt(2 * np.pi)
            late = robot.delay_std * change[:, rate] * density
            late /= np.maximum(spread[at, rate], np.finfo(np.float64).tiny)
            bridge = np.minimum.outer(inside, inside) - np.multiply.outer(inside, inside)
            variances, modes = np.linalg.eigh(4 * (bridge - np.multiply.outer(late, late)))
            kept = variances > UNSURE
            factors = modes[:, kept] * np.sqrt(variances[kept])
            errors = jumps[:, :, rate, None] * factors[:, None]
            own = sparse.coo_array(errors.reshape(len(rows) * ACTUATORS, -1))
            places = own.row + ACTUATORS * rows[0], own.col
            columns.append(sparse.csr_array((own.data, places), shape=(size, own.shape[1])))
            precision.append(np.minimum(variances[kept], 1.0))
    return sparse.hstack(columns, format="csr"), np.concatenate(precision)


@dataclass(frozen=True, eq=False)
class Signature:
    """Columns of q effects in forces and lengths, per unit of each effect."""

    forces: Array
    """(R, 6, q), N."""
    lengths: Array
    """(R', 6, q), m; R' = 0 after pointwise kinematics."""

    @classmethod
    def of_forces(cls, part: Linearisation, columns: Array) -> Self:
        """Build the signature of effects on the forces alone, (R, 6, q)."""
        rows = len(part.length_counts)
        return cls(columns, np.broadcast_to(0.0, (rows, *columns.shape[1:])))

    @classmethod
    def none(cls, part: Linearisation) -> Self:
        """Build the signature of no effects."""
        return cls.of_forces(part, np.zeros((*part.forces.shape, 0)))

    @classmethod
    def concatenate(cls, parts: Sequence[Signature]) -> Self:
        """Concatenate effects; at least one part."""
        return cls(
            np.concatenate([part.forces for part in parts], axis=2),
            np.concatenate([part.lengths for part in parts], axis=2),
        )

    @property
    def count(self) -> int:
        """Number of effects, q."""
        return self.forces.shape[2]

    @cached_property
    def in_lengths(self) -> NDArray[np.intp]:
        """Indices of the effects that change lengths."""
        return np.flatnonzero(np.any(self.lengths, axis=(0, 1)))

    def select(self, places: Sequence[int] | NDArray[np.intp]) -> Signature:
        """Return the effects at these indices."""
        chosen = np.asarray(places, dtype=np.intp)
        return Signature(self.forces[:, :, chosen], self.lengths[:, :, chosen])


CANDIDATE_TERMS = (
    "load_friction",
    "drive_inertia",
    "passive_viscous_friction",
    "asymmetric_friction",
    "quadratic_friction",
    "stribeck",
    "position_friction",
    "force_offset",
    "cable",
    "platform_wrench",
    "platform_spring",
    "platform_drag",
)
"""Terms of the catalogue that a robot may lack."""
GENERAL_PLATFORM = "general_platform"
_GEOMETRIC = ("base_joints", "platform_joints", "gravity", "strut_length")


@dataclass(frozen=True, eq=False)
class CandidateEffects:
    """Point at which the columns of candidate effects are evaluated."""

    robot: Robot
    experiment: Experiment
    motion: Motion | None
    """Estimated motion; None: the pointwise motion of the experiment."""
    values: Array
    """(m,), estimated parameters, SI."""
    part: Linearisation

    @property
    def _fitted(self) -> Motion:
        """The motion, if it is a Fourier series."""
        if self.motion is None:
            raise ValueError("pointwise kinematics have no Fourier series")
        return self.motion

    def gains(self, power: int = 1) -> Signature:
        """Return the columns of six gains, N: predicted force of one actuator each.

        With a power of three they are those of force constants that saturate, in shares at the
        largest predicted force.
        """
        forces = self.part.regressors @ self.values
        shares = forces / np.max(np.abs(forces))
        return self.of_forces((forces * shares ** (power - 1))[:, :, None] * np.eye(ACTUATORS))

    def lacks(self, name: str) -> bool:
        """Return whether the robot lacks a term, or the asymmetry of a platform."""
        if name == GENERAL_PLATFORM:
            return SYMMETRIC in self.robot.terms
        return name not in {term.name for term in self.robot.terms}

    def term(self, name: str, **constants: float) -> Signature:
        """Return the columns of a term, or of the asymmetry of a platform (`GENERAL_PLATFORM`).

        With its constants, SI; without any, with those of `_extended`.
        """
        if name == GENERAL_PLATFORM:
            return self.term(GENERAL.name).select(range(-len(LATERAL), 0))
        robot, signs = self._extended
        regressors = self._regressors
        if constants:
            own = [(term.name, one.name) for term in robot.terms for one in term.constants]
            given = {(name, constant): value for constant, value in constants.items()}
            if not given.keys() <= set(own):
                raise ValueError(f"{name} has other constants than {', '.join(constants)}")
            pairs = zip(own, robot.description.constants, strict=True)
            held = tuple(given.get(key, value) for key, value in pairs)
            changed = Robot(replace(robot.description, constants=held), robot.load_parameters)
            regressors = self._regressors_of(changed, signs)
        place = [term.name for term in robot.terms].index(name)
        first = len(parameters_of(robot.terms[:place]))
        count = len(robot.terms[place].parameters)
        return self.of_forces(regressors[:, :, first : first + count])

    @cached_property
    def _regressors(self) -> Array:
        """(R, 6, m), of the robot with all candidate terms."""
        return self._regressors_of(*self._extended)

    def deviations(self, names: Sequence[str]) -> Signature:
        """Return the columns of `expdesign.robot.deviation` with these names."""
        picked = [self._deviations[1].index(name) for name in names]
        return self._deviations[0].select(picked)

    def tolerance_columns(
        self, known: Mapping[str, float] = MappingProxyType({})
    ) -> tuple[Signature, Array, Array]:
        """Return the columns of all deviations with a tolerance, their 1/std² and means, (t,).

        They include estimated constants of terms. There are none after pointwise kinematics.
        `known` are estimates by name: the machine has them already, and the means are less these.
        """
        entries = self._inexact if self.motion is not None else ()
        if not entries:
            return Signature.none(self.part), np.zeros(0), np.zeros(0)
        precision = np.array([each.tolerance**-2 for each in entries])
        means = np.array([-known.get(each.name, 0.0) for each in entries])
        return self.deviations([each.name for each in entries]), precision, means

    @cached_property
    def _inexact(self) -> tuple[deviation.Deviation, ...]:
        constants = deviation.estimated_constants(self.robot)
        names = {one.name for one in constants}
        others = (
            one for one in deviation.toleranced_deviations(self.robot) if one.name not in names
        )
        return (*constants, *others)

    def delay(self, seconds: float) -> Signature:
        """Return the change of the forces due to a delay, N per second of delay.

        It is a secant, not a derivative, so that jumps of dry friction are delayed as well.
        """
        known = self.experiment.pointwise
        if known is None:
            change = self._forces(self._fitted.delay_by(seconds)) - self._forces_in_time
        elif known.motion is None:
            raise ValueError("differences between neighbours are no motion that is delayed")
        else:
            times = self.experiment.recording.forces.times[known.rows]
            late = replace(known, state=known.motion.delay_by(seconds).at(times).state())
            change = regressors_at(self.robot, late) - regressors_at(self.robot, known)
            change = change @ self.values
        change = change / seconds
        return self.of_forces(self.part.cells.mean(change)[:, :, None])

    def lags(self, mixture: Array, seconds: float) -> Signature:
        """Return the columns of delays or low passes of six forces and of six lengths.

        They are secants, N and m per second. `mixture` is `DELAY` or `LOW_PASS`. Along the motion
        of a late length, dry friction of its strut changes its sign too late; the rest of the
        forces follows the free motion.
        """
        known, late = self._fitted, np.zeros((2, *self.experiment.forces.shape))
        for node, weight, spread in mixture.tolist():
            there = known.delay_by(node * seconds)
            late[0] += weight * self._forces(there, spread=spread * max(seconds, 0.0))
            late[1] += weight * self._lengths(there)
        cells, early = self.part.cells, self._forces(known, -seconds)
        forces, jumps, lengths = (
            own.mean(change / seconds)[:, :, None] * np.eye(ACTUATORS)
            for own, change in (
                (cells, late[0] - self._forces_in_time),
                (cells, early - self._forces_in_time),
                (self.part.length_cells, late[1] - self._lengths_in_time),
            )
        )
        return Signature.concatenate([self.of_forces(forces), Signature(jumps, lengths)])

    def _lengths(self, motion: Motion) -> Array:
        """Return the predicted lengths at the samples along a motion, (T, 6)."""
        return self.robot.inverse_kinematics(motion.poses(self.experiment.recording.lengths.times))

    @cached_property
    def _lengths_in_time(self) -> Array:
        return self._lengths(self._fitted)

    @cached_property
    def _forces_in_time(self) -> Array:
        return self._forces(self._fitted)

    def _forces(self, motion: Motion, late_signs: float = 0.0, spread: float = 0.0) -> Array:
        """Return the predicted forces at the samples along a motion, (T, 6).

        The signs of dry friction may be those of another time, late by so many seconds, or with a
        standard deviation of the time, s.
        """
        times, known = self.experiment.times, self.experiment.fitted.spread
        sampled = motion.at(times)
        if spread:
            known = add_time_spread(self.robot, sampled, known, spread)
        turning = motion.at(times - late_signs) if late_signs else sampled
        signs = signs_along(self.robot, turning, known)
        kernel = held_regressor_kernel(self.robot.terms)
        (regressors,) = kernel(sampled.state(), signs, self.robot.machine)
        return regressors @ self.values

    @cached_property
    def _deviations(self) -> tuple[Signature, tuple[str, ...]]:
        robot, experiment, motion, part = self.robot, self.experiment, self._fitted, self.part
        inexact = {each.name for each in self._inexact}
        wanted = [
            each
            for each in deviation.deviations(robot)
            if each.group in _GEOMETRIC or each.name in inexact
        ]
        machine = PerturbedMachine.of(robot, wanted, np.zeros(len(wanted)))
        experiment, motion, steps = machine.follow_lengths(experiment, motion)
        rows, no_parameters = chunks(experiment.recording.samples), np.zeros(len(self.values), bool)
        seen = (machine.forces(experiment, motion, self.values, each) for each in rows)
        forces = np.concatenate([each.columns(no_parameters).times(steps) for each in seen])
        read = (machine.lengths(experiment, motion, each) for each in rows)
        lengths = np.concatenate([each.columns.times(steps) for each in read])
        names = tuple(each.name for each in wanted)
        columns = Signature(part.cells.mean(forces), part.length_cells.mean(lengths))
        if "delay" in names and robot.delay_std:
            # The jumps of dry friction are delayed as well.
            columns.forces[:, :, names.index("delay")] = self.delay(robot.delay_std).forces[:, :, 0]
        return columns, names

    def of_forces(self, columns: Array) -> Signature:
        """Return the signature of effects on the forces alone, (R, 6, q)."""
        return Signature.of_forces(self.part, columns)

    @cached_property
    def _extended(self) -> tuple[Robot, Array | None]:
        """Robot with its frictionless terms and all candidate terms, and the signs of friction.

        Its platform is the general one, its load that of the estimate, since candidates have the
        parameter zero. Lengths among their constants are the mean length of the struts. The
        expected signs are (T, s); None after pointwise kinematics, which use the exact ones.
        """
        about, experiment, motion = self.robot.description, self.experiment, self.motion
        own = iter(about.constants)
        held = [(term, [next(own) for _ in term.constants]) for term in about.terms]
        pairs = [
            (GENERAL if t is SYMMETRIC else t, known) for t, known in held if not t.is_friction
        ]
        typical = {"m": float(np.mean(self.part.position))}
        for term in (term_definitions()[name] for name in CANDIDATE_TERMS if self.lacks(name)):
            known = [
                typical.get(one.unit, 1.0) if one.default is None else one.default
                for one in term.constants
            ]
            pairs.append((term, known))
        terms = tuple(term for term, _ in pairs)
        values = dict(zip(self.robot.parameter_names, self.values.tolist(), strict=True))
        parameters = {p.name: values.get(p.name, 0.0) for p in parameters_of(terms)}
        constants = tuple(value for _, known in pairs for value in known)
        extended = replace(about, terms=terms, constants=constants, parameters=parameters)
        robot = Robot(extended, delay_std=self.robot.delay_std)
        if motion is None or experiment.fit is None:
            return robot, None
        times = experiment.recording.forces.times
        if not robot.graph.rates:
            return robot, np.zeros((len(times), 0))
        along = experiment.along_motion(motion).for_robot(robot, experiment.recording)
        return robot, along.signs(robot, times)

    def _regressors_of(self, robot: Robot, signs: Array | None) -> Array:
        """Return the regressors of another robot, (R, 6, m)."""
        if self.motion is not None and signs is not None:
            times = self.experiment.recording.forces.times
            return self.part.cells.mean(regressors_along(robot, self.motion, times, signs))
        if self.experiment.pointwise is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        return self.part.cells.mean(regressors_at(robot, self.experiment.pointwise))
