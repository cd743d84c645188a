"""Limits at chosen instants: rows of the NLP that enter and leave while it is solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from constraints import LimitDefinition
from constraints.arrays import Array, Mask
from expdesign.mechanism.graph import Friction, HexapodGraph
from expdesign.problem.variables import DesignVariables
from expdesign.robot.batch import BatchFunction
from expdesign.trajectory import PhaseBasis


@dataclass(frozen=True)
class LimitKernels:
    """All limits of one instant, in the form the optimiser sees.

    The value takes state, machine, parameters, characteristic length and the friction's width;
    the derivative is to the state.
    """

    value: BatchFunction
    derivative: BatchFunction

    @classmethod
    def of(cls, graph: HexapodGraph, definitions: Sequence[LimitDefinition]) -> LimitKernels:
        """Compile the rows of the limits given, in their order."""
        quantities = graph.quantities(Friction.SMOOTH)
        rows = ca.cse(ca.vertcat(*(definition.rows(quantities) for definition in definitions)))
        slope = ca.cse(ca.jacobian(rows, graph.state))
        _, *fixed = graph.inputs(Friction.SMOOTH)
        return cls(
            BatchFunction("limits", [graph.state], fixed, [rows]),
            BatchFunction("limits_slope", [graph.state], fixed, [rows, slope]),
        )


@dataclass(frozen=True)
class LimitRows:
    """Which limit holds at which phase of the period.

    Attributes
    ----------
    phases : (K,)
        ωt in rad.
    mask : (K, R) of bool
        Rows that the NLP contains.
    lower, upper : (K, R)
        Bounds on the smooth rows, margins included.
    """

    phases: Array
    mask: Mask
    lower: Array
    upper: Array

    @property
    def count(self) -> int:
        """Number of rows in the NLP."""
        return int(np.count_nonzero(self.mask))

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of the rows, (count,)."""
        return self.lower[self.mask], self.upper[self.mask]


@dataclass(frozen=True)
class LimitEvaluator:
    """Evaluates limit rows for one robot: kernels bound to their fixed inputs."""

    kernels: LimitKernels
    variables: DesignVariables
    machine: Array
    parameters: Array
    characteristic_length: float

    def values(self, variables: Array, phases: Array, width: float) -> Array:
        """Return every smooth row at every phase, (K, R)."""
        basis = PhaseBasis.at(phases, self.variables.harmonics)
        states = self.variables.states(variables, basis)
        (rows,) = self.kernels.value(states, *self._fixed(width))
        return rows

    def jacobian(self, variables: Array, rows: LimitRows, width: float) -> tuple[Array, Array]:
        """Return values (count,) and Jacobian (count, z) of the rows in the NLP."""
        basis = PhaseBasis.at(rows.phases, self.variables.harmonics)
        states = self.variables.states(variables, basis)
        values, slopes = self.kernels.derivative(states, *self._fixed(width))
        dense = self.variables.to_variables(variables, basis, slopes)
        return values[rows.mask], dense[rows.mask]

    def _fixed(self, width: float) -> tuple[Array, ...]:
        return (
            self.machine,
            self.parameters,
            np.array([self.characteristic_length]),
            np.array([width]),
        )
