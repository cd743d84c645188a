"""Nearest physically consistent parameters: a semidefinite programme.

Minimise ½ (p − p̂)ᵀ C⁻¹ (p − p̂) over p and the bodies' properties that no parameter determines,
with every matrix of `Realisable.conditions` positive semidefinite and within all bounds. With
p = p̂ + L z, C = L Lᵀ, the cost is ½ |z|²; matrices are divided by the robot's scales. Solved by
Clarabel (Goulart and Chen, 2024), an interior-point method.

The forces determine only the base parameters β = p_b + C p_d: then p = p̂ + L z + N w, where N
changes p_d by w and p_b by −C w at no cost. Distances are those of β.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.mechanism.bodies import MachineBodies
from expdesign.mechanism.realisable import SLIDER_MASS, Realisable
from expdesign.mechanism.terms.rigid_platform import MASS

_SOLVED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
_PRECISION, _REDUCED = 1e-11, 1e-7
_REGULARISATION = 1e-7
"""Static regularisation of the solver without scaled rows; its default stalls near the solution."""
_SHARES = tuple(np.geomspace(1e-10, 1e-2, 9).tolist())
"""Shifts of a solution to the inside, as shares of the scales; the smallest sufficient one."""
_FARTHER = 1e-5
"""Accepted excess over the least distance, as a share and in σ."""
_DRIFT = 1e-7
"""Cost of |w|², in scales, relative to |z|²: w is free, but no larger than necessary. Its effect on
z is this share of σ w / scale²: below `_FARTHER`."""
_ACTIVE = 1e-3
"""Smallest share of the distance for an active condition."""


class NoBodiesError(ValueError):
    """The held parameters are physically inconsistent."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest physically consistent parameters."""

    values: Array
    """(m,), SI."""
    distance: float
    """√((p − p̂)ᵀ C⁻¹ (p − p̂)), of β instead of p for regrouping parameters; 0 up to rounding."""
    least: float
    """Lower bound of the distance by the dual programme, to the solver's precision."""
    projection: Projection
    inside: Array
    """(m,), the values, held ones moved by the solver's rounding error as well: consistent."""
    solution: tuple[Array, Array] | None = None
    """z and the multipliers, of an inconsistent estimate."""

    @cached_property
    def bodies(self) -> MachineBodies:
        """Bodies with these parameters."""
        found = self.projection.among.bodies(self.inside)
        if found is None:
            raise NoBodiesError("the parameters are physically inconsistent")
        return found

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Active conditions, and parameters at active bounds."""
        return () if self.solution is None else self.projection.active_conditions(*self.solution)


@dataclass(frozen=True, eq=False)
class Projection:
    """Projection onto the physically consistent parameters in one metric."""

    among: Realisable
    factor: Array
    """(m, k), L: C of the free parameters is L Lᵀ, the rows of others are zero."""
    free: NDArray[np.bool_]
    """(m,), false for fixed or regrouping parameters."""
    regrouping: Array | None = None
    """(m, m): combinations of parameters in the forces: β for a base parameter, zero for those that
    regroup into it, else the parameter itself. None: identity."""

    @classmethod
    def by(
        cls,
        covariance: Array,
        among: Realisable,
        free: NDArray[np.bool_],
        regrouping: Array | None = None,
    ) -> Projection:
        """Return that in the metric of a covariance, (m, m); of free parameters definite."""
        std = np.sqrt(np.diag(covariance)[free])
        own = covariance[np.ix_(free, free)] / np.multiply.outer(std, std)
        factor = np.zeros((len(free), len(std)))
        factor[free] = std[:, None] * np.linalg.cholesky(own)
        return cls(among, factor, free, regrouping)

    def observable_change(self, change: Array) -> Array:
        """Return the observable part of a change of the parameters, (m,): that of β for p_b."""
        return change if self.regrouping is None else self.regrouping @ change

    @cached_property
    def regrouped(self) -> NDArray[np.bool_]:
        """(m,), the parameters p_d."""
        if self.regrouping is None:
            return np.zeros(len(self.free), dtype=bool)
        return np.asarray(np.diag(self.regrouping) == 0)

    @cached_property
    def movable(self) -> NDArray[np.bool_]:
        """(m,), parameters that the projection may change."""
        return self.free | self.regrouped | np.any(self._hidden != 0, axis=1)

    @cached_property
    def _hidden(self) -> Array:
        """(m, d), N: changes that leave β as it is, of about one scale."""
        if self.regrouping is None:
            return np.zeros((len(self.free), 0))
        found = (np.eye(len(self.free)) - self.regrouping)[:, self.regrouped]
        return found / np.max(np.abs(found) / self.among.scales[:, None], axis=0)

    @cached_property
    def noise(self) -> Array:
        """(m, k + d): L, and the change of each p_d that moves its most sensitive β by one σ."""
        if self.regrouping is None:
            return self.factor
        std = np.linalg.norm(self.factor[self.free], axis=1)
        sensitivity = np.abs(self.regrouping[np.ix_(self.free, self.regrouped)]) / std[:, None]
        most = np.max(sensitivity, axis=0, initial=0.0)
        own = np.divide(1.0, most, out=np.zeros_like(most), where=most > 0)
        return np.column_stack([self.factor, np.eye(len(self.free))[:, self.regrouped] * own])

    def length(self, change: Array) -> float:
        """Return the length of a change of the parameters, (m,), in standard deviations."""
        observable = self.observable_change(change)[self.free]
        return float(np.linalg.norm(np.linalg.solve(self._own_factor, observable)))

    @cached_property
    def _own_factor(self) -> Array:
        """(k, k), L of the free parameters."""
        return self.factor[self.free]

    def of(self, values: Array) -> Nearest:
        """Return the nearest parameters; those given, bit by bit, when bodies have them."""
        if self.among.consistent(values):
            return Nearest(values, 0.0, 0.0, self, values)
        others: list[Nearest] = []
        for unit, scaled in self._attempts(values):
            found = self._solved(values, unit, scaled=scaled)
            nearest = None if found is None else self._inside(values, *found)
            if nearest is None:
                continue
            if nearest.distance - nearest.least <= _FARTHER * (1 + nearest.distance):
                return nearest
            others.append(nearest)
        if others:
            return min(others, key=lambda each: each.distance)
        raise NoBodiesError("no bodies have the values of what is fixed or bounded")

    def _attempts(self, values: Array) -> Iterator[tuple[float, bool]]:
        """Yield units in σ, and whether the solver scales its rows."""
        yield from product((1.0,), (True, False))
        far = max(1.0, self.length(values))
        yield from product((far, np.sqrt(far), 0.1), (True, False))

    def _inside(self, values: Array, move: Array, forces: Array, least: float) -> Nearest | None:
        """Return the solution, moved inside by its rounding error."""
        held = self.factor @ move[: self.factor.shape[1]]
        exchanged = self._directions @ move
        for share, exchange in product(_SHARES, (False, True)):
            near = values + (exchanged if exchange else held)
            inside = self.among.inside(near, share)
            if np.any(self.regrouped) and not exchange and self.length(inside - near) > _FARTHER:
                continue  # it takes w: bounds without it move β
            if self.among.consistent(inside, rounding=0.0):
                kept = np.where(self.movable, inside, values)
                distance = self.length(kept - values)
                if np.any(self.regrouped) and distance <= _FARTHER:
                    return Nearest(kept, 0.0, 0.0, self, inside)
                solution = move[: self.factor.shape[1]], forces
                return Nearest(kept, distance, least, self, inside, solution)
        return None

    @cached_property
    def _directions(self) -> Array:
        """(m, k + d), of z and w."""
        return np.column_stack([self.factor, self._hidden])

    @cached_property
    def _blocks(self) -> tuple[_Block, ...]:
        std = np.linalg.norm(self.noise, axis=1)
        return tuple(_blocks(self.among, np.maximum(self.among.scales, std)))

    @cached_property
    def _right(self) -> tuple[Array, Array]:
        """Rows of the right-hand side for the values, and the bounds that are subtracted."""
        rows = np.vstack([block.rows for block in self._blocks])
        return rows, np.concatenate([block.bounds for block in self._blocks])

    @cached_property
    def _solvers(self) -> dict[bool, Any]:
        return {}

    def _solver(self, *, scaled: bool) -> Any:
        rows = np.vstack(
            [
                np.column_stack([-block.rows @ self._directions, -block.others])
                for block in self._blocks
            ]
        )
        count, drifts = self.factor.shape[1], self._hidden.shape[1]
        cost = scipy.sparse.diags_array([1.0] * count + [_DRIFT] * drifts + [0.0], format="csc")
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.equilibrate_enable = scaled
        # As it stands, so that the right-hand side can be exchanged.
        settings.presolve_enable = settings.chordal_decomposition_enable = False
        settings.input_sparse_dropzeros = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _PRECISION
        settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = _REDUCED
        settings.reduced_tol_feas = _REDUCED
        if not scaled:
            settings.static_regularization_constant = _REGULARISATION
        cones = [block.cone for block in self._blocks]
        return clarabel.DefaultSolver(
            cost,
            np.zeros(rows.shape[1]),
            scipy.sparse.csc_array(rows),
            np.zeros(len(rows)),
            cones,
            settings,
        )

    def _solved(
        self, values: Array, unit: float, *, scaled: bool
    ) -> tuple[Array, Array, float] | None:
        """Return z and w, the multipliers and the least distance by the dual.

        In units of so many σ: distant parameters look infeasible in small units.
        """
        rows, bounds = self._right
        right = (rows @ values - bounds) / unit
        if not np.all(np.isfinite(right)) or not np.all(np.isfinite(rows)):
            return None
        if scaled not in self._solvers:
            self._solvers[scaled] = self._solver(scaled=scaled)
        solver = self._solvers[scaled]
        solver.update(b=right)
        try:
            with _without_stderr():
                found = solver.solve()
        except BaseException as error:
            # A failed eigenvalue decomposition in Clarabel ends as a panic of Rust, with a trace.
            if type(error).__name__ != "PanicException":
                raise
            del self._solvers[scaled]
            return None
        if found.status not in _SOLVED:
            return None
        move = np.array(found.x)[:-1]
        drift = _DRIFT * float(np.sum(move[self.factor.shape[1] :] ** 2))
        least = unit * np.sqrt(max(2 * found.obj_val_dual - drift, 0.0))
        return unit * move, unit * np.array(found.z), float(least)

    def active_conditions(self, move: Array, forces: Array) -> tuple[str, ...]:
        """Return the active constraints: multipliers above a share of the largest."""
        ends = np.cumsum([len(block.rows) for block in self._blocks])[:-1]
        least = _ACTIVE * np.linalg.norm(move)
        active = (
            block.meaning
            for block, force in zip(self._blocks, np.split(forces, ends), strict=True)
            if np.linalg.norm((block.rows @ self.noise).T @ force) > least
        )
        return tuple(dict.fromkeys(active))


@contextmanager
def _without_stderr() -> Iterator[None]:
    """Discard messages of a library on the standard error output."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nothing:
            os.dup2(nothing.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


@dataclass(frozen=True, eq=False)
class _Block:
    """Rows · p + others · f − bounds lies in a cone."""

    meaning: str
    cone: Any
    rows: Array
    """(r, m)."""
    others: Array
    """(r, 1), of the slider's mass in the scale of masses."""
    bounds: Array
    """(r,)."""


def _blocks(among: Realisable, scales: Array) -> Iterator[_Block]:
    """Yield the conditions and bounds, divided by the scales."""
    names = (*among.names, SLIDER_MASS)
    mass = scales[among.names.index(MASS)] if among.platform else 1.0
    scale = np.array([*scales, mass])
    for condition in among.conditions:
        matrices = np.array(
            [
                condition.matrix(dict.fromkeys(names, 0.0) | {name: 1.0})
                if name in condition.parameters
                else condition.matrix(dict.fromkeys(names, 0.0))
                for name in names
            ]
        )
        size = np.sqrt(np.einsum("v,vii->i", scale, np.abs(matrices)))
        matrices /= np.multiply.outer(size, size)
        # Column by column of the upper triangle, as Clarabel wants them.
        column, row = np.tril_indices(len(size))
        rows = np.where(row == column, 1.0, np.sqrt(2.0))[:, None] * matrices[:, row, column].T
        single = len(size) == 1
        cone = clarabel.NonnegativeConeT(1) if single else clarabel.PSDTriangleConeT(len(size))
        parameters, others = np.split(rows, [len(among.names)], axis=1)
        yield _Block(condition.meaning, cone, parameters, others * scale[-1], np.zeros(len(rows)))
    for sign, ends in ((1.0, among.lower), (-1.0, among.upper)):
        for k in np.flatnonzero(np.isfinite(ends)):
            one = among.parameters[k]
            if one.strict and ends[k] == one.lower:
                continue  # implied by the conditions
            rows = np.zeros((1, len(among.names)))
            rows[0, k] = sign / scales[k]
            bound = np.array([sign * ends[k] / scales[k]])
            cone = clarabel.NonnegativeConeT(1)
            yield _Block(among.names[k], cone, rows, np.zeros((1, 1)), bound)
