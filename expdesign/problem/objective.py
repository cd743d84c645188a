"""The objective of a design, with its gradient and Hessian."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.batch import BatchFunction, Graph, kernel
from expdesign.information.criteria import Criterion, SpectralCost, spectral_cost
from expdesign.information.fisher import PeriodicNoise, whitening
from expdesign.information.marginal import Marginal
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.problem.variables import DesignVariables
from expdesign.robot.fixed_lengths import DeviationGroups, fixed_length_graph
from expdesign.trajectory import PhaseBasis

_AT_ONCE = 64
"""Samples whose derivatives are held in memory together: 0.1 MB each."""
_STEP = 1e-7
"""Step of difference quotients, in scaled variables."""

_TRIANGLE = ca.Sparsity.lower(COORDINATES)


@dataclass(frozen=True)
class InformationCost:
    """Criterion of the smoothed information as a function of the scaled variables."""

    terms: tuple[Term, ...]
    machine: Array
    """(g,), geometry and constants, an input of the graph."""
    variables: DesignVariables
    covariance: Array
    """(6, 6), full Σ of the force noise, N²."""
    columns: NDArray[np.intp]
    """(M,), columns of A, or of [A | Z], in F."""
    scaling: Array
    """(M,), factors of these columns."""
    criterion: Criterion
    samples: int
    memory: PeriodicNoise | None = None
    """Coloured noise, which replaces Σ; None: white."""
    marginal: Marginal | None = None
    """Quantities of interest among the unknowns, which the criterion judges; None: all of them."""
    judged: Array = field(default_factory=lambda: np.zeros(0))
    """(k,), scales of the quantities of interest."""
    effects: DeviationColumns | None = None
    """Deviations of the machine among the unknowns; None: none."""

    @cached_property
    def basis(self) -> PhaseBasis:
        """The Fourier basis at the samples."""
        phases = 2 * np.pi * np.arange(self.samples) / self.samples
        return PhaseBasis.at(phases, self.variables.harmonics)

    @cached_property
    def _path(self) -> DesignVariables:
        """The variables, with the derivatives of the motion that the columns depend on."""
        jerk = self.effects is not None and self.effects.groups.has_jerk
        return replace(self.variables, jerk=jerk)

    def information(self, variables: Array, width: float) -> Array:
        """Return the scaled, smoothed F per sample, (M, M)."""
        states = self._path.states(variables, self.basis)
        return self._information(self._factor(states, width), self._omega(variables))

    def value(self, variables: Array, width: float, level: float) -> float:
        """Return the cost alone."""
        information = self.information(variables, width)
        if self._scaled_marginal is not None:
            information = self._scaled_marginal.information(information, 1)
        values = np.linalg.eigvalsh(information)
        values = np.maximum(values, np.finfo(float).eps ** 2 * values[-1])
        return self.criterion.cost(np.log(values), level)[0]

    def derivatives(
        self, variables: Array, width: float, level: float
    ) -> tuple[float, Array, Array]:
        """Return cost, gradient (z,) and positive semidefinite Gauss–Newton Hessian (z, z)."""
        states = self._path.states(variables, self.basis)
        factor = self._factor(states, width)
        cost, directions = self._criterion(factor, variables, level)
        weighted = self._weighted(factor, self._omega(variables))
        count, actuators, m = weighted.shape
        # In the eigenbasis: one factor rotated here, the other after the sum over the samples.
        rotated = (weighted @ directions).transpose(0, 2, 1)
        k = directions.shape[1]
        summed = np.zeros((variables.size, k * m))
        slope = self._path.slope(variables, self.basis)
        for first in range(0, count, _AT_ONCE):
            block = slice(first, first + _AT_ONCE)
            # ∂A/∂state, (samples, 18, 6, m)
            by_state = self._slopes(states[block], width).reshape(-1, states.shape[1], actuators, m)
            products = np.matmul(rotated[block, None], by_state).reshape(len(by_state), -1, k * m)
            summed += slope.part(block).transposed_products(products)
        part = np.matmul(directions.T / count, summed.reshape(-1, k, m).transpose(0, 2, 1))
        change = part + part.transpose(0, 2, 1)
        if self.memory is not None:
            change[-1] += (
                directions.T @ self._spectrum_slope(self.memory, weighted, variables) @ directions
            )
        if cost.subtracted:
            half = k // 2
            change = change[:, :half, :half] - change[:, half:, half:]
        own = np.einsum("zii->zi", change)
        gradient = own @ cost.slope[: own.shape[1]]
        # A product with itself takes half the work of one of two matrices.
        diagonal, mixing = cost.curvature()
        mixed = (change * np.sqrt(mixing)).reshape(len(change), -1)
        hessian = own @ diagonal @ own.T + mixed @ mixed.T
        return cost.value, gradient, hessian

    def gradient(self, variables: Array, width: float, level: float) -> tuple[float, Array]:
        """Return cost and gradient (z,) alone, by one reverse sweep instead of a Jacobian."""
        states = self._path.states(variables, self.basis)
        factor = self._factor(states, width)
        cost, directions = self._criterion(factor, variables, level)
        # tr(∂cost/∂F dF) = Σ 2 (S⁻¹A ∂cost/∂F) : d(S⁻¹A), and so with the noise's own weights.
        by_information = (directions * cost.slope) @ directions.T
        omega = self._omega(variables)
        weighted = factor if self.memory is None else self.memory.weighted(factor, omega)
        by_factor = weighted.reshape(-1, len(directions)) @ (by_information * (2 / len(factor)))
        flat = by_factor.reshape(len(factor), -1)
        (by_state,) = self._kernels[1](states, flat, *self._fixed(width), self._white_rows)
        slope = self._path.slope(variables, self.basis)
        summed = slope.transposed_product(by_state)
        if self.memory is not None:
            summed[-1] += np.sum(
                by_information * self._spectrum_slope(self.memory, weighted, variables)
            )
        return cost.value, summed

    def _criterion(
        self, factor: Array, variables: Array, level: float
    ) -> tuple[SpectralCost, Array]:
        """Return the criterion's derivatives, and the eigenbasis of the judged information.

        The basis, (m, k), is multiplied by the scaling: it applies to all columns of A, unscaled.
        """
        information = self._information(factor, self._omega(variables))
        if self._scaled_marginal is None:
            cost = spectral_cost(information, self.criterion, level)
        else:
            cost = self._scaled_marginal.cost(information, 1, self.criterion, level)
        directions = np.zeros((factor.shape[2], cost.basis.shape[1]))
        directions[self.columns] = self.scaling[:, None] * cost.basis
        return cost, directions

    @property
    def kernels(self) -> list[BatchFunction]:
        """The functions of a search, the largest one first."""
        return [_slope_kernel(self.terms), *self._kernels]

    def criterion_value(self, cost: float) -> float:
        """Return the criterion of F over all samples that corresponds to a cost; SI for ``d``."""
        judged = self.scaling if self.marginal is None else self.judged
        log_scale = float(np.sum(np.log(judged)))
        return self.criterion.from_cost(cost, judged.size, self.samples, log_scale)

    @cached_property
    def _scaled_marginal(self) -> Marginal | None:
        return None if self.marginal is None else self.marginal.scaled(self.scaling, self.judged)

    @cached_property
    def _white(self) -> Array:
        """S⁻¹ of white noise; coloured noise is not whitened sample by sample."""
        return np.eye(COORDINATES) if self.memory is not None else whitening(self.covariance)

    @cached_property
    def _white_rows(self) -> Array:
        """The lower triangle of S⁻¹, column by column."""
        return self._white.T[np.triu_indices(COORDINATES)]

    @property
    def _kernels(self) -> tuple[BatchFunction, BatchFunction]:
        """Compiled functions of S⁻¹A, or S⁻¹[A | Z], and of the gradient of its weighted sum."""
        if self.effects is None:
            return _factor_kernel(self.terms), _gradient_kernel(self.terms)
        groups = self.effects.groups
        return _deviating_factor_kernel(groups), _deviating_gradient_kernel(groups)

    def _fixed(self, width: float) -> tuple[Array, ...]:
        if self.effects is None:
            return self.machine, np.array([width])
        return self.effects.machine, self.effects.parameters, np.array([width])

    def _slopes(self, states: Array, width: float) -> Array:
        """Return the derivatives of A to each number of the states, (N, 18, …).

        With deviations they are difference quotients, accurate to some 1e-6, of S⁻¹[A | Z]: they
        enter the Hessian alone, and their own code would be twenty times longer.
        """
        if self.effects is None:
            (slopes,) = _slope_kernel(self.terms)(states, *self._fixed(width))
            return slopes
        count, size = states.shape
        speeds = self.variables.omega_scale ** np.arange(size // COORDINATES)
        steps = _STEP * np.multiply.outer(speeds, self.variables.scale).ravel()
        moved = states[:, None] + np.diag(steps)
        ahead = self._factor(moved.reshape(-1, size), width)
        here = self._factor(states, width)
        change = ahead.reshape(count, size, *here.shape[1:]) - here[:, None]
        return np.asarray(change / steps[:, None, None])

    def _omega(self, variables: Array) -> float:
        return float(variables[-1] * self.variables.omega_scale)

    def _factor(self, states: Array, width: float) -> Array:
        """Return A at every state, (N, 6, m), whitened for white noise."""
        (factor,) = self._kernels[0](states, *self._fixed(width), self._white_rows)
        return factor

    def _information(self, factor: Array, omega: float) -> Array:
        """Return the scaled F per sample, (M, M), from the result of `_factor`."""
        if self.memory is not None:
            information = self.memory.information(factor, omega) / len(factor)
        else:
            stacked = factor.reshape(-1, factor.shape[2])
            information = stacked.T @ stacked / len(factor)
        judged = information[np.ix_(self.columns, self.columns)]
        return np.asarray(judged * np.multiply.outer(self.scaling, self.scaling))

    def _weighted(self, factor: Array, omega: float) -> Array:
        """Return A weighted by the noise: dF is twice the symmetric part of Σ (weighted A)ᵀ dA.

        With dA as of `_slopes`.
        """
        if self.memory is not None:
            return self.memory.weighted(factor, omega)
        return factor if self.effects is not None else np.matmul(self._white.T, factor)

    def _spectrum_slope(self, memory: PeriodicNoise, weighted: Array, variables: Array) -> Array:
        """Return the derivative of F per sample to the scaled ω through the spectrum, (m, m)."""
        slope = memory.slope(weighted, self._omega(variables))
        return slope * (self.variables.omega_scale / len(weighted))


class DeviationColumns(NamedTuple):
    """Columns Z of deviations at fixed lengths, with the numbers that they depend on."""

    groups: DeviationGroups
    machine: Array
    """Geometry, constants and load, of all the terms."""
    parameters: Array
    """Nominal, of all the terms."""


def _whiten(columns: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return S⁻¹ times columns, (6, m), and the lower triangle of S⁻¹, column after column."""
    white = ca.SX.sym("white", _TRIANGLE.nnz())
    return ca.mtimes(ca.SX(_TRIANGLE, white), columns), white


def _factor(graph: HexapodGraph) -> tuple[ca.SX, list[ca.SX]]:
    """Return the smoothed S⁻¹A, (6, m), and its inputs other than the state."""
    factor, white = _whiten(graph.regressor_with(Friction.SMOOTH))
    return factor, [graph.machine, graph.width, white]


@kernel
def _factor_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → S⁻¹A (6, m)."""
    graph = hexapod_graph(terms)
    factor, fixed = _factor(graph)
    return Graph("regressor", [graph.state], fixed, [factor])


@kernel
def _slope_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18) → ∂A/∂state (18, 6 m)."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.SMOOTH)
    slopes = ca.jacobian(ca.vec(regressor.T), graph.state).T
    return Graph("regressor_slopes", [graph.state], [graph.machine, graph.width], [slopes])


@kernel
def _gradient_kernel(terms: tuple[Term, ...]) -> Graph:
    """State (18), weights (6 m) → gradient of the weighted sum of S⁻¹A's elements (18)."""
    graph = hexapod_graph(terms)
    factor, fixed = _factor(graph)
    weights = ca.SX.sym("weight", factor.numel())
    gradient = ca.jtimes(ca.vec(factor.T), graph.state, weights, True)
    return Graph("regressor_pulled", [graph.state, weights], fixed, [gradient])


@kernel
def _deviating_factor_kernel(groups: DeviationGroups) -> Graph:
    """State (18 or 24) → S⁻¹[A | Z] (6, m + t)."""
    graph, state, columns = fixed_length_graph(groups)
    factor, white = _whiten(columns)
    fixed = [graph.machine, graph.parameters, graph.width, white]
    return Graph("deviating_regressor", [state], fixed, [factor])


@kernel
def _deviating_gradient_kernel(groups: DeviationGroups) -> Graph:
    """State (18 or 24), weights (6 (m + t)) → gradient of the weighted sum of S⁻¹[A | Z]."""
    graph, state, columns = fixed_length_graph(groups)
    factor, white = _whiten(columns)
    weights = ca.SX.sym("weight", factor.numel())
    gradient = ca.jtimes(ca.vec(factor.T), state, weights, True)
    fixed = [graph.machine, graph.parameters, graph.width, white]
    return Graph("deviating_regressor_pulled", [state, weights], fixed, [gradient])
