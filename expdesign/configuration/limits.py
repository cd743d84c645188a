"""`limits:` of robot and run: bounds per row, defaults, and the reserve that motions keep free.

The definition of a limit in `constraints.limits` decides on the accepted values.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic_core import PydanticCustomError

from constraints import Limit, LimitDefinition, limit_definitions
from constraints.arrays import Mask
from expdesign.configuration.document import Located
from expdesign.configuration.errors import key_path, nearest_name, quote, refusal
from expdesign.configuration.quantity import SHARE, quantity_in, quantity_text
from expdesign.configuration.schema import by_key, read_only
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES, actuator_names

CHARACTERISTIC_LENGTH = "characteristic_length"
RESERVE = "reserve"
LIFTED = "none"
"""Value of a limit, or of a component, without its default bounds."""

Bounds = tuple[float, float]
_ENDLESS = (-np.inf, np.inf)
_ENDS = 2
_PAIRS = tuple(itertools.combinations(range(ACTUATORS), 2))


def _check_limit(name: str, value: object) -> object:
    """Refuse an invalid limit; keep a valid one in the user's notation until resolution."""
    readers = {CHARACTERISTIC_LENGTH: _read_length, RESERVE: _read_reserve}
    readers.get(name, partial(_read_limit, name))(value)
    return value


Limits = Annotated[dict[str, Any], by_key(_check_limit, "limits with their bounds")]
"""Limits in the user's notation."""


def resolve_limits(
    sources: Sequence[Located[Mapping[str, Any]]], defaults: Mapping[str, Limit] | None = None
) -> tuple[dict[str, Limit], float | None]:
    """Merge the limits of robot and run, without the reserve.

    Later sources override earlier ones, and these the defaults, by key and component. Return the
    limits in the order of the catalogue, without default limits that another limit implies, and the
    characteristic length, m, None when no source gives it.
    """
    given = dict(defaults or {})
    length: float | None = None
    for source in sources:
        for name, value in source.value.items():
            if name == CHARACTERISTIC_LENGTH:
                length = _read_length(value)
            elif name != RESERVE:
                given[name] = _override(given.get(name), source, *_read_limit(name, value))
    kept = {name: given[name] for name in limit_definitions() if name in given}
    kept = {name: limit for name, limit in kept.items() if not np.all(limit.open_rows)}
    implied = {
        name
        for name, limit in kept.items()
        if limit.is_default and limit.definition.held_by(kept) is not None
    }
    return {name: limit for name, limit in kept.items() if name not in implied}, length


def _override(
    earlier: Limit | None,
    source: Located[Any],
    definition: LimitDefinition,
    rows: tuple[Bounds | None, ...],
) -> Limit:
    """Return a limit of a source, with the earlier bounds of rows that it does not mention."""
    labels, document, key = row_labels(definition), source.document, (*source.key, definition.key)
    each = rows * len(labels) if len(rows) == 1 else rows
    before = [_ENDLESS] * len(labels)
    by_default: tuple[str, ...] = ()
    if earlier is not None:
        before = list(zip(earlier.lower.tolist(), earlier.upper.tolist(), strict=True))
        omitted = [label for label, row in zip(labels, each, strict=True) if row is None]
        by_default = tuple(label for label in earlier.by_default if label in omitted)
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


def default_limits(home: Sequence[float]) -> dict[str, Limit]:
    """Return the limits that apply unless a source gives others; home pose (6,), m and rad."""
    found = {}
    for key, definition in limit_definitions().items():
        about_home, standing = definition.about_home, definition.standing
        labels = row_labels(definition)
        if about_home is not None:
            width, place = about_home, " from home"
            middle = np.array([home[COORDINATE_NAMES.index(name)] for name in labels])
        elif standing is not None:
            width, place, middle = standing, "", np.zeros(len(labels))
        else:
            continue
        lower, upper = read_only(middle - width), read_only(middle + width)
        origin = f"{quantity_text(width, definition.unit)}{place}, the default of limits.{key}"
        found[key] = Limit(definition, lower, upper, labels, origin, by_default=labels)
    return found


def row_labels(definition: LimitDefinition) -> tuple[str, ...]:
    """Return names for the rows of a limit: components, struts or pairs of struts, from one."""
    if definition.components:
        return definition.components
    if definition.per_actuator:
        return actuator_names("strut ")
    if definition.pairs:
        return tuple(f"struts {i + 1}-{j + 1}" for i, j in _PAIRS)
    return ("",)


def shared_rows(definition: LimitDefinition, pairs: Iterable[tuple[int, int]]) -> Mask:
    """Return the rows of a limit that belong to pairs of struts, from zero, with a common joint."""
    if not definition.pairs:
        return np.zeros(len(row_labels(definition)), dtype=bool)
    return np.isin(np.arange(len(_PAIRS)), [_PAIRS.index(pair) for pair in pairs])


def with_shared_joints(limit: Limit, pairs: Iterable[tuple[int, int]]) -> Limit:
    """Return a limit without bounds on pairs of struts with a common joint: they have no gap."""
    shared = shared_rows(limit.definition, pairs)
    if not np.any(shared):
        return limit
    lower, upper = np.where(shared, -np.inf, limit.lower), np.where(shared, np.inf, limit.upper)
    return replace(limit, lower=read_only(lower), upper=read_only(upper))


def limits_as_written(
    limits: Mapping[str, Limit], length: float, reserve: Reserve = MappingProxyType({})
) -> dict[str, Any]:
    """Return resolved limits in the notation of ``limits:``, in SI units."""
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
    shares: Any = {key: share for key in limits if (share := reserve_of(reserve, key))}
    if set(reserve) == {EVERY}:
        shares = reserve[EVERY]
    return written | ({RESERVE: shares} if shares else {}) | {CHARACTERISTIC_LENGTH: length}


# --- values of one limit --------------------------------------------------------------------------

_PROBES = 65


def _read_length(value: object) -> float:
    length = quantity_in("m").parse(value)
    if length <= 0:
        raise refusal(f"{length:g} is not positive", "a length above 0")
    return length


def _read_limit(name: str, value: object) -> tuple[LimitDefinition, tuple[Bounds | None, ...]]:
    """Return the definition of a limit and the bounds of its rows, one for rows that are alike.

    A row without a value is None; a lifted row has infinite bounds.
    """
    definitions = limit_definitions()
    if name not in definitions:
        valid = [*definitions, CHARACTERISTIC_LENGTH, RESERVE]
        meant = partial(nearest_name, name, valid)
        raise refusal(f"unknown limit {quote(name)}", ", ".join(valid), meant)
    definition = definitions[name]
    if not definition.components:
        return definition, _read_rows(definition, value)
    given = _read_components(definition, value)
    return definition, tuple(given.get(label) for label in row_labels(definition))


def _read_components(definition: LimitDefinition, value: object) -> dict[str, Bounds]:
    names, lifts = definition.components, definition.about_home is not None
    allowed = f"a mapping of {', '.join(names)} to [min, max] in {definition.unit}"
    allowed += f"; {LIFTED} instead of a pair, or of all" if lifts else ""
    if lifts and value == LIFTED:
        return dict.fromkeys(names, _ENDLESS)
    if not isinstance(value, dict) or not value:
        raise refusal(f"{quote(value)} bounds no component", allowed)
    bounds = {}
    for name, item in value.items():
        if name not in names:
            meant = partial(nearest_name, name, names)
            raise refusal(f"unknown component {quote(name)}", allowed, meant)
        if lifts and item == LIFTED:
            bounds[name] = _ENDLESS
            continue
        if not isinstance(item, list | tuple) or len(item) != _ENDS:
            raise refusal(f"{name}: {quote(item)} is not a pair", allowed)
        bounds[name] = _read_interval(definition, item, f"{name}: ")
    return bounds


def _read_rows(definition: LimitDefinition, value: object) -> tuple[Bounds, ...]:
    """Read one entry for all rows, or six for a limit per actuator."""
    if value == LIFTED and definition.standing is not None:
        message = f"the limit on the {definition.title} cannot be lifted"
        raise refusal(message, _allowed(definition))
    items = list(value) if isinstance(value, list | tuple) else [value]
    nested = any(isinstance(item, list | tuple) for item in items)
    if definition.per_actuator and len(items) == ACTUATORS:
        return tuple(_read_row(definition, item, f"strut {j}: ") for j, item in enumerate(items, 1))
    if isinstance(value, list | tuple) and (nested or len(items) != _ENDS):
        raise refusal(f"there are {len(items)} entries", _allowed(definition))
    return (_read_row(definition, value, ""),)


def _read_row(definition: LimitDefinition, value: object, where: str) -> Bounds:
    kind = definition.kind
    if isinstance(value, list | tuple):
        if len(value) != _ENDS or kind not in ("interval", "symmetric"):
            raise refusal(f"{where}{quote(value)} does not fit", _allowed(definition))
        return _read_interval(definition, value, where)
    if kind == "interval":
        raise refusal(f"{where}{quote(value)} is not a pair", _allowed(definition))
    bound = _read_number(definition, value, where)
    if bound < 0 or (bound == 0 and kind != "lower"):
        message = f"{where}the bound {_in_user_notation(value)} is not positive"
        raise refusal(message, _allowed(definition))
    if kind == "upper" and definition.unit == "rad" and bound > np.pi:
        message = f"{where}{quote(value)} is larger than any angle between directions"
        raise refusal(message, "at most 180 deg")
    bounds = {"symmetric": (-bound, bound), "upper": (-np.inf, bound), "lower": (bound, np.inf)}
    _require_monotone(definition, bounds[kind], where)
    return bounds[kind]


def _read_interval(definition: LimitDefinition, value: Sequence[object], where: str) -> Bounds:
    low, high = (_read_number(definition, end, where) for end in value)
    if low >= high:
        ends = f"min {_in_user_notation(value[0])} is not below max {_in_user_notation(value[1])}"
        raise refusal(where + ends, f"[min, max] in {definition.unit} with min < max")
    _require_monotone(definition, (low, high), where)
    return low, high


def _read_number(definition: LimitDefinition, value: object, where: str) -> float:
    try:
        return quantity_in(definition.unit).parse(value)
    except PydanticCustomError as error:
        context = error.context or {}
        raise refusal(f"{where}{error.message()}", context["allowed"]) from None


def _in_user_notation(value: object) -> str:
    return quote(value.strip()).strip("'") if isinstance(value, str) else quote(value)


def _require_monotone(definition: LimitDefinition, bounds: Bounds, where: str) -> None:
    """Refuse bounds outside the monotone range of the limit's transform (β of 90°)."""
    finite = [bound for bound in bounds if np.isfinite(bound)]
    if definition.widest is not None and max(map(abs, finite)) > definition.widest:
        most = quantity_text(max(map(abs, finite)), definition.unit)
        message = f"{where}{definition.title} cannot go so far as {most}"
        raise refusal(message, _allowed(definition))
    # An upper bound is positive: it limits at least the values from zero on.
    first = max(finite) / _PROBES if definition.kind == "upper" else min(finite)
    probes = np.linspace(first, max(finite), _PROBES if first < max(finite) else 1)
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


# --- reserve --------------------------------------------------------------------------------------

Reserve = Mapping[str, float]
"""Shares of the limits' ranges by key, `EVERY` for all others.

They are kept free for tracking errors and deviations of the parameters: motions are planned and
judged with bounds that are drawn in by them.
"""
EVERY = ""
_LEAST_REFUSED = 0.5
"""A reserve of this share leaves no room between two bounds."""
_RESERVES = 'a share of at least 0 and below 0.5, such as "3 %"'


def merge_reserves(sources: Sequence[Located[Mapping[str, Any]]]) -> Reserve:
    """Merge the reserves of robot and run.

    A later share for all limits replaces all earlier ones, a share by key that of its limit alone.
    """
    found: Reserve = {}
    for source in sources:
        if RESERVE in source.value:
            read = _read_reserve(source.value[RESERVE])
            found = read if EVERY in read else {**found, **read}
    return found


def reserve_of(reserve: Reserve, key: str) -> float:
    """Return the share of one limit."""
    return reserve.get(key, reserve.get(EVERY, 0.0))


def reserve_warnings(reserve: Reserve, keys: Collection[str]) -> list[str]:
    """Return warnings about shares without an effect, since their limit is not among the keys."""
    definitions = limit_definitions()
    return [
        f"limits.{RESERVE}.{key} has no effect: there is no limit {key}"
        for key, share in reserve.items()
        if key != EVERY and share and key not in keys and definitions[key].standing is None
    ]


def _read_reserve(value: object) -> Reserve:
    """Return the reserve for a value of `limits.reserve`: one share, or a share by key."""
    if not isinstance(value, dict):
        return {EVERY: _read_share(value)}
    valid = list(limit_definitions())
    for key in value:
        if key not in valid:
            message = f"{quote(key)} is not a limit"
            raise refusal(message, ", ".join(valid), partial(nearest_name, key, valid), key)
    return {key: _read_share(item, key) for key, item in value.items()}


def _read_share(value: object, key: str = "") -> float:
    try:
        share = SHARE.parse(value)
    except ValueError as error:
        message = f"{quote(value)} is not a share of a range"
        raise refusal(message, _RESERVES, key=key) from error
    if not 0 <= share < _LEAST_REFUSED:
        message = f"a reserve of {_in_user_notation(value)} cannot be kept free"
        raise refusal(message, _RESERVES, key=key)
    return share


# --- limits in words ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class OpenRows:
    """Rows of a limit without any bound."""

    definition: LimitDefinition
    labels: tuple[str, ...]
    """Name of each row of the limit."""
    rows: NDArray[np.intp]
    """(k,), indices of the open rows."""

    def __str__(self) -> str:
        """Return the name of the limit, with its open components."""
        return named_rows(self.definition, [self.labels[row] for row in self.rows])


def open_rows(
    limits: Mapping[str, Limit], pairs: Iterable[tuple[int, int]]
) -> tuple[OpenRows, ...]:
    """Return the limits without bounds among those of a robot, in the order of the catalogue.

    `pairs` of struts with a common joint, and limits that always apply, do not count as open.
    """
    found, pairs = [], tuple(pairs)
    for key, definition in limit_definitions().items():
        if definition.standing is not None:
            continue
        labels = row_labels(definition)
        limit = limits.get(key) or Limit.boundless(definition, labels)
        rows = np.flatnonzero(limit.open_rows & ~shared_rows(definition, pairs))
        if rows.size:
            found.append(OpenRows(definition, labels, rows))
    return tuple(found)


def named_rows(definition: LimitDefinition, labels: Iterable[str]) -> str:
    """Return the name of a limit, with the given components."""
    return f"{definition.key} ({', '.join(labels)})" if definition.components else definition.key


def open_in_words(found: Iterable[OpenRows | str]) -> str:
    """Describe the limits that are not set, by their rows or names; empty if all are."""
    names = ", ".join(str(one) for one in found)
    return f"no limit is set on {names}" if names else ""


def defaults_in_words(limits: Mapping[str, Limit]) -> tuple[str, ...]:
    """Describe the default bounds in use."""
    found = []
    for limit in limits.values():
        about, standing = limit.definition.about_home, limit.definition.standing
        if limit.by_default and about is not None:
            found.append(
                f"limits.{limit.key} is not given for {', '.join(limit.by_default)}: "
                f"{quantity_text(about, limit.unit)} from home in both directions by default; "
                f"`{limit.key}: {LIFTED}` lifts it"
            )
        elif limit.by_default and standing is not None:
            found.append(
                f"limits.{limit.key} is not given: {quantity_text(standing, limit.unit)} in both "
                "directions; this default cannot be lifted"
            )
    return tuple(found)


def held_in_words(limits: Mapping[str, Limit]) -> tuple[str, ...]:
    """Describe the limits that always apply and are implied by another limit."""
    found = []
    for key, definition in limit_definitions().items():
        bound, other = definition.standing, definition.held_by(limits)
        if key not in limits and bound is not None and other is not None:
            found.append(
                f"{definition.title} stays within {quantity_text(bound, definition.unit)} either "
                f"way (limits.{key}): limits.{other} is tighter"
            )
    return tuple(found)


def reserve_in_words(limits: Mapping[str, Limit]) -> str:
    """Describe the shares of the limits' ranges that stay free; empty without a reserve."""
    by_share: dict[float, list[str]] = {}
    for limit in limits.values():
        by_share.setdefault(limit.reserve, []).append(limit.key)
    kept = {share: keys for share, keys in sorted(by_share.items()) if share}
    if not kept:
        return ""
    of = "; ".join(
        f"{100 * share:.4g} % of {'every limit' if len(by_share) == 1 else ', '.join(keys)}"
        for share, keys in kept.items()
    )
    return f"limits.reserve keeps free {of}: motions are planned and judged within the rest"
