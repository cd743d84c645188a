"""The objective: a criterion of F over the samples of one period, with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.batch import BatchFunction
from expdesign.information.fisher import whitening
from expdesign.information.marginal import PriorMachine
from expdesign.information.periodic_noise import PeriodicNoise
from expdesign.information.spectral import Criterion, SpectralCost, spectral_cost
from expdesign.mechanism.graph import Friction, hexapod_graph
from expdesign.mechanism.term import Term
from expdesign.problem.variables import DesignVariables
from expdesign.trajectory import PhaseBasis

_AT_ONCE = 64
"""Samples whose derivatives are in memory together: 0.1 MB each, of 20 000 samples 2 GB."""


@cache
def _kernel(terms: tuple[Term, ...], *, slopes: bool) -> BatchFunction:
    """Return the smoothed regressor of one instant (, and its derivatives, (18, 6 m))."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.SMOOTH)
    outputs = [regressor]
    if slopes:
        outputs.append(ca.jacobian(ca.vec(regressor.T), graph.state).T)
    return BatchFunction("regressor", [graph.state], [graph.machine, graph.width], outputs)


@cache
def _pulled_kernel(terms: tuple[Term, ...]) -> BatchFunction:
    """Return what a weighted sum of the smoothed regressor's elements changes with the state."""
    graph = hexapod_graph(terms)
    regressor = graph.regressor_with(Friction.SMOOTH)
    weights = ca.SX.sym("weight", regressor.numel())
    slope = ca.jtimes(ca.vec(regressor.T), graph.state, weights, True)
    fixed = [graph.machine, graph.width]
    return BatchFunction("regressor_pulled", [graph.state, weights], fixed, [slope])


@dataclass(frozen=True)
class InformationCost:
    """Criterion of the smoothed information as a function of the scaled variables."""

    terms: tuple[Term, ...]
    machine: Array
    """(g,), geometry and constants, the graph's input."""
    variables: DesignVariables
    covariance: Array
    """(6, 6), full Σ of the force noise, N²."""
    columns: NDArray[np.intp]
    """(k,), columns of A whose F is judged: all of them with a prior."""
    scaling: Array
    """(k,), every column of A is multiplied by it."""
    criterion: Criterion
    samples: int
    memory: PeriodicNoise | None = None
    """The noise where it is not white: then in place of Σ."""
    prior: PriorMachine | None = None
    """What is known before: the criterion then judges the information of the change alone."""

    @cached_property
    def basis(self) -> PhaseBasis:
        """The Fourier basis at the samples."""
        phases = 2 * np.pi * np.arange(self.samples) / self.samples
        return PhaseBasis.at(phases, self.variables.harmonics)

    def information(self, variables: Array, width: float) -> Array:
        """Return the scaled, smoothed F per sample, (k, k)."""
        states = self.variables.states(variables, self.basis)
        (regressors,) = _kernel(self.terms, slopes=False)(states, self.machine, np.array([width]))
        return self._information(regressors, self._omega(variables))

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
        basis = self.basis
        states = self.variables.states(variables, basis)
        fixed = self.machine, np.array([width])
        (regressors,) = _kernel(self.terms, slopes=False)(states, *fixed)
        weighted, cost = self._judged(regressors, variables, level)
        count, actuators, k = weighted.shape
        every = np.array_equal(self.columns, np.arange(regressors.shape[2]))
        # In the eigenbasis: one factor rotated here, the other after the sum over the samples.
        rotated = (weighted @ cost.basis).transpose(0, 2, 1)
        directions = cost.basis.shape[1]
        summed = np.zeros((variables.size, directions * k))
        slope = self.variables.slope(variables, basis)
        for first in range(0, count, _AT_ONCE):
            block = slice(first, first + _AT_ONCE)
            _, flat = _kernel(self.terms, slopes=True)(states[block], *fixed)
            # ∂A/∂state, (samples, 18, 6, m)
            by_state = flat.reshape(len(flat), -1, actuators, regressors.shape[2])
            chosen = by_state if every else by_state[..., self.columns]
            products = np.matmul(rotated[block, None], chosen).reshape(
                len(flat), -1, directions * k
            )
            summed += slope.part(block).accumulated(products)
        columns = self.scaling[:, None] * cost.basis / count
        half = np.matmul(columns.T, summed.reshape(-1, directions, k).transpose(0, 2, 1))
        change = half + half.transpose(0, 2, 1)
        if self.memory is not None:
            change[-1] += cost.basis.T @ self._spectrum_slope(weighted, variables) @ cost.basis
        own = np.einsum("zii->zi", change)
        gradient = own @ cost.slope
        # A product with itself takes half the work of one of two matrices.
        mixed = (change * np.sqrt(cost.mixing)).reshape(len(change), -1)
        hessian = own @ cost.diagonal @ own.T + mixed @ mixed.T
        return cost.value, gradient, hessian

    def gradient(self, variables: Array, width: float, level: float) -> tuple[float, Array]:
        """Return cost and gradient (z,) alone, by one sweep in reverse in place of a Jacobian."""
        basis = self.basis
        states = self.variables.states(variables, basis)
        fixed = self.machine, np.array([width])
        (regressors,) = _kernel(self.terms, slopes=False)(states, *fixed)
        weighted, cost = self._judged(regressors, variables, level)
        # tr(∂cost/∂F dF) = Σ 2 (Σ⁻¹ A ∂cost/∂F) : dA, back through the column scales.
        by_information = (cost.basis * cost.slope) @ cost.basis.T
        by_regressor = np.zeros_like(regressors)
        by_factor = weighted @ by_information
        by_regressor[..., self.columns] = by_factor * self.scaling * (2 / len(weighted))
        flat = by_regressor.reshape(len(weighted), -1)
        (by_state,) = _pulled_kernel(self.terms)(states, flat, *fixed)
        slope = self.variables.slope(variables, basis)
        summed = slope.accumulated(by_state[:, :, None])[:, 0]
        if self.memory is not None:
            summed[-1] += np.sum(by_information * self._spectrum_slope(weighted, variables))
        return cost.value, summed

    def _judged(
        self, regressors: Array, variables: Array, level: float
    ) -> tuple[Array, SpectralCost]:
        """Return scaled A, weighted by the noise (N, 6, k), and the criterion's derivatives.

        White noise weights every sample by Σ⁻¹. dF is twice the symmetric part of the sum over
        (weighted A)ᵀ dA, its columns scaled.
        """
        omega = self._omega(variables)
        factor = self._factor(regressors)
        information = self._of_factor(factor, omega)
        if self._scaled_prior is None:
            cost = spectral_cost(information, self.criterion, level)
        else:
            cost = self._scaled_prior.cost(information, 1, self.criterion, level)
        if self.memory is not None:
            return self.memory.weighted(factor, omega), cost
        return np.matmul(self._white.T, factor), cost

    def compile(self) -> None:
        """Make the machine code of what the search evaluates, where it can be made."""
        for slopes in (False, True):
            _kernel(self.terms, slopes=slopes).compile()
        _pulled_kernel(self.terms).compile()

    def readable(self, cost: float) -> float:
        """Return the criterion that a cost stands for: F over all samples, SI for ``d``."""
        judged = self.scaling if self.prior is None else self.scaling[self.prior.changed]
        log_scale = float(np.sum(np.log(judged)))
        return self.criterion.from_cost(cost, judged.size, self.samples, log_scale)

    @cached_property
    def _scaled_prior(self) -> PriorMachine | None:
        return None if self.prior is None else self.prior.scaled(self.scaling)

    @cached_property
    def _white(self) -> Array:
        return whitening(self.covariance)

    def _omega(self, variables: Array) -> float:
        return float(variables[-1] * self.variables.omega_scale)

    def _information(self, regressors: Array, omega: float) -> Array:
        """Return the scaled F per sample, (k, k), of A at every sample, (N, 6, m)."""
        return self._of_factor(self._factor(regressors), omega)

    def _of_factor(self, factor: Array, omega: float) -> Array:
        """Return the same of what `_factor` returns."""
        if self.memory is not None:
            return self.memory.information(factor, omega) / len(factor)
        stacked = factor.reshape(-1, factor.shape[2])
        return stacked.T @ stacked / self.samples

    def _factor(self, regressors: Array) -> Array:
        """Return the scaled columns that are judged, whitened if the noise has no memory."""
        chosen = regressors[..., self.columns] * self.scaling
        return np.matmul(self._white, chosen) if self.memory is None else chosen

    def _spectrum_slope(self, weighted: Array, variables: Array) -> Array:
        """Return what the scaled ω changes F per sample by through the spectrum alone, (k, k)."""
        if self.memory is None:
            return np.zeros((weighted.shape[2],) * 2)
        slope = self.memory.slope(weighted, self._omega(variables))
        return slope * (self.variables.omega_scale / len(weighted))
