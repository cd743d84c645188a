"""The objective: a criterion of F over the samples of one period, with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.batch import Graph
from expdesign.evaluation.kernel import kernel
from expdesign.information.criteria import Criterion, SpectralCost, spectral_cost
from expdesign.information.fisher import PeriodicNoise, whitening
from expdesign.information.prior import PriorMachine
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.problem.variables import DesignVariables
from expdesign.trajectory import PhaseBasis

_AT_ONCE = 64
"""Samples whose derivatives are held in memory together: 0.1 MB each."""


_TRIANGLE = ca.Sparsity.lower(COORDINATES)


def _factor(graph: HexapodGraph) -> tuple[ca.SX, list[ca.SX]]:
    """Return the smoothed S⁻¹A, (6, m), and its inputs other than the state.

    The last input is the lower triangle of S⁻¹, column after column.
    """
    white = ca.SX.sym("white", _TRIANGLE.nnz())
    factor = ca.mtimes(ca.SX(_TRIANGLE, white), graph.regressor_with(Friction.SMOOTH))
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
    """(k,), columns of A in the judged F: all of them with a prior."""
    scaling: Array
    """(k,), factors of the columns of A."""
    criterion: Criterion
    samples: int
    memory: PeriodicNoise | None = None
    """Coloured noise, which replaces Σ; None: white."""
    prior: PriorMachine | None = None
    """Prior knowledge of the machine: the criterion then judges the change of parameters alone."""

    @cached_property
    def basis(self) -> PhaseBasis:
        """The Fourier basis at the samples."""
        phases = 2 * np.pi * np.arange(self.samples) / self.samples
        return PhaseBasis.at(phases, self.variables.harmonics)

    def information(self, variables: Array, width: float) -> Array:
        """Return the scaled, smoothed F per sample, (k, k)."""
        states = self.variables.states(variables, self.basis)
        return self._information(self._factor(states, width), self._omega(variables))

    def value(self, variables: Array, width: float, level: float) -> float:
        """Return the cost alone."""
        information = self.information(variables, width)
        if self._scaled_prior is not None:
            information = self._scaled_prior.information(information, 1)
        values = np.linalg.eigvalsh(information)
        values = np.maximum(values, np.finfo(float).eps ** 2 * values[-1])
        return self.criterion.cost(np.log(values), level)[0]

    def derivatives(
        self, variables: Array, width: float, level: float
    ) -> tuple[float, Array, Array]:
        """Return cost, gradient (z,) and positive semidefinite Gauss–Newton Hessian (z, z)."""
        states = self.variables.states(variables, self.basis)
        factor = self._factor(states, width)
        cost, directions = self._criterion(factor, variables, level)
        weighted = self._weighted(factor, self._omega(variables))
        count, actuators, m = weighted.shape
        # In the eigenbasis: one factor rotated here, the other after the sum over the samples.
        rotated = (weighted @ directions).transpose(0, 2, 1)
        k = directions.shape[1]
        summed = np.zeros((variables.size, k * m))
        slope = self.variables.slope(variables, self.basis)
        for first in range(0, count, _AT_ONCE):
            block = slice(first, first + _AT_ONCE)
            (flat,) = _slope_kernel(self.terms)(states[block], *self._fixed(width))
            # ∂A/∂state, (samples, 18, 6, m)
            by_state = flat.reshape(len(flat), -1, actuators, m)
            products = np.matmul(rotated[block, None], by_state).reshape(len(flat), -1, k * m)
            summed += slope.part(block).transposed_products(products)
        half = np.matmul(directions.T / count, summed.reshape(-1, k, m).transpose(0, 2, 1))
        change = half + half.transpose(0, 2, 1)
        if self.memory is not None:
            change[-1] += directions.T @ self._spectrum_slope(weighted, variables) @ directions
        own = np.einsum("zii->zi", change)
        gradient = own @ cost.slope
        # A product with itself takes half the work of one of two matrices.
        diagonal, mixing = cost.curvature()
        mixed = (change * np.sqrt(mixing)).reshape(len(change), -1)
        hessian = own @ diagonal @ own.T + mixed @ mixed.T
        return cost.value, gradient, hessian

    def gradient(self, variables: Array, width: float, level: float) -> tuple[float, Array]:
        """Return cost and gradient (z,) alone, by one reverse sweep instead of a Jacobian."""
        states = self.variables.states(variables, self.basis)
        factor = self._factor(states, width)
        cost, directions = self._criterion(factor, variables, level)
        # tr(∂cost/∂F dF) = Σ 2 (S⁻¹A ∂cost/∂F) : d(S⁻¹A), and so with the noise's own weights.
        by_information = (directions * cost.slope) @ directions.T
        omega = self._omega(variables)
        weighted = factor if self.memory is None else self.memory.weighted(factor, omega)
        by_factor = weighted.reshape(-1, len(directions)) @ (by_information * (2 / len(factor)))
        flat = by_factor.reshape(len(factor), -1)
        (by_state,) = _gradient_kernel(self.terms)(
            states, flat, *self._fixed(width), self._white_rows
        )
        slope = self.variables.slope(variables, self.basis)
        summed = slope.transposed_product(by_state)
        if self.memory is not None:
            summed[-1] += np.sum(by_information * self._spectrum_slope(weighted, variables))
        return cost.value, summed

    def _criterion(
        self, factor: Array, variables: Array, level: float
    ) -> tuple[SpectralCost, Array]:
        """Return the criterion's derivatives, and the eigenbasis of the judged information.

        The basis, (m, k), is multiplied by the scaling: it applies to all columns of A, unscaled.
        """
        information = self._information(factor, self._omega(variables))
        if self._scaled_prior is None:
            cost = spectral_cost(information, self.criterion, level)
        else:
            cost = self._scaled_prior.cost(information, 1, self.criterion, level)
        directions = np.zeros((factor.shape[2], cost.basis.shape[1]))
        directions[self.columns] = self.scaling[:, None] * cost.basis
        return cost, directions

    def compile(self) -> None:
        """Compile everything that the search evaluates, if there is a compiler for it."""
        for made in (_factor_kernel, _slope_kernel, _gradient_kernel):
            made(self.terms).compile()

    def criterion_value(self, cost: float) -> float:
        """Return the criterion of F over all samples that corresponds to a cost; SI for ``d``."""
        judged = self.scaling if self.prior is None else self.scaling[self.prior.changed]
        log_scale = float(np.sum(np.log(judged)))
        return self.criterion.from_cost(cost, judged.size, self.samples, log_scale)

    @cached_property
    def _scaled_prior(self) -> PriorMachine | None:
        return None if self.prior is None else self.prior.scaled(self.scaling)

    @cached_property
    def _white(self) -> Array:
        """S⁻¹ of white noise; coloured noise is not whitened sample by sample."""
        return np.eye(COORDINATES) if self.memory is not None else whitening(self.covariance)

    @cached_property
    def _white_rows(self) -> Array:
        """Its lower triangle, column after column."""
        return self._white.T[np.triu_indices(COORDINATES)]

    def _fixed(self, width: float) -> tuple[Array, Array]:
        return self.machine, np.array([width])

    def _omega(self, variables: Array) -> float:
        return float(variables[-1] * self.variables.omega_scale)

    def _factor(self, states: Array, width: float) -> Array:
        """Return A at every state, (N, 6, m), whitened for white noise."""
        (factor,) = _factor_kernel(self.terms)(states, *self._fixed(width), self._white_rows)
        return factor

    def _information(self, factor: Array, omega: float) -> Array:
        """Return the scaled F per sample, (k, k), from the result of `_factor`."""
        if self.memory is not None:
            information = self.memory.information(factor, omega) / len(factor)
        else:
            stacked = factor.reshape(-1, factor.shape[2])
            information = stacked.T @ stacked / len(factor)
        judged = information[np.ix_(self.columns, self.columns)]
        return np.asarray(judged * np.multiply.outer(self.scaling, self.scaling))

    def _weighted(self, factor: Array, omega: float) -> Array:
        """Return A weighted by the noise: dF is twice the symmetric part of Σ (weighted A)ᵀ dA."""
        if self.memory is not None:
            return self.memory.weighted(factor, omega)
        return np.matmul(self._white.T, factor)

    def _spectrum_slope(self, weighted: Array, variables: Array) -> Array:
        """Return the derivative of F per sample to the scaled ω through the spectrum, (m, m)."""
        if self.memory is None:
            return np.zeros((weighted.shape[2],) * 2)
        slope = self.memory.slope(weighted, self._omega(variables))
        return slope * (self.variables.omega_scale / len(weighted))
