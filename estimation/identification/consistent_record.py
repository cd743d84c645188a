"""The nearest parameters that bodies have, as the run folder of an estimate keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.uncertainty.consistency import ConsistentEstimate
from expdesign.information.identifiable import listed
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.robot import Robot
from expdesign.runfolder import Numbers, OpenNumber, OpenNumbers, copied, described

_RARE = 0.01
"""p value below which none is told: the test ends before it knows it."""
_FLOOR = 1e-3
"""Distance in σ below which none is told."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyKeys:
    """One body, in the frame of docs/model.md."""

    mass: Annotated[float, described("kg", "mass")]
    moment: Annotated[Numbers, described("kg m", "(3,) first moment about the frame's origin")]
    inertia: Annotated[
        Numbers, described("kg m^2", "3 × 3 about the frame's origin, products as matrix entries")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class ConsistentKeys:
    """The nearest parameters to an estimate that some set of bodies has."""

    values: Annotated[dict[str, float], described("SI", "by parameter")]
    moved: Annotated[
        OpenNumbers,
        described("1", "(m,) values less estimate in σ, of base parameters by their combinations"),
    ]
    exchanged: Annotated[
        tuple[str, ...],
        described("", "held parameters that took other values: no force shows which they have"),
    ]
    distance: Annotated[
        float, described("1", "from the estimate, standard deviations; 0: bodies have it")
    ]
    p: Annotated[
        float, described("1", "how often noise makes that distance where bodies have the truth")
    ]
    significant: Annotated[bool, described("", "p is below 5 %")]
    active: Annotated[tuple[str, ...], described("", "conditions and bounds that it stands at")]
    spread: Annotated[
        OpenNumbers,
        described("SI", "(m,) root mean square error by simulation; null: fixed"),
    ]
    low: Annotated[OpenNumbers, described("SI", "(m,) lower ends of the 95 % intervals")]
    high: Annotated[OpenNumbers, described("SI", "(m,) upper ends")]
    bodies: Annotated[
        dict[str, BodyKeys],
        described("", "ring, stator, slider and platform that have the values: one of many sets"),
    ]
    text: Annotated[str, described("", "in words")]

    @classmethod
    def of(cls, found: ConsistentEstimate | None, robot: Robot) -> Self | None:
        """Describe it."""
        if found is None:
            return None
        return copied(
            cls,
            found,
            values=dict(zip(robot.parameter_names, found.values.tolist(), strict=True)),
            bodies={name: copied(BodyKeys, body) for name, body in vars(found.bodies).items()},
            text=consistency_in_words(
                found, known=robot.realisable.bodies(robot.parameters) is not None
            ),
        )


def consistency_in_words(found: ConsistentEstimate, *, known: bool) -> str:
    """Say whether some bodies have an estimate, and what it means if not.

    `known` tells whether some have the values of the robot file.
    """
    if found.exchanged:
        told, others = "combinations", f", with other values of {listed(found.exchanged)}"
    else:
        told, others = "parameters", ""
    if found.realisable:
        return f"physically consistent: some set of bodies has these {told}{others}"
    near = max(found.distance, _FLOOR)
    said = (
        f"not physically consistent: the nearest {told} that some set of bodies has{others} are "
        f"{near:.2g} σ away, at the limit of {', '.join(found.active)}; "
    )
    share = f"{100 * found.p:.3g} % at most" if found.p > _RARE else f"less than {100 * _RARE:g} %"
    chance = f"noise alone makes such a distance in {share} of the cases"
    if found.significant:
        doubt = "a reason to look for what the model lacks, or for a larger tolerance or noise"
        if not known:
            doubt += (
                ". No bodies have the values of the robot file either: an estimate of a twin that "
                "has them is rightly found so"
            )
        return f"{said}{chance}: {doubt}"
    return f"{said}{chance}: no reason for doubt"


@dataclass(frozen=True)
class ConsistentRow:
    """One parameter of an estimate beside the nearest that bodies have."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of the numbers")]
    estimate: Annotated[float, described("see unit", "estimate, without constraints")]
    std: Annotated[
        OpenNumber, described("see unit", "its standard deviation; empty for a fixed parameter")
    ]
    consistent: Annotated[
        float, described("see unit", "of the nearest parameters that some set of bodies has")
    ]
    moved: Annotated[
        OpenNumber,
        described("1", "consistent less estimate in σ, of a base parameter its combination's"),
    ]
    ci_low: Annotated[
        OpenNumber, described("see unit", "lower end of the 95 % interval about consistent")
    ]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end")]
    spread: Annotated[
        OpenNumber,
        described("see unit", "root mean square error of consistent, by simulation from there"),
    ]


def consistent_rows(
    estimator: str,
    values: dict[str, float],
    covariance: Array,
    keys: ConsistentKeys,
) -> Iterator[ConsistentRow]:
    """Yield the rows of all parameters; `covariance`, (m, m), is that of the estimate."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0, std, np.nan).tolist()
    for k, (name, value) in enumerate(values.items()):
        yield ConsistentRow(
            estimator=estimator,
            parameter=name,
            unit=parameter_unit(name),
            estimate=value,
            std=std[k],
            consistent=keys.values[name],
            moved=float(keys.moved[k]),
            ci_low=float(keys.low[k]),
            ci_high=float(keys.high[k]),
            spread=float(keys.spread[k]),
        )
