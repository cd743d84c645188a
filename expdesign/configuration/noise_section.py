"""Covariance of the measured forces and strut lengths, as the YAML states it."""

from __future__ import annotations

from typing import Annotated

from expdesign.configuration.base import Section
from expdesign.configuration.quantity import (
    Force,
    ForceVariance,
    Length,
    LengthVariance,
    Number,
    Positive,
)
from expdesign.configuration.scalars import exactly

_SIX = exactly(6, "values")
_ROWS = exactly(6, "rows")

Correlation = Annotated[tuple[Annotated[tuple[Number, ...], _SIX], ...], _ROWS]


class NoiseDescription(Section):
    """Noise of one sample of the six actuators.

    A standard deviation with an optional correlation (default: none), or a covariance.
    Whether they go together is judged after robot and run are merged.
    """

    force_std: Annotated[tuple[Annotated[Force, Positive], ...], _SIX] | None = None
    force_correlation: Correlation | None = None
    force_covariance: (
        Annotated[tuple[Annotated[tuple[ForceVariance, ...], _SIX], ...], _ROWS] | None
    ) = None
    length_std: Annotated[tuple[Annotated[Length, Positive], ...], _SIX] | None = None
    length_correlation: Correlation | None = None
    length_covariance: (
        Annotated[tuple[Annotated[tuple[LengthVariance, ...], _SIX], ...], _ROWS] | None
    ) = None
