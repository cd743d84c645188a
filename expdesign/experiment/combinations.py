"""The combinations of parameters that an experiment identifies, as rows of tables.

A direction of the parameters, each in units of its scale, counts when its standard deviation is
below half: as many of them as count are base parameters, and the others regroup into these
(`expdesign.information.identifiable`). Where all count, the combinations are the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.information.identifiable import IDENTIFIABLE, BaseParameters
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder import OpenNumber, described

_TOGETHER = 0.9
"""Ratio of standard deviations, combination to parameter, from which on the other parameters in a
combination hardly matter."""


@dataclass(frozen=True)
class KnownCombination:
    """An identified combination of parameters."""

    combination: Annotated[str, described("", "sum of parameters, such as p5 + 0.98 p4")]
    parameter: Annotated[str, described("", "the one that has the coefficient one, its base")]
    unit: Annotated[str, described("", "SI unit of that parameter, of value and std")]
    value: Annotated[OpenNumber, described("see unit", "of the combination")]
    std: Annotated[OpenNumber, described("see unit", "standard deviation of the combination")]
    std_alone: Annotated[
        OpenNumber,
        described(
            "see unit", "of that parameter alone; empty if no motion distinguishes it from others"
        ),
    ]
    rel_std_percent: Annotated[
        OpenNumber, described("%", "std over the scale of the parameter that is its base")
    ]
    regrouped: Annotated[str, described("", "the other parameters in it; empty: none")]
    identified: Annotated[bool, described("", "std below half of that scale")]

    @property
    def together(self) -> bool:
        """Whether it is clearly better determined than its base parameter alone."""
        return bool(self.regrouped) and not self.std > _TOGETHER * self.std_alone


def identified_base(root: Array, names: tuple[str, ...], scales: Array) -> BaseParameters:
    """Return the base parameters that an experiment identifies.

    Parameters
    ----------
    root : (r, m)
        W with WᵀW the information of the whole experiment, SI.
    names : (m,) of str
    scales : (m,)
        Scale of each parameter, SI.
    """
    return BaseParameters.of(root, names, scales=IDENTIFIABLE * scales)


def known_combinations(
    base: BaseParameters,
    structure: BaseParameters,
    values: Array,
    covariance: Array,
    scales: Mapping[str, float],
) -> tuple[KnownCombination, ...]:
    """Return value and standard deviation of combinations.

    Parameters
    ----------
    base : BaseParameters
        The identified ones of the base parameters of `structure`.
    structure : BaseParameters
    values, covariance : (m,), (m, m)
        Of the parameters of `structure`, SI; zero covariance of those that regroup there.
    scales : mapping
        By parameter, SI.
    """
    base = base.after(structure)
    alone = np.sqrt(np.diag(covariance))
    found = base.values(values)
    spread = np.sqrt(np.maximum(np.diag(base.matrix @ covariance @ base.matrix.T), 0.0))
    rows = []
    for name, value, std in zip(base.base, found.tolist(), spread.tolist(), strict=True):
        share = std / scales[name]
        inseparable = name in structure.combined
        rows.append(
            KnownCombination(
                combination=base.text(name),
                parameter=name,
                unit=parameter_unit(name),
                value=value,
                std=std,
                std_alone=np.nan if inseparable else float(alone[base.names.index(name)]),
                rel_std_percent=100 * share,
                regrouped=", ".join(base.members(name)),
                identified=bool(share < IDENTIFIABLE),
            )
        )
    return tuple(rows)
