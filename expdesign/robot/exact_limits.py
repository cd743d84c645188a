"""The unsmoothed model of a robot with its limits, as users read them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np

from constraints import Limit, LimitDefinition
from constraints.arrays import Array
from expdesign.mechanism.graph import Friction, hexapod_graph
from expdesign.mechanism.term import Term
from expdesign.robot.batch import BatchFunction
from expdesign.robot.robot import Robot


@cache
def _exact_kernel(
    definitions: tuple[LimitDefinition, ...], terms: tuple[Term, ...]
) -> BatchFunction:
    graph = hexapod_graph(terms)
    quantities = graph.quantities(Friction.EXACT)
    rows = ca.vertcat(*(ca.densify(d.natural(quantities)) for d in definitions))
    state, machine, parameters, length, _ = graph.inputs(Friction.EXACT)
    return BatchFunction("exact_limits", [state], [machine, parameters, length], [rows])


@dataclass(frozen=True)
class ExactModel:
    """Limits at any state by the unsmoothed model; shares no code with the optimiser's rows.

    Attributes
    ----------
    robot : Robot
    limits : tuple of Limit
    """

    robot: Robot
    limits: tuple[Limit, ...]

    def values(self, states: Array) -> Array:
        """Return every limited quantity, (N, R), in SI units at the states (N, 18)."""
        kernel = _exact_kernel(tuple(limit.definition for limit in self.limits), self.robot.terms)
        (values,) = kernel(
            states,
            self.robot.machine,
            self.robot.parameters,
            np.array([self.robot.characteristic_length]),
        )
        return values

    def violations(self, states: Array) -> Array:
        """Return (N, R) excess over the bounds as a share of each range; NaN counts as broken."""
        values = self.values(states)
        return np.concatenate(
            [
                np.empty((len(values), 0)),
                *(
                    np.nan_to_num(limit.violation(values[:, columns]), nan=np.inf, neginf=-np.inf)
                    for limit, columns in zip(self.limits, self.columns(), strict=True)
                ),
            ],
            axis=1,
        )

    def columns(self) -> list[slice]:
        """Return the columns of each limit in `values`."""
        sizes = np.cumsum([0, *(limit.lower.size for limit in self.limits)])
        return [slice(a, b) for a, b in pairwise(sizes)]
