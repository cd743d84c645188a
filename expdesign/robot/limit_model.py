"""The limits of a robot along its states, and robots from files with their limits at home.

`values` and `violations` are what users read: natural expressions, exact signs of dry friction.
`smooth_values` and its derivatives are equivalent differentiable forms for an optimiser. The two
share only the graph.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from os import PathLike

import casadi as ca
import numpy as np

from constraints import Limit, LimitDefinition, limit_definitions
from constraints.arrays import Array, Mask
from expdesign.configuration import InputError, Problem, ResolvedRobot, quantity_text
from expdesign.configuration.limits import row_labels
from expdesign.configuration.robot import load_robot_description
from expdesign.evaluation.batch import BatchFunction, Graph, kernel
from expdesign.mechanism.graph import HexapodGraph, hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import Friction, Term
from expdesign.robot.robot import Robot

JERK = "strut_jerk"
"""Quantity that needs the third derivative of the pose: limits that read it make states longer."""


def states_at_rest(poses: Array) -> Array:
    """Return states, (N, 18), of poses (N, 6) without speed and acceleration."""
    return np.concatenate([poses, np.zeros((len(poses), 2 * COORDINATES))], axis=1)


def limited_quantities(
    graph: HexapodGraph, definitions: tuple[LimitDefinition, ...], friction: Friction
) -> tuple[ca.SX, Mapping[str, ca.SX]]:
    """Return the state, (18, 1) or (24, 1), and the quantities of the limits."""
    state, quantities = graph.state, dict(graph.quantities(friction))
    if any(JERK in definition.requires for definition in definitions):
        third = ca.SX.sym("pose_jerk", COORDINATES)
        moving = ca.vertcat(graph.rate, graph.acceleration, third)
        quantities[JERK] = ca.jtimes(quantities["strut_acceleration"], state, moving)
        state = ca.vertcat(state, third)
    for definition in definitions:
        missing = set(definition.requires) - set(quantities)
        if missing:
            what = ", ".join(sorted(missing))
            raise ValueError(f"limit '{definition.key}' needs {what}: the mechanism has no such")
    return state, quantities


@kernel
def _kernel(
    definitions: tuple[LimitDefinition, ...],
    terms: tuple[Term, ...],
    friction: Friction,
    *,
    slopes: bool,
) -> Graph:
    """State, machine, parameters, characteristic length (, friction's width) → rows (, slopes).

    With exact friction: every limit's natural expression, without slopes; with smooth friction:
    all rows of the optimiser together.
    """
    graph = hexapod_graph(terms)
    _, *fixed = graph.inputs(friction)
    state, quantities = limited_quantities(graph, definitions, friction)
    if friction is Friction.EXACT:
        natural = [ca.densify(one.natural(quantities)) for one in definitions]
        return Graph("limits", [state], fixed[:-1], natural)
    # A symbol for the forces: their derivatives are cheaper by another method.
    force, known = ca.SX.sym("force", ACTUATORS), quantities["actuator_force"]
    rows = [ca.cse(one.rows({**quantities, "actuator_force": force})) for one in definitions]
    outputs = [ca.vertcat(ca.SX(0, 1), *rows)]
    if slopes:
        # Each limit by itself: CasADi takes the cheaper direction of differentiation for each, and
        # half as many instructions are left as with the one that serves all.
        by_force = graph.force_slope(friction, state)
        own = [ca.jacobian(part, state) + ca.jacobian(part, force) @ by_force for part in rows]
        outputs.append(ca.vertcat(ca.SX(0, state.numel()), *own))
    return Graph("limits", [state], fixed, ca.substitute(outputs, [force], [known]))


@dataclass(frozen=True, eq=False)
class LimitModel:
    """Limits of a robot as R rows of every state, all limits side by side.

    States are pose, rate and acceleration, (N, 18), and for a limit on the struts' jerk the third
    derivative of the pose as well, (N, 24).
    """

    robot: Robot
    limits: tuple[Limit, ...]

    @classmethod
    def of(cls, robot: Robot, *more: Limit) -> LimitModel:
        """Return the model of a robot's own limits, and of more."""
        return cls(robot, (*robot.limits, *more))

    @classmethod
    def boundless(cls, robot: Robot) -> LimitModel:
        """Return the model of everything that can be limited, with no bounds: for its values."""
        definitions = limit_definitions().values()
        return cls(robot, tuple(Limit.boundless(one, row_labels(one)) for one in definitions))

    @property
    def kernels(self) -> list[BatchFunction]:
        """The functions of a search, the largest one first."""
        smooth = [self._kernel(Friction.SMOOTH, slopes=slopes) for slopes in (True, False)]
        return [*smooth, self._kernel(Friction.EXACT, slopes=False)]

    def among(self, rows: Mask) -> LimitModel:
        """Return the model of those limits that rows (N, R) mark somewhere: less to evaluate."""
        parts = zip(self.limits, self.columns, strict=True)
        return replace(self, limits=tuple(a for a, columns in parts if np.any(rows[:, columns])))

    @cached_property
    def columns(self) -> list[slice]:
        """The rows of each limit, as columns of `values`."""
        sizes = np.cumsum([0, *(limit.lower.size for limit in self.limits)])
        return [slice(a, b) for a, b in pairwise(sizes)]

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """(R,) key of the limit that each row belongs to."""
        return tuple(limit.key for limit in self.limits for _ in limit.labels)

    @cached_property
    def two_sided(self) -> Mask:
        """(R,) True for rows with two bounds."""
        lower, upper, _ = self._bounds
        return np.isfinite(lower) & np.isfinite(upper)

    @cached_property
    def scale(self) -> Array:
        """(R,) range of every smooth row: its scale in a nonlinear program."""
        lower, upper = self.smooth_bounds()
        both = np.isfinite(lower) & np.isfinite(upper)
        width = np.subtract(upper, lower, out=np.ones_like(upper), where=both)
        one = np.abs(np.where(np.isfinite(lower), lower, upper))
        scale = np.where(both, width, one)
        return np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)

    def values(self, states: Array) -> Array:
        """Return every limited quantity, (N, R), in SI units, by the unsmoothed model.

        States may have the third derivative though no limit needs it.
        """
        needed = states[..., : self._state_size]
        natural = self._kernel(Friction.EXACT, slopes=False)(needed, *self._fixed())
        rows = [
            values if limit.definition.numerical is None else limit.definition.numerical(values)
            for limit, values in zip(self.limits, natural, strict=True)
        ]
        return np.concatenate([np.empty((len(states), 0)), *rows], axis=1)

    def at_home(self) -> dict[str, Array]:
        """Return every limited quantity at rest at home, (k,), SI, by the limit's key."""
        row = self.values(states_at_rest(self.robot.home[None, :]))[0]
        pairs = zip(self.limits, self.columns, strict=True)
        return {limit.key: row[columns] for limit, columns in pairs}

    def violations(self, states: Array) -> Array:
        """Return (N, R) excess over the bounds as a share of each range; NaN counts as broken."""
        return self.excess(self.values(states))

    def excess(self, values: Array) -> Array:
        """Return the same of values, (N, R)."""
        return _excess(values, *self._bounds)

    def smooth_bounds(self, margins: Array | None = None) -> tuple[Array, Array]:
        """Return bounds on the smooth rows, (R,) each, or (…, R) like the margins.

        These are how far the natural bounds are drawn in, as shares of their ranges.
        """
        if margins is None:
            return self._smooth_bounds
        parts = [
            limit.smooth_bounds(margins[..., columns])
            for limit, columns in zip(self.limits, self.columns, strict=True)
        ]
        lower, upper = ([part[side] for part in parts] or [margins] for side in (0, 1))
        return np.concatenate(lower, axis=-1), np.concatenate(upper, axis=-1)

    def smooth_values(self, states: Array, width: float) -> Array:
        """Return the rows that an optimiser sees, (N, R), with dry friction of a width in m/s."""
        (values,) = self._kernel(Friction.SMOOTH, slopes=False)(states, *self._fixed(width))
        return values

    def smooth_slopes(self, states: Array, width: float) -> tuple[Array, Array]:
        """Return the same and their derivatives to the states, (N, R, 18 or 24)."""
        values, slopes = self._kernel(Friction.SMOOTH, slopes=True)(states, *self._fixed(width))
        return values, slopes

    def smooth_violations(self, states: Array, width: float) -> Array:
        """Return (N, R) excess of the smooth rows over their bounds, as shares of `scale`.

        Open rows are at −inf; a value that is not a number counts as broken.
        """
        return _excess(self.smooth_values(states, width), *self.smooth_bounds(), self.scale)

    @cached_property
    def moving(self) -> Mask:
        """(R,) True for rows that depend on more than the pose: speeds, forces, jerk."""
        state = np.zeros((1, self._state_size))
        state[0, :COORDINATES] = self.robot.home
        _, slopes = self.smooth_slopes(state, 1.0)
        return np.any(slopes[0, :, COORDINATES:] != 0, axis=1)

    @cached_property
    def of_jerk(self) -> Mask:
        """(R,) True for rows with the third derivative of the pose."""
        needed = [JERK in one.definition.requires for one in self.limits for _ in one.labels]
        return np.array(needed, dtype=bool)

    @cached_property
    def _state_size(self) -> int:
        return (4 if np.any(self.of_jerk) else 3) * COORDINATES

    @cached_property
    def _smooth_bounds(self) -> tuple[Array, Array]:
        return self.smooth_bounds(np.zeros(len(self.keys)))

    @cached_property
    def _bounds(self) -> tuple[Array, Array, Array]:
        """Lower and upper bounds of the natural rows and their ranges, (R,) each."""
        parts = [(limit.lower, limit.upper, limit.range) for limit in self.limits]
        lower, upper, width = zip(*parts, strict=True) if parts else [(np.empty(0),)] * 3
        return np.concatenate(lower), np.concatenate(upper), np.concatenate(width)

    def _kernel(self, friction: Friction, *, slopes: bool) -> BatchFunction:
        return _kernel(self._definitions, self.robot.terms, friction, slopes=slopes)

    @cached_property
    def _definitions(self) -> tuple[LimitDefinition, ...]:
        return tuple(limit.definition for limit in self.limits)

    def _fixed(self, *width: float) -> tuple[Array, ...]:
        robot = self.robot
        scalars = (np.array([value]) for value in (robot.characteristic_length, *width))
        return robot.machine, robot.parameters, *scalars


def _excess(values: Array, lower: Array, upper: Array, width: Array) -> Array:
    excess = np.maximum(lower - values, values - upper) / width
    return np.nan_to_num(excess, nan=np.inf, posinf=np.inf, neginf=-np.inf)


# --- robots from files, at rest within their limits -----------------------------------------------

_ANOTHER_UNIT = 30.0
"""Smallest ratio of bounds to values for bounds in millimetres."""


def load_robot(source: str | PathLike[str]) -> Robot:
    """Load a robot that ships by its name, or one from a YAML file.

    Raises `InputError` with the place, the fault and the allowed values.

    Examples
    --------
    >>> robot = load_robot("palida")
    >>> robot.inverse_kinematics(robot.home).round(3).tolist()  # m
    [0.676, 0.676, 0.676, 0.676, 0.676, 0.676]
    """
    return robot_from(load_robot_description(source))


def robot_from(description: ResolvedRobot) -> Robot:
    """Build a robot from its description; refuse it when its home pose breaks a limit at rest.

    The `InputError` has every limit that is broken there, with its value and bound.
    """
    robot = Robot(description)
    model = LimitModel.of(robot)
    values = model.at_home()
    problems = []
    for limit in model.limits:
        problems += _broken(limit, values[limit.key], description)
    if problems:
        raise InputError(problems)
    return robot


def _broken(limit: Limit, values: Array, robot: ResolvedRobot) -> list[Problem]:
    """Return the violations of a limit at home, one problem for rows with the same bounds."""
    # With a default limit the robot's home is the fault.
    file, line = (robot.source, None) if limit.is_default else (limit.file, limit.line)
    remedy = f"Let home lie elsewhere, or {_widen(limit)}"
    if limit.reserve:
        remedy = (
            f"{100 * limit.reserve:.4g} % of its range are kept free (limits.reserve). Let home "
            f"lie elsewhere, keep less free, or {_widen(limit)}"
        )
    remedy += f". {limit.definition.remedy}" if limit.definition.remedy else ""
    groups: dict[tuple[float, float], list[int]] = {}
    for row, value in enumerate(values):
        if limit.violation_of(row, float(value)) > 0:
            groups.setdefault((float(limit.lower[row]), float(limit.upper[row])), []).append(row)
    problems = []
    for bounds, rows in groups.items():
        low, high = (
            quantity_text(float(end(values[rows])), limit.unit) for end in (np.min, np.max)
        )
        message = (
            f"the home pose breaks this limit: {limit.definition.title}{_where(limit, rows)} is "
            f"{low if low == high else f'{low} to {high}'} there. {remedy}"
        )
        allowed = _allowed_range(*bounds, limit.unit)
        nearest = _in_millimetres(*bounds, values[rows], limit.unit)
        problems.append(Problem(message, file, line, f"limits.{limit.key}", allowed, nearest))
    return problems


def _widen(limit: Limit) -> str:
    """Return the advice to widen a limit, with its key and the needed bound.

    The key of a default is spelled out, since the user has not written it.
    """
    which = "the limit, which is a default" if limit.is_default else "the limit"
    widest = limit.definition.widest
    if widest is None:
        return f"widen {which}"
    return f"widen {which}, with limits.{limit.key}: {quantity_text(widest, limit.unit)} at most"


def _where(limit: Limit, rows: list[int]) -> str:
    named = [limit.labels[row] for row in rows if limit.labels[row]]
    if len(named) > 1 and len(named) == len(limit.labels):
        return " of all struts" if limit.definition.per_actuator else ""
    return f" of {', '.join(named)}" if named else ""


def _allowed_range(lower: float, upper: float, unit: str) -> str:
    if np.isfinite(lower) and np.isfinite(upper):
        return f"{quantity_text(lower, unit)} to {quantity_text(upper, unit)}"
    if np.isfinite(upper):
        return f"at most {quantity_text(upper, unit)}"
    return f"at least {quantity_text(lower, unit)}"


def _in_millimetres(lower: float, upper: float, values: Array, unit: str) -> str | None:
    """Return the bounds in millimetres when home keeps those: plain numbers are metres."""
    if unit != "m" or not np.all((1e3 * values >= lower) & (1e3 * values <= upper)):
        return None
    bounds = np.abs([bound for bound in (lower, upper) if np.isfinite(bound) and bound])
    if np.min(bounds, initial=np.inf) < _ANOTHER_UNIT * np.max(np.abs(values)):
        return None  # as large as what it bounds: no slip of the unit
    ends = [f"{bound:g} mm" for bound in (lower, upper) if np.isfinite(bound)]
    return f"[{', '.join(ends)}]" if len(ends) > 1 else ends[0]
