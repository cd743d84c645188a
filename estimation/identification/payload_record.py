"""A payload as the run folder of its estimate keeps it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.estimators.payload import ABOUT_CENTRE, TEN, PayloadEstimate, about_centre
from estimation.uncertainty.intervals import interval_widths
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.runfolder import Numbers, OpenNumber, OpenNumbers, copied, described

_SURE = 3.0
"""Standard deviations that a mass has to be above zero, for its centre to be somewhere."""

_UNITS = tuple(parameter_unit(name) for name in OF_A_BODY.values())
_UNITS_ABOUT_CENTRE = ("m",) * 3 + _UNITS[4:]


@dataclass(frozen=True, eq=False, kw_only=True)
class PayloadKeys:
    """The ten parameters of a payload: mass, sx … sz, Ixx … Iyz about the TCP, platform frame."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    covariance: Annotated[
        Numbers,
        described("SI", "10 × 10, of the new recordings and of the identification before"),
    ]
    covariance_systematic: Annotated[
        Numbers, described("SI", "its share that the robot's tolerances make, 10 × 10")
    ]
    freedom: Annotated[
        OpenNumbers,
        described("1", "(10,) degrees of freedom behind the standard deviations; null: endless"),
    ]

    @classmethod
    def of(cls, payload: PayloadEstimate | None) -> Self | None:
        """Describe an estimate."""
        if payload is None:
            return None
        return copied(
            cls,
            payload,
            values=dict(zip(TEN, payload.values.tolist(), strict=True)),
            freedom=np.where(np.isinf(payload.freedom), np.nan, payload.freedom),
        )


@dataclass(frozen=True)
class PayloadRow:
    """One number of a payload by one estimator."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    quantity: Annotated[
        str,
        described(
            "",
            "mass; sx, sy, sz: first moments; Ixx … Iyz: inertia about the TCP; cx, cy, cz: centre "
            "of mass; Ixx_centre … Iyz_centre: inertia about it; all in the platform frame, "
            "products as matrix entries",
        ),
    ]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    value: Annotated[
        OpenNumber,
        described("see unit", "estimate; no centre is given of a mass that may be zero"),
    ]
    std: Annotated[
        OpenNumber,
        described("see unit", "standard deviation, of the identification before counted in"),
    ]
    std_random: Annotated[
        OpenNumber, described("see unit", "share of std that noise makes, now and before")
    ]
    std_systematic: Annotated[
        OpenNumber, described("see unit", "share of std that the robot's tolerances make")
    ]
    ci_low: Annotated[OpenNumber, described("see unit", "lower end of the 95 % interval")]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end of the 95 % interval")]


def payload_rows(estimator: str, keys: PayloadKeys) -> Iterator[PayloadRow]:
    """Yield the ten parameters, then centre and inertia about it by the delta method."""
    values = np.array([keys.values[name] for name in TEN])
    covariance, systematic = keys.covariance, keys.covariance_systematic
    widths = interval_widths(np.where(np.isnan(keys.freedom), np.inf, keys.freedom))
    yield from _rows(estimator, TEN, _UNITS, values, (covariance, systematic), widths)
    if values[0] > _SURE * np.sqrt(covariance[0, 0]):
        derived, slope = about_centre(values)
        shares = slope @ covariance @ slope.T, slope @ systematic @ slope.T
    else:
        derived = np.full(len(ABOUT_CENTRE), np.nan)
        shares = (np.full((len(derived),) * 2, np.nan),) * 2
    # Of what is made of several parameters there is as much behind as behind the least known.
    least = np.full(len(derived), np.max(widths))
    yield from _rows(estimator, ABOUT_CENTRE, _UNITS_ABOUT_CENTRE, derived, shares, least)


def _rows(
    estimator: str,
    names: tuple[str, ...],
    units: tuple[str, ...],
    values: Array,
    shares: tuple[Array, Array],
    widths: Array,
) -> Iterator[PayloadRow]:
    total, systematic = (np.diag(share) for share in shares)
    std = np.sqrt(total)
    columns = (
        values,
        std,
        np.sqrt(np.maximum(total - systematic, 0.0)),
        np.sqrt(np.maximum(systematic, 0.0)),
        values - widths * std,
        values + widths * std,
    )
    for name, unit, *numbers in zip(names, units, *(c.tolist() for c in columns), strict=True):
        yield PayloadRow(estimator, name, unit, *numbers)
