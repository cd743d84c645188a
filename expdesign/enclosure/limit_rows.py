"""Enclosures of every limited quantity of a robot over cells of time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from constraints import LimitDefinition
from constraints.arrays import Array, Mask
from constraints.limits import jacobian_condition
from expdesign.enclosure.arithmetic import EPS
from expdesign.enclosure.instructions import EnclosedFunction, NoEnclosureError
from expdesign.enclosure.matrices import TaylorMatrix, condition_bound
from expdesign.enclosure.taylor_model import TaylorModel, sign
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Friction, Term
from expdesign.robot import LimitModel
from expdesign.robot.limit_model import limited_quantities

STILL = 1e-9
"""Rate, m/s or rad/s, below which a joint is at rest: dry friction may have either sign."""


@dataclass(frozen=True, eq=False)
class EnclosedRow:
    """Bounds of one row of a limit over N cells, valid for every choice of the undecided signs."""

    model: TaylorModel
    """With the known signs of dry friction in a cell; unknown ones count zero."""
    jump: Array
    """(N,), largest effect of the signs that may change within a cell, up or down."""
    changing: Array
    """(N,), share of moving joints in it; of joints at rest both signs count anyway."""
    middle: Array | None = None
    """(N,), values in the middle of the cells, if the model is only an upper bound."""

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds, (N,) each."""
        low, high = self.model.bounds()
        return low - self.jump * (1 + 4 * EPS), high + self.jump * (1 + 4 * EPS)


class EnclosedLimits:
    """The limits of a model over cells of time.

    Raises
    ------
    NoEnclosureError
        A limit has an operation without enclosure, or a numerical computation other than singular
        values.
    """

    def __init__(self, limits: LimitModel) -> None:
        robot = limits.robot
        self.limits = limits
        for one in limits.limits:
            if one.definition.numerical not in (None, jacobian_condition.LIMIT.numerical):
                raise NoEnclosureError(
                    f"no enclosure of what limit '{one.key}' computes by numbers"
                )
        self._graph = _enclosed_graph(tuple(one.definition for one in limits.limits), robot.terms)
        numbers = (robot.machine, robot.parameters, np.array([robot.characteristic_length]))
        self._fixed = [[TaylorModel.number(value) for value in part] for part in numbers]

    @property
    def state_size(self) -> int:
        """Number of models of the state: 18, or 24 if a limit needs the pose's jerk."""
        return self._graph.state_size

    def __call__(
        self, states: Sequence[TaylorModel], which: Collection[int]
    ) -> tuple[dict[int, list[EnclosedRow]], Array]:
        """Return the rows of some limits, by their number, and a sign change of friction.

        The sign change of a rate in each cell is at τ, (N,); NaN without one for sure.
        """
        graph, cells = self._graph, max(model.radius.size for model in states)
        inputs = [list(states[: self.state_size]), *self._fixed]
        direct, loaded = ([k for k in which if k in part] for part in (graph.direct, graph.loaded))
        wanted = [2 + graph.direct.index(k) for k in direct]
        transposed, rates, *rows = graph.first(inputs, [0, 1, *wanted] if loaded else wanted)
        found = {k: self._natural(k, rows[graph.direct.index(k)], cells) for k in direct}
        turns = np.full(cells, np.nan)
        if loaded:
            inverse = TaylorMatrix.of(transposed, ACTUATORS, cells).inverse().models()
            signs = [(sign(rate), rate.size > STILL) for rate in rates]
            for rate in rates:
                turns = np.where(np.isnan(turns), rate.root(), turns)
            places = [graph.loaded.index(k) for k in loaded]
            parts = graph.second(
                [*inputs, inverse], [out for p in places for out in (2 * p, 2 * p + 1)]
            )
            for k, place in zip(loaded, places, strict=True):
                values, slopes = parts[2 * place], parts[2 * place + 1]
                found[k] = [
                    _with_signs(
                        value, [(*signs[s], slopes[n]) for n, s in graph.signed[place][row]]
                    )
                    for row, value in enumerate(values)
                ]
        return found, turns

    def _natural(self, k: int, entries: list[TaylorModel], cells: int) -> list[EnclosedRow]:
        nothing = np.zeros(1)
        numerical = self.limits.limits[k].definition.numerical
        if numerical is None:
            return [EnclosedRow(model, nothing, nothing) for model in entries]
        matrix = TaylorMatrix.of(entries, ACTUATORS, cells)
        middle = numerical(matrix.coefficients[0].swapaxes(1, 2).reshape(cells, -1))[:, 0]
        return [EnclosedRow(condition_bound(matrix), nothing, nothing, middle)]


def _with_signs(
    value: TaylorModel, terms: Sequence[tuple[TaylorModel, Mask, TaylorModel]]
) -> EnclosedRow:
    """Add s J of every sign s and its slope J; signs that may change add to the jump.

    A term is a sign, whether its joint moves, (N,), and the slope.
    """
    jump, changing = np.zeros(1), np.zeros(1)
    for s, moves, slope in terms:
        known, free = s.coefficients[0], s.radius
        if np.any(known):
            value = value + TaylorModel(slope.coefficients * known, slope.radius * np.abs(known))
        if np.any(free):
            low, high = slope.bounds()
            most = np.maximum(-low, high) * free * (1 + 8 * EPS)
            jump, changing = jump + most, changing + np.where(moves, most, 0.0)
    return EnclosedRow(value, jump * (1 + 64 * EPS), changing)


@dataclass(frozen=True, eq=False)
class _EnclosedGraph:
    first: EnclosedFunction
    """State … → Gᵀ, the rates with signs, and the rows of the limits in `direct`."""
    second: EnclosedFunction
    """The same and G⁻ᵀ → rows without dry friction and their slopes to its signs, of `loaded`."""
    direct: list[int]
    loaded: list[int]
    """Limits that depend on the forces."""
    signed: list[list[list[tuple[int, int]]]]
    """Of each limit in `loaded` and each of its rows, (place among the slopes, sign)."""
    state_size: int


@cache
def _enclosed_graph(
    definitions: tuple[LimitDefinition, ...], terms: tuple[Term, ...]
) -> _EnclosedGraph:
    graph = hexapod_graph(terms, open_inverse=True)
    state, quantities = limited_quantities(graph, definitions, Friction.HELD)
    fixed = [graph.machine, graph.parameters, graph.length_scale]
    rows = [ca.densify(one.natural(quantities)) for one in definitions]
    forced = [
        bool(
            ca.depends_on(part, ca.vertcat(ca.vec(graph.inverse_jacobian_transposed), graph.signs))
        )
        for part in rows
    ]
    direct = [k for k, needs in enumerate(forced) if not needs]
    loaded = [k for k, needs in enumerate(forced) if needs]
    slopes = [ca.cse(ca.jacobian(rows[k], graph.signs)) for k in loaded]
    for k, slope in zip(loaded, slopes, strict=True):
        if ca.depends_on(slope, graph.signs):
            raise NoEnclosureError(
                f"limit '{definitions[k].key}' is not linear in the signs of friction"
            )
    none = ca.SX.zeros(graph.signs.shape)
    without = [ca.substitute(rows[k], graph.signs, none) for k in loaded]
    signed = []
    for slope in slopes:
        own: list[list[tuple[int, int]]] = [[] for _ in range(slope.shape[0])]
        for n, (row, column) in enumerate(zip(*slope.sparsity().get_triplet(), strict=True)):
            own[row].append((n, column))
        signed.append(own)
    outputs = [ca.vec(graph.transposed), graph.sliding, *(rows[k] for k in direct)]
    pairs = [
        part
        for value, slope in zip(without, slopes, strict=True)
        for part in (value, ca.vertcat(ca.SX(0, 1), slope.nz[:]))
    ]
    return _EnclosedGraph(
        EnclosedFunction([state, *fixed], outputs),
        EnclosedFunction([state, *fixed, ca.vec(graph.inverse_jacobian_transposed)], pairs),
        direct,
        loaded,
        signed,
        state.numel(),
    )
