"""`limits.reserve`: which share of each limit's range motions keep free, of robot and run.

Motions are planned and judged with bounds that are drawn in by it: what is left is for tracking
errors of the controller, and for parameters that are not the nominal ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from constraints import Limit, limit_definitions
from expdesign.configuration.document import Placed
from expdesign.configuration.problem import nearest, refusal, shown
from expdesign.configuration.values.quantity import SHARE

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
