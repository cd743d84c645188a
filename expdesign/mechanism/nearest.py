"""The parameters nearest to given ones that some set of bodies has: a semidefinite programme.

Minimise ½ (p − p̂)ᵀ C⁻¹ (p − p̂) over p and what of the bodies is in no parameter by itself, so that
every matrix of `Realisable.conditions` is positive semidefinite and every bound is kept. With
p = p̂ + L z, C = L Lᵀ, the cost is ½ |z|²; matrices are divided by the robot's scales. Solved by
Clarabel (Goulart and Chen, 2024), an interior-point method.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from constraints.arrays import Array
from expdesign.mechanism.bodies import MachineBodies
from expdesign.mechanism.realisable import SLIDER_MASS, Realisable
from expdesign.mechanism.terms.rigid_platform import MASS

_SOLVED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)
_PRECISION, _REDUCED = 1e-11, 1e-7
_REGULARISATION = 1e-7
"""Of the solver where it does not scale the rows: with its own it sticks where nothing is left."""
_SHARES = tuple(np.geomspace(1e-10, 1e-2, 9).tolist())
"""Of the scales, by which what the solver found is moved inside, as little as it takes."""
_FARTHER = 1e-5
"""By how much farther than the least distance, as a share and in σ, is near enough."""
_ACTIVE = 1e-3
"""Share of the distance from which a condition is told to be what moves an estimate."""


class NoBodiesError(ValueError):
    """No bodies have the values of the parameters that must stay as they are."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest parameters that some bodies have."""

    values: Array
    """(m,), SI."""
    distance: float
    """√((p − p̂)ᵀ C⁻¹ (p − p̂))."""
    least: float
    """No bodies are nearer than that: by the dual of the programme, to the solver's precision."""
    bodies: MachineBodies
    """Which have them."""
    active: tuple[str, ...]
    """The conditions and parameters whose bounds keep it from being nearer."""


@dataclass(frozen=True, eq=False)
class Projection:
    """Ways from any parameters to the nearest ones that some bodies have, in one metric."""

    among: Realisable
    factor: Array
    """(m, k), L: C of the free parameters is L Lᵀ, the rows of others are zero."""
    free: NDArray[np.bool_]
    """(m,), false: stays as it is."""

    @classmethod
    def by(cls, covariance: Array, among: Realisable, free: NDArray[np.bool_]) -> Projection:
        """Return that in the metric of a covariance, (m, m); of free parameters definite."""
        std = np.sqrt(np.diag(covariance)[free])
        own = covariance[np.ix_(free, free)] / np.multiply.outer(std, std)
        factor = np.zeros((len(free), len(std)))
        factor[free] = std[:, None] * np.linalg.cholesky(own)
        return cls(among, factor, free)

    def length(self, change: Array) -> float:
        """Return the length of a change of the parameters, (m,), in standard deviations."""
        return float(np.linalg.norm(np.linalg.solve(self.factor[self.free], change[self.free])))

    def of(self, values: Array) -> Nearest:
        """Return the nearest parameters; those given, bit by bit, when bodies have them.

        Raises
        ------
        NoBodiesError
            Whatever the free parameters are.
        """
        bodies = self.among.bodies(values)
        if bodies is not None:
            return Nearest(values, 0.0, 0.0, bodies, ())
        others: list[Nearest] = []
        far = max(1.0, self.length(values))
        for unit, scaled in product((1.0, far, np.sqrt(far), 0.1), (True, False)):
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

    def _inside(self, values: Array, move: Array, forces: Array, least: float) -> Nearest | None:
        """Return what the solver found, moved inside by what its rounding takes."""
        change = self.factor @ move
        for share in _SHARES:
            inside = self.among.inside(values + change, share)
            bodies = self.among.bodies(inside, rounding=0.0)
            if bodies is not None:
                kept = np.where(self.free, inside, values)
                active = self._active(move, forces)
                return Nearest(kept, self.length(kept - values), least, bodies, active)
        return None

    @cached_property
    def _blocks(self) -> tuple[_Block, ...]:
        std = np.linalg.norm(self.factor, axis=1)
        return tuple(_blocks(self.among, np.maximum(self.among.scales, std)))

    @cached_property
    def _right(self) -> tuple[Array, Array]:
        """The right-hand side's part that goes with the values, and what is taken from it."""
        rows = np.vstack([block.rows for block in self._blocks])
        return rows, np.concatenate([block.bounds for block in self._blocks])

    @cached_property
    def _solvers(self) -> dict[bool, Any]:
        return {scaled: self._solver(scaled=scaled) for scaled in (True, False)}

    def _solver(self, *, scaled: bool) -> Any:
        rows = np.vstack(
            [np.column_stack([-block.rows @ self.factor, -block.others]) for block in self._blocks]
        )
        cost = sparse.diags_array([1.0] * np.count_nonzero(self.free) + [0.0], format="csc")
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
            sparse.csc_array(rows),
            np.zeros(len(rows)),
            cones,
            settings,
        )

    def _solved(
        self, values: Array, unit: float, *, scaled: bool
    ) -> tuple[Array, Array, float] | None:
        """Return z, the multipliers and the least distance by the dual.

        Found in units of so many σ: what is far from all bodies looks infeasible in small ones.
        """
        rows, bounds = self._right
        right = (rows @ values - bounds) / unit
        if not np.all(np.isfinite(right)) or not np.all(np.isfinite(rows)):
            return None
        solver = self._solvers[scaled]
        solver.update(b=right)
        found = solver.solve()
        if found.status not in _SOLVED:
            return None
        least = unit * np.sqrt(2 * max(found.obj_val_dual, 0.0))
        return unit * np.array(found.x)[:-1], unit * np.array(found.z), float(least)

    def _active(self, move: Array, forces: Array) -> tuple[str, ...]:
        """Return what pushes by more than a share of all, as the multipliers tell."""
        ends = np.cumsum([len(block.rows) for block in self._blocks])[:-1]
        least = _ACTIVE * np.linalg.norm(move)
        told = (
            block.meaning
            for block, force in zip(self._blocks, np.split(forces, ends), strict=True)
            if np.linalg.norm((block.rows @ self.factor).T @ force) > least
        )
        return tuple(dict.fromkeys(told))


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
