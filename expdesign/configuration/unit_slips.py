"""Numbers of a robot file that are probably in another unit: legal, and far from any machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from constraints import Limit
from expdesign.configuration.drive import Drive
from expdesign.configuration.values.quantity import quantity_text
from expdesign.mechanism.terms import drive_inertia

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
