"""Plausibility of a robot file: physical consistency of the parameters, and likely unit errors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from functools import lru_cache

import numpy as np
from pydantic_core import PydanticCustomError

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration.document import Document
from expdesign.configuration.errors import Key
from expdesign.configuration.parameters import Drive, parse_parameter
from expdesign.configuration.quantity import quantity_text
from expdesign.mechanism.nearest import NoBodiesError, Projection
from expdesign.mechanism.realisable import Realisable
from expdesign.mechanism.term import Term, parameters_of, scales_of
from expdesign.mechanism.terms import rigid_platform
from expdesign.mechanism.terms.actuator_forces import DRIVE_MASS

# --- physical consistency -------------------------------------------------------------------------

_NUMERICAL = 1e-9
"""Tolerated inconsistency of a file with few digits, as a share of the scales."""
_MOST_LISTED, _LEAST_CHANGE = 4, 1e-4
"""Most parameters in a list of changes, and the smallest listed change."""
_LEAST_ROUNDING = 1e-2
"""Smallest listed change within the rounding, as a share of the rounding."""
_FAR = 100
"""Smallest change, in multiples of the rounding, that the rounding does not explain."""
_HALF_UP = 1 + 1e-3
"""A number in the middle of two may have been rounded to either."""
_MANTISSA = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)(.*)", re.DOTALL)


def rounding_errors(document: Document, key: Key, values: Mapping[str, float]) -> dict[str, float]:
    """Return half a unit of the last digit of the parameters at a key, SI.

    The result has no entry for values from a program or from bodies, for zeros, and for numbers
    without decimal places, which count as exact.
    """
    found = {}
    for name, value in values.items():
        match = _MANTISSA.fullmatch(document.texts.get((*key, name), ""))
        if match is None or not value or "." not in match[1]:
            continue
        last = Decimal(1).scaleb(-len(match[1].partition(".")[2]))
        try:
            if parse_parameter(name, match[0]) == value:
                found[name] = parse_parameter(name, f"{last:f}{match[2]}") / 2
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
) -> tuple[list[str], str]:
    """Return inconsistencies of nominal parameters, SI, in words; published values may have some.

    If only unrounded parameters are consistent there are none, and the second text says so.

    `platform_joints` are (6, 3), platform frame, m; characteristic length in m, gravity in m/s².
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
        nearest, rounded = _nearest_consistent(terms, *given, joints, length, gravity)
    if rounded:
        return [], rounded
    if nearest:
        found = [*found[:-1], ". ".join([*found[-1:], nearest])]
    return [f"physically inconsistent parameters: {text}" for text in found], ""


@lru_cache(maxsize=32)
def _nearest_consistent(
    terms: tuple[Term, ...],
    given: tuple[tuple[str, float], ...],
    rounding: tuple[tuple[str, float], ...],
    joints: tuple[tuple[float, ...], ...],
    length: float,
    gravity: float,
) -> tuple[str, str]:
    """Describe the nearest consistent parameters, or those within the rounding.

    Changes are measured by the parameters' scales. At most one of the two texts is filled.
    """
    parameters, known, half = parameters_of(terms), dict(given), dict(rounding)
    names = [parameter.name for parameter in parameters]
    values = np.array([known[name] for name in names])
    mass = known.get(rigid_platform.MASS, 0.0)
    scales = scales_of(parameters, values, mass, length, gravity)
    consistent = Realisable.of(parameters, scales, np.array(joints))
    if consistent.bodies(values, _NUMERICAL) is not None:
        return "", ""
    reach = _HALF_UP * np.array([half.get(name, 0.0) for name in names])
    within = _within_rounding(consistent, values, reach)
    near = within
    if near is None:
        try:
            everything = np.full(len(names), True)
            near = Projection(consistent, np.diag(scales), everything).of(values).values
        except NoBodiesError:
            return "", ""  # too large to be judged; the warnings about the bodies say so
    share = (near - values) / scales
    least = _LEAST_ROUNDING * reach / scales
    if within is None:
        least = np.maximum(least, _LEAST_CHANGE)
    changed = [k for k in np.argsort(-np.abs(share)) if (abs(share) > least)[k]]
    texts = []
    for k in changed[:_MOST_LISTED]:
        change = near[k] - values[k]
        text = f"{names[k]} = {near[k]:.6g} ({change:+.2g} {parameters[k].unit}"
        if within is None:
            text += f", {100 * share[k]:+.2g} %"
            if abs(change) < _FAR * reach[k]:
                text += f", {abs(change) / reach[k]:.2g} times the rounding of its last digit"
        texts.append(f"{text})")
    listed = ", ".join(texts)
    if len(changed) > _MOST_LISTED:
        listed += f" and {len(changed) - _MOST_LISTED} others"
    if within is None:
        found = listed or "the same"
        return f"Together they are inconsistent; the nearest consistent parameters: {found}", ""
    return "", (
        "the parameters are physically consistent within the rounding of their last digits, "
        f"although not exactly: consistent values are {listed}"
    )


def _within_rounding(consistent: Realisable, values: Array, reach: Array) -> Array | None:
    """Return consistent parameters within a reach (m,) of the values, None without any."""
    free = reach > _NUMERICAL * consistent.scales
    low, high = (np.where(free, values + side * reach, side * np.inf) for side in (-1, 1))
    lower, upper = np.maximum(consistent.lower, low), np.minimum(consistent.upper, high)
    box = replace(consistent, lower=lower, upper=upper)
    if not np.any(free) or np.any(box.lower > box.upper):
        return None
    try:
        return Projection(box, np.diag(reach)[:, free], free).of(values).values
    except NoBodiesError:
        return None


# --- likely unit errors ---------------------------------------------------------------------------

_TURN = 2 * np.pi
FASTEST = 50.0
"""Above every strut's speed, m/s."""
_FARTHEST = 50.0
"""Above every distance of a joint or of the TCP from its origin, m."""
_LENGTHS = 20.0
"""Above every limit in m, in lengths of the longest strut at home."""
_HEAVY = 1000.0
"""Above every motor's mass along its strut, in masses of the platform with all sliders."""


def likely_unit_errors(
    limits: Mapping[str, Limit], drive: Drive, parameters: Mapping[str, float], longest: float
) -> list[str]:
    """Return warnings about valid numbers that are far from those of any machine.

    `longest` is the length of the longest strut at home, m.
    """
    bounds = {"rad": _TURN, "m": _LENGTHS * longest, "m/s": FASTEST}
    found = []
    for key, limit in limits.items():
        if limit.unit in bounds:
            found += [
                f"limits.{key}: {text}. A plain number is in {limit.unit}"
                for text in _wide_bounds(limit, bounds[limit.unit])
            ]
    return [*found, *_drive_errors(drive, parameters, longest)]


def far_points(places: Mapping[str, Array]) -> Iterator[str]:
    """Yield a warning for each key with points, (…, 3), m, farther away than on any machine."""
    for key, points in places.items():
        farthest = float(np.max(np.linalg.norm(np.atleast_2d(points), axis=1)))
        if farthest > _FARTHEST:
            yield (
                f"{key}: {quantity_text(farthest, 'm', 4)} from the origin is more than on any "
                f"machine ({quantity_text(_FARTHEST, 'm')}). A plain number is in m"
            )


def _wide_bounds(limit: Limit, most: float) -> Iterator[str]:
    """Yield the first bound of a limit beyond that of any machine."""
    ends = np.stack([limit.lower, limit.upper], axis=1)
    for row, end in np.argwhere(np.isfinite(ends) & (np.abs(ends) > most)).tolist()[:1]:
        label = limit.labels[row] if len(set(ends[:, end])) > 1 else ""
        where = f"{label}, " if label else ""
        yield (
            f"{where}{quantity_text(ends[row, end], limit.unit, 4)} limits nothing, it is beyond "
            f"{quantity_text(most, limit.unit, 3)}"
        )


def _drive_errors(drive: Drive, parameters: Mapping[str, float], longest: float) -> Iterator[str]:
    if drive.geared is None:
        return
    mass, moved = parameters[DRIVE_MASS], parameters.get("p10", 0.0)
    if drive.screw is not None and drive.screw.lead > longest:
        yield (
            f"drive.screw.lead: {quantity_text(drive.screw.lead, 'm', 4)} in one turn is more than "
            "the whole strut. A plain number is in m"
        )
    elif moved > 0 and mass > _HEAVY * moved:
        yield (
            f"the drive adds {DRIVE_MASS} = {mass:.4g} kg along each strut, "
            f"{mass / moved:.0f} times the moving mass (p10 = {moved:.4g} kg): are inertia and "
            "lead in their units? A plain inertia is in kg m^2, data sheets mostly have kg cm^2"
        )
    if mass == 0:
        yield (
            "the drive has no inertia: without an `inertia` next to its lead, or the parameter "
            f"{DRIVE_MASS}, the forces of a design are too small. A motor behind a screw "
            "often counts more along a strut than the platform"
        )
