"""`limits:` against the limits that exist: bounds per row, from the robot, overridden by the run.

What may be given for a limit follows from its definition in `constraints.limits`; a new limit
needs nothing here.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic_core import PydanticCustomError

from constraints import Limit, LimitDefinition, limit_definitions
from constraints.arrays import Mask
from expdesign.configuration.document import Placed
from expdesign.configuration.errors import key_path, nearest, refusal, shown
from expdesign.configuration.fields import by_key, read_only
from expdesign.configuration.quantity import SHARE, dimension_of, quantity_text
from expdesign.configuration.section import LaterEntries
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES, numbered

CHARACTERISTIC_LENGTH = "characteristic_length"
LIMITED_BY_DEFAULT = 2
"""The first format of run files whose limits with a default about home are at it if not given."""
LIMITED_ALWAYS = 3
"""The first format whose limits that nothing lifts stand if not given."""
LIFTED = "none"
"""In place of a bound: nothing limits where there would be a default."""
_PAIRS = tuple(itertools.combinations(range(ACTUATORS), 2))
_ENDS = 2
_PROBES = 65
Bounds = tuple[float, float]
_ENDLESS = (-np.inf, np.inf)


def _as_written(name: str, value: object) -> object:
    """Refuse what is no limit; what is one stays as written until robot and run are merged."""
    if name == CHARACTERISTIC_LENGTH:
        _length(value)
    elif name == RESERVE:
        read_reserve(value)
    else:
        _bounds(name, value)
    return value


def resolve_limits(
    sources: Sequence[Placed[Mapping[str, Any]]], defaults: Mapping[str, Limit] | None = None
) -> tuple[dict[str, Limit], float | None]:
    """Merge the limits of robot and run, as they are stated: without the reserve.

    Parameters
    ----------
    sources : sequence of Placed
        `Limits`. Later ones override earlier ones key by key; components of a limit are keys, too.
    defaults : mapping of Limit, optional
        As of `default_limits`, for what no source gives; none by default.

    Returns
    -------
    limits : dict of Limit
        In the order of the catalogue. Without those that stand by default, and that another one
        holds as well.
    characteristic_length : float or None
        m; None when no source gives it.
    """
    given = dict(defaults or {})
    length: float | None = None
    for source in sources:
        for name, value in source.value.items():
            if name == CHARACTERISTIC_LENGTH:
                length = _length(value)
            elif name != RESERVE:
                given[name] = _overriding(given.get(name), source, *_bounds(name, value))
    kept = {name: given[name] for name in limit_definitions() if name in given}
    kept = {name: limit for name, limit in kept.items() if not np.all(limit.open_rows)}
    held = [
        name
        for name, limit in kept.items()
        if limit.is_default and limit.definition.held_by(kept) is not None
    ]
    return {name: limit for name, limit in kept.items() if name not in held}, length


def default_limits(home: Sequence[float], file_format: int | None = None) -> dict[str, Limit]:
    """Return the limits that stand where nobody gives any, about a home pose (6,), m and rad.

    `file_format` is that of the run file that is read; None: of today.
    """
    found = {}
    for key, definition in limit_definitions().items():
        way, bound, labels = definition.about_home, definition.standing, row_labels(definition)
        if way is not None and (file_format is None or file_format >= LIMITED_BY_DEFAULT):
            middle = np.array([home[COORDINATE_NAMES.index(name)] for name in labels])
            origin = f"{quantity_text(way, definition.unit)} from home"
        elif bound is not None and (file_format is None or file_format >= LIMITED_ALWAYS):
            middle, way = np.zeros(len(labels)), bound
            origin = quantity_text(way, definition.unit)
        else:
            continue
        lower, upper = read_only(middle - way), read_only(middle + way)
        origin = f"{origin}, the default of limits.{key}"
        found[key] = Limit(definition, lower, upper, labels, origin, by_default=labels)
    return found


def lifted_entries(limits: Mapping[str, Any]) -> dict[str, Any]:
    """Return which entries of `Limits` lift a default, nested as they are, with True for each."""
    found: dict[str, Any] = {}
    for name, value in limits.items():
        if isinstance(value, dict):
            inner = {component: True for component, item in value.items() if item == LIFTED}
            found |= {name: inner} if inner else {}
        elif isinstance(value, str) and value == LIFTED:
            found[name] = True
    return found


Limits = Annotated[
    dict[str, Any],
    by_key(_as_written, "limits with their bounds"),
    LaterEntries(lifted_entries),
]
"""Limits as they are written."""


def shared_rows(definition: LimitDefinition, pairs: Iterable[tuple[int, int]]) -> Mask:
    """Return which rows of a limit are those of pairs of struts, from zero, that share a joint."""
    if not definition.pairs:
        return np.zeros(len(row_labels(definition)), dtype=bool)
    return np.isin(np.arange(len(_PAIRS)), [_PAIRS.index(pair) for pair in pairs])


def with_shared_joints(limit: Limit, pairs: Iterable[tuple[int, int]]) -> Limit:
    """Return a limit on pairs of struts without the pairs that share a joint: they have no gap."""
    shared = shared_rows(limit.definition, pairs)
    if not np.any(shared):
        return limit
    lower, upper = np.where(shared, -np.inf, limit.lower), np.where(shared, np.inf, limit.upper)
    return replace(limit, lower=read_only(lower), upper=read_only(upper))


def limits_as_written(
    limits: Mapping[str, Limit], length: float, reserve: Reserve | None = None
) -> dict[str, Any]:
    """Return resolved limits as they can stand under ``limits:``, in SI units: as stated."""
    written: dict[str, Any] = {}
    for name, definition in limit_definitions().items():
        limit, lifts = limits.get(name), definition.about_home is not None
        if limit is None:
            written |= {name: LIFTED} if lifts else {}
            continue
        rows = list(zip(*(side.tolist() for side in limit.stated_bounds), strict=True))
        if definition.components:
            named = zip(definition.components, rows, strict=True)
            bounds = {c: list(row) if np.all(np.isfinite(row)) else LIFTED for c, row in named}
            written[name] = {c: row for c, row in bounds.items() if lifts or row != LIFTED}
            continue
        kind = definition.kind
        if kind == "symmetric" and not all(low == -high for low, high in rows):
            kind = "interval"
        entries = [list(row) if kind == "interval" else row[kind != "lower"] for row in rows]
        alike = all(entry == entries[0] for entry in entries)
        written[name] = entries[0] if alike else entries
    kept_free = {} if reserve is None else reserve.as_written(limits)
    return written | kept_free | {CHARACTERISTIC_LENGTH: length}


def _length(value: object) -> float:
    length = dimension_of("m").parse(value)
    if length <= 0:
        raise refusal(f"{length:g} is not positive", "a length above 0")
    return length


def _bounds(name: str, value: object) -> tuple[LimitDefinition, tuple[Bounds | None, ...]]:
    """Return what is bounded, and the bounds of its rows: of one where all have the same.

    None is a row that is not given; one that is lifted has infinite bounds.
    """
    definitions = limit_definitions()
    if name not in definitions:
        valid = [*definitions, CHARACTERISTIC_LENGTH, RESERVE]
        raise refusal(
            f"unknown limit {shown(name)}", ", ".join(valid), partial(nearest, name, valid)
        )
    definition = definitions[name]
    if not definition.components:
        return definition, _rows(definition, value)
    given = _components(definition, value)
    return definition, tuple(given.get(label) for label in row_labels(definition))


def _overriding(
    earlier: Limit | None,
    source: Placed[Any],
    definition: LimitDefinition,
    rows: tuple[Bounds | None, ...],
) -> Limit:
    """Return a limit of a source, with the earlier one's bounds of the rows that it leaves out."""
    labels, document, key = row_labels(definition), source.document, (*source.key, definition.key)
    each = rows * len(labels) if len(rows) == 1 else rows
    before = [_ENDLESS] * len(labels)
    by_default: tuple[str, ...] = ()
    if earlier is not None:
        before = list(zip(earlier.lower.tolist(), earlier.upper.tolist(), strict=True))
        left_out = [label for label, row in zip(labels, each, strict=True) if row is None]
        by_default = tuple(label for label in earlier.by_default if label in left_out)
    merged = [old if new is None else new for old, new in zip(before, each, strict=True)]
    lower, upper = (read_only(side) for side in np.transpose(merged))
    return Limit(
        definition,
        lower,
        upper,
        labels,
        f"{document.label}: {key_path(key)}",
        document.file,
        document.line(key),
        by_default,
    )


def row_labels(definition: LimitDefinition) -> tuple[str, ...]:
    """Name the rows of a limit: components, struts (from 1), pairs of struts, or nothing."""
    if definition.components:
        return definition.components
    if definition.per_actuator:
        return numbered("strut ")
    if definition.pairs:
        return tuple(f"struts {i + 1}-{j + 1}" for i, j in _PAIRS)
    return ("",)


def _components(definition: LimitDefinition, value: object) -> dict[str, Bounds]:
    names = definition.components
    pair = f"[min, max] in {definition.unit}"
    allowed = f"a mapping of {', '.join(names)} to {pair}"
    if definition.about_home is not None:
        allowed += f"; {LIFTED} in place of a pair, or of all"
        if value == LIFTED:
            return dict.fromkeys(names, _ENDLESS)
    if not isinstance(value, dict) or not value:
        raise refusal(f"{shown(value)} bounds no component", allowed)
    bounds = {}
    for name, item in value.items():
        if name not in names:
            raise refusal(
                f"unknown component {shown(name)}", allowed, partial(nearest, name, names)
            )
        if definition.about_home is not None and item == LIFTED:
            bounds[name] = _ENDLESS
            continue
        if not isinstance(item, list | tuple) or len(item) != _ENDS:
            raise refusal(f"{name}: {shown(item)} is not a pair", allowed)
        bounds[name] = _interval(definition, item, f"{name}: ")
    return bounds


def _rows(definition: LimitDefinition, value: object) -> tuple[Bounds, ...]:
    """Read one entry for all rows, or, for a limit per actuator, six."""
    if value == LIFTED and definition.standing is not None:
        raise refusal(f"the limit on the {definition.title} is never lifted", _allowed(definition))
    items = list(value) if isinstance(value, list | tuple) else [value]
    nested = any(isinstance(item, list | tuple) for item in items)
    if definition.per_actuator and len(items) == ACTUATORS:
        return tuple(_row(definition, item, f"strut {j}: ") for j, item in enumerate(items, 1))
    if isinstance(value, list | tuple) and (nested or len(items) != _ENDS):
        raise refusal(f"there are {len(items)} entries", _allowed(definition))
    return (_row(definition, value, ""),)


def _row(definition: LimitDefinition, value: object, where: str) -> Bounds:
    kind = definition.kind
    if isinstance(value, list | tuple):
        if len(value) != _ENDS or kind not in ("interval", "symmetric"):
            raise refusal(f"{where}{shown(value)} does not fit", _allowed(definition))
        return _interval(definition, value, where)
    if kind == "interval":
        raise refusal(f"{where}{shown(value)} is not a pair", _allowed(definition))
    bound = _number(definition, value, where)
    if bound < 0 or (bound == 0 and kind != "lower"):
        raise refusal(f"{where}the bound {_as_given(value)} is not positive", _allowed(definition))
    if kind == "symmetric":
        _require_usable(definition, (-bound, bound), where)
        return -bound, bound
    if kind == "upper" and definition.unit == "rad" and bound > np.pi:
        raise refusal(f"{where}{shown(value)} is no angle between directions", "at most 180 deg")
    bounds = (-np.inf, bound) if kind == "upper" else (bound, np.inf)
    _require_usable(definition, bounds, where)
    return bounds


def _interval(definition: LimitDefinition, value: Sequence[object], where: str) -> Bounds:
    low, high = (_number(definition, end, where) for end in value)
    if low >= high:
        message = f"{where}min {_as_given(value[0])} is not below max {_as_given(value[1])}"
        raise refusal(message, f"[min, max] in {definition.unit} with min < max")
    _require_usable(definition, (low, high), where)
    return low, high


def _as_given(value: object) -> str:
    """Return a number or a quantity as the user wrote it: in the user's unit."""
    return shown(value.strip()).strip("'") if isinstance(value, str) else shown(value)


def _number(definition: LimitDefinition, value: object, where: str) -> float:
    try:
        return dimension_of(definition.unit).parse(value)
    except PydanticCustomError as error:
        context = error.context or {}
        raise refusal(f"{where}{error.message()}", context["allowed"]) from None


def _require_usable(definition: LimitDefinition, bounds: Bounds, where: str) -> None:
    """Refuse bounds beyond the range in which the limit's transform is monotone (β of 90°)."""
    finite = [bound for bound in bounds if np.isfinite(bound)]
    if definition.widest is not None and max(map(abs, finite)) > definition.widest:
        most = quantity_text(max(map(abs, finite)), definition.unit)
        message = f"{where}{definition.title} cannot go so far as {most}"
        raise refusal(message, _allowed(definition))
    probes = np.linspace(min(finite), max(finite), _PROBES if len(finite) == _ENDS else 1)
    with np.errstate(all="ignore"):
        steps = np.diff(definition.transform(probes))
        usable = bool(np.all(np.isfinite(definition.transform(probes))))
    if definition.decreasing:
        steps = -steps
    if not usable or np.any(steps <= 0):
        message = f"{where}{definition.title} cannot be bounded so widely"
        raise refusal(message, "bounds within the quantity's unique range")


def _allowed(definition: LimitDefinition) -> str:
    unit = "" if definition.unit == "1" else f" in {definition.unit}"
    one = {
        "interval": f"[min, max]{unit}",
        "symmetric": f"one value{unit}, or [min, max]",
        "upper": f"one value{unit}, an upper bound",
        "lower": f"one value{unit}, a lower bound",
    }[definition.kind]
    if definition.widest is not None:
        one += f", {quantity_text(definition.widest, definition.unit)} at most"
    return f"{one}; or six of these, one per strut" if definition.per_actuator else one


RESERVE = "reserve"
"""Key beside the limits."""
LEAST_REFUSED = 0.5
"""A reserve of this share leaves nothing between two bounds."""
_ALLOWED = 'a share of at least 0 and below 0.5, such as "3 %"'


@dataclass(frozen=True)
class Reserve:
    """Shares of the limits' ranges that are kept free."""

    every: float = 0.0
    """Of the limits that are not in `own`."""
    own: Mapping[str, float] = field(default_factory=dict)
    """By the limit's key."""

    def of(self, key: str) -> float:
        """Return the share of one limit."""
        return self.own.get(key, self.every)

    def drawn_in(self, limits: Mapping[str, Limit]) -> dict[str, Limit]:
        """Return limits with their bounds drawn in."""
        return {key: limit.with_reserve(self.of(key)) for key, limit in limits.items()}

    def as_written(self, keys: Iterable[str]) -> dict[str, Any]:
        """Return what can stand under ``limits:`` for limits of these keys; empty without any."""
        if not self.own:
            return {RESERVE: self.every} if self.every else {}
        shares = {key: self.of(key) for key in keys if self.of(key)}
        return {RESERVE: shares} if shares else {}

    def warnings(self, keys: Iterable[str]) -> list[str]:
        """Return in words which shares keep nothing free: those of limits that are not set."""
        known, definitions = set(keys), limit_definitions()
        unset = [
            key
            for key, share in self.own.items()
            if share and key not in known and definitions[key].standing is None
        ]
        return [
            f"limits.{RESERVE}.{key} keeps nothing free: there is no limit {key}" for key in unset
        ]


def read_reserve(value: object) -> Reserve:
    """Return what stands at `limits.reserve`: one share for all limits, or a share by key."""
    if not isinstance(value, dict):
        return Reserve(_share(value))
    valid, own = list(limit_definitions()), {}
    for key, item in value.items():
        if key not in valid:
            message = f"{shown(key)} is no limit"
            raise refusal(message, ", ".join(valid), partial(nearest, key, valid), key)
        own[key] = _share(item, key)
    return Reserve(own=own)


def merged_reserve(sources: Sequence[Placed[Mapping[str, Any]]]) -> Reserve:
    """Merge the reserves of robot and run.

    Of later sources a share for all limits takes the place of all before, a share by key that of
    its limit alone.
    """
    found = Reserve()
    for source in sources:
        if RESERVE in source.value:
            given = source.value[RESERVE]
            read = read_reserve(given)
            by_key = isinstance(given, dict)
            found = Reserve(found.every, {**found.own, **read.own}) if by_key else read
    return found


def _share(value: object, key: str = "") -> float:
    try:
        share = SHARE.parse(value)
    except ValueError as error:
        message = f"{shown(value)} is no share of a range"
        raise refusal(message, _ALLOWED, key=key) from error
    if not 0 <= share < LEAST_REFUSED:
        given = value.strip() if isinstance(value, str) else shown(value)
        raise refusal(f"a reserve of {given} cannot be kept free", _ALLOWED, key=key)
    return share
