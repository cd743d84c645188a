"""What can be identified where single parameters cannot: their best-known combinations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import model_serializer

from constraints.arrays import Array
from estimation.uncertainty.intervals import IDENTIFIED
from expdesign.robot import Robot
from expdesign.runfolder import described


@dataclass(frozen=True)
class Combination:
    """p_other + factor · p_weak, which the data know better than either."""

    weak: Annotated[str, described("", "the parameter that is not identified")]
    other: Annotated[str, described("", "the one that it is confounded with most")]
    factor: Annotated[float, described("SI", "in units of other per unit of weak")]
    value: Annotated[float, described("SI", "of the combination, in the unit of other")]
    std: Annotated[float, described("SI", "standard deviation of the combination")]
    correlation: Annotated[float, described("1", "of the two estimates")]
    identified: Annotated[
        bool, described("", "the combination is known to half the scale of the other parameter")
    ] = True

    @property
    def text(self) -> str:
        """In words."""
        sign = "+" if self.factor >= 0 else "−"
        sum_ = f"{self.other} {sign} {abs(self.factor):.4g}·{self.weak}"
        known = f"{self.value:.6g} ± {self.std:.2g}"
        if not self.identified:
            return f"{self.weak} is not identified, nor is it with {self.other}: {sum_} = {known}"
        return f"{self.weak} is not identified; {sum_} is: {known}"

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {**fields(self), "text": self.text}


def identified_combinations(
    robot: Robot, names: tuple[str, ...], values: Array, covariance: Array
) -> tuple[Combination, ...]:
    """Return, for every parameter that is not identified, the combination that is known best.

    The partner is the parameter whose estimate is correlated with it most; the factor is the one
    that makes the combination uncorrelated with the weak parameter, and its variance smallest.
    """
    scales = robot.scales
    std = np.sqrt(np.diag(covariance))
    found = []
    for k in np.flatnonzero(std >= IDENTIFIED * scales):
        ratio = np.zeros(len(names))
        known = std > 0
        ratio[known] = covariance[k, known] / (std[k] * std[known])
        ratio[k] = 0.0
        j = int(np.argmax(np.abs(ratio)))
        if ratio[j] == 0:
            continue  # no other parameter is free, or none has to do with it
        factor = -covariance[k, j] / covariance[k, k]
        variance = covariance[j, j] * (1 - ratio[j] ** 2)
        found.append(
            Combination(
                weak=names[k],
                other=names[j],
                factor=float(factor),
                value=float(values[j] + factor * values[k]),
                std=float(np.sqrt(max(variance, 0.0))),
                correlation=float(ratio[j]),
                identified=bool(variance < (IDENTIFIED * scales[j]) ** 2),
            )
        )
    return tuple(found)
