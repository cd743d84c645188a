"""Whether some bodies have the parameters of a robot file, to the digits that are written there."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import lru_cache

import numpy as np
from pydantic_core import PydanticCustomError

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration.document import Document
from expdesign.configuration.errors import Key
from expdesign.configuration.parameters import Drive, parsed_parameter
from expdesign.configuration.quantity import quantity_text
from expdesign.mechanism.nearest import NoBodiesError, Projection
from expdesign.mechanism.realisable import Realisable
from expdesign.mechanism.term import Term, parameters_of, scales_of
from expdesign.mechanism.terms import drive_inertia, rigid_platform

_AS_WRITTEN = 1e-9
"""Share of the scales that a file which was written with fewer digits may be off bodies."""
_TOLD, _TOLD_CHANGE = 4, 1e-4
"""How many of the nearest parameters are told, and from which change on."""
_TOLD_ROUNDING = 1e-2
"""The same, as a share of the rounding, where no more was needed."""
_MANY = 100
"""Times the rounding of a digit, from which on nobody asks whether it explains anything."""
_HALF_UP = 1 + 1e-3
"""A number in the middle of two may have been rounded to either."""
_MANTISSA = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)(.*)", re.DOTALL)


@dataclass(frozen=True)
class PhysicalConsistency:
    """What is to be said of the parameters of a robot file."""

    warnings: tuple[str, ...] = ()
    """What no bodies have, in words."""
    rounded: str = ""
    """Why bodies have the parameters that were rounded to those written; empty where bodies have
    these themselves, or neither."""


def roundings(document: Document, key: Key, values: Mapping[str, float]) -> dict[str, float]:
    """Return half a unit of the last digit of every parameter that stands at a key, SI.

    Nothing of those of which it is not known: that a program handed over, or that follow from
    bodies. What is written without decimal places is taken as meant so, and a zero, too.
    """
    found = {}
    for name, value in values.items():
        match = _MANTISSA.fullmatch(document.texts.get((*key, name), ""))
        if match is None or not value or "." not in match[1]:
            continue
        last = Decimal(1).scaleb(-len(match[1].partition(".")[2]))
        try:
            if parsed_parameter(name, match[0]) == value:
                found[name] = parsed_parameter(name, f"{last:f}{match[2]}") / 2
        except PydanticCustomError:
            continue
    return found


def physical_consistency(
    terms: tuple[Term, ...],
    values: Mapping[str, float],
    rounding: Mapping[str, float],
    platform_joints: Array,
    length: float,
    gravity: float,
) -> PhysicalConsistency:
    """Return in words what no real bodies have: published tables and estimates have it.

    Parameters
    ----------
    terms : tuple of Term
    values : mapping
        Nominal parameters, SI.
    rounding : mapping
        What rounding may have moved them by, as of `roundings`.
    platform_joints : (6, 3)
        Platform frame, m.
    length, gravity : float
        Characteristic length, m, and size of gravity, m/s².
    """
    found = []
    for parameter in parameters_of(terms):
        value = values[parameter.name]
        if value < parameter.lower or (parameter.strict and value == parameter.lower):
            bound = "not positive" if parameter.strict else "negative"
            found.append(f"{parameter.name} = {value:g} is {bound}")
        if value > parameter.upper:
            found.append(f"{parameter.name} = {value:g} is above {parameter.upper:g}")
    found += [text for term in terms for text in term.impossible(values)]
    joints = tuple(map(tuple, platform_joints.tolist()))
    given = (tuple(values.items()), tuple(rounding.items()))
    with np.errstate(all="ignore"):
        nearest, rounded = _nearest_bodies(terms, *given, joints, length, gravity)
    if rounded:
        return PhysicalConsistency(rounded=rounded)
    if nearest:
        found = [*found[:-1], ". ".join([*found[-1:], nearest])]
    return PhysicalConsistency(tuple(f"physically inconsistent parameters: {t}" for t in found))


@lru_cache(maxsize=32)
def _nearest_bodies(
    terms: tuple[Term, ...],
    given: tuple[tuple[str, float], ...],
    rounding: tuple[tuple[str, float], ...],
    joints: tuple[tuple[float, ...], ...],
    length: float,
    gravity: float,
) -> tuple[str, str]:
    """Say which parameters are the nearest that some bodies have, each measured by its size.

    In its place, where bodies have what is written as far as rounding leaves it open, say that.
    """
    parameters, known, half = parameters_of(terms), dict(given), dict(rounding)
    names = [parameter.name for parameter in parameters]
    values = np.array([known[name] for name in names])
    mass = known.get(rigid_platform.MASS, 0.0)
    scales = scales_of(parameters, values, mass, length, gravity)
    among = Realisable.of(parameters, scales, np.array(joints))
    if among.bodies(values, _AS_WRITTEN) is not None:
        return "", ""
    reach = _HALF_UP * np.array([half.get(name, 0.0) for name in names])
    within = _within(among, values, reach)
    near = within
    if near is None:
        try:
            near = Projection(among, np.diag(scales), np.full(len(names), True)).of(values).values
        except NoBodiesError:
            return "", ""  # too large to be judged, which is told of the bodies themselves
    share = (near - values) / scales
    least = _TOLD_ROUNDING * reach / scales
    if within is None:
        least = np.maximum(least, _TOLD_CHANGE)
    moved = [k for k in np.argsort(-np.abs(share)) if (abs(share) > least)[k]]
    told = []
    for k in moved[:_TOLD]:
        change = near[k] - values[k]
        text = f"{names[k]} = {near[k]:.6g} ({change:+.2g} {parameters[k].unit}"
        if within is None:
            text += f", {100 * share[k]:+.2g} %"
            if abs(change) < _MANY * reach[k]:
                text += f", {abs(change) / reach[k]:.2g} times the rounding of its last digit"
        told.append(f"{text})")
    listed = ", ".join(told)
    if len(moved) > _TOLD:
        listed += f" and {len(moved) - _TOLD} others"
    if within is None:
        return (
            f"No bodies have all parameters; the nearest that some have: {listed or 'the same'}",
            "",
        )
    return "", (
        "the parameters are physically consistent within the rounding of their last digits: no "
        f"bodies have them as they are written, but some have {listed}"
    )


def _within(among: Realisable, values: Array, reach: Array) -> Array | None:
    """Return parameters of bodies that are nowhere off by more than a reach, (m,); None: none."""
    free = reach > _AS_WRITTEN * among.scales
    low, high = (np.where(free, values + side * reach, side * np.inf) for side in (-1, 1))
    box = replace(among, lower=np.maximum(among.lower, low), upper=np.minimum(among.upper, high))
    if not np.any(free) or np.any(box.lower > box.upper):
        return None
    try:
        return Projection(box, np.diag(reach)[:, free], free).of(values).values
    except NoBodiesError:
        return None


_TURN = 2 * np.pi
_SPEED = 50.0
"""No strut is as fast, m/s."""
_LENGTHS = 20.0
"""No limit in m is as wide, in lengths of the longest strut at home."""
_HEAVY = 1000.0
"""No motor weighs as much along its strut, in masses of the platform with all sliders."""


def unit_slips(
    limits: Mapping[str, Limit], drive: Drive, parameters: Mapping[str, float], longest: float
) -> list[str]:
    """Return in words what is probably in another unit.

    Parameters
    ----------
    parameters : mapping
        Nominal, SI.
    longest : float
        Of the struts at home, m.
    """
    bounds = {"rad": _TURN, "m": _LENGTHS * longest, "m/s": _SPEED}
    found = []
    for key, limit in limits.items():
        if limit.unit in bounds:
            found += [
                f"limits.{key}: {text}. A plain number is in {limit.unit}"
                for text in _too_wide(limit, bounds[limit.unit])
            ]
    return [*found, *_of_drive(drive, parameters, longest)]


def _too_wide(limit: Limit, most: float) -> Iterator[str]:
    """Yield the first bound of a limit that no machine has."""
    ends = np.stack([limit.lower, limit.upper], axis=1)
    for row, end in np.argwhere(np.isfinite(ends) & (np.abs(ends) > most)).tolist()[:1]:
        label = limit.labels[row] if len(set(ends[:, end])) > 1 else ""
        where = f"{label}, " if label else ""
        yield (
            f"{where}{quantity_text(ends[row, end], limit.unit, 4)} limits nothing, it is beyond "
            f"{quantity_text(most, limit.unit, 3)}"
        )


def _of_drive(drive: Drive, parameters: Mapping[str, float], longest: float) -> Iterator[str]:
    if drive.geared is None:
        return
    mass, moved = parameters[drive_inertia.MASS], parameters.get("p10", 0.0)
    if drive.screw is not None and drive.screw.lead > longest:
        yield (
            f"drive.screw.lead: {quantity_text(drive.screw.lead, 'm', 4)} in one turn is more than "
            "the whole strut. A plain number is in m"
        )
    elif moved > 0 and mass > _HEAVY * moved:
        yield (
            f"the drive makes {drive_inertia.MASS} = {mass:.4g} kg along each strut, "
            f"{mass / moved:.0f} times what moves (p10 = {moved:.4g} kg): are inertia and lead in "
            "their units? A plain inertia is in kg m^2, data sheets mostly have kg cm^2"
        )
    if mass == 0:
        yield (
            "the drive has no inertia: without `inertia` beside its lead, or the parameter "
            f"{drive_inertia.MASS}, the forces of a design are too small. A motor behind a screw "
            "is often heavier along a strut than the platform"
        )
