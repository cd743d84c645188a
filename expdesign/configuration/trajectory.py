"""`trajectory:`, the finite Fourier series and its sampling."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal
from expdesign.configuration.quantity import Duration, Frequency, Positive
from expdesign.configuration.scalars import Ascending, Pair, whole

_LARGEST_HARMONICS = 100
_LARGEST_SAMPLES = 100_000


class TrajectorySection(Section):
    """The family of periodic motions among which the design chooses.

    Attributes
    ----------
    harmonics : int
        Number n of harmonics in each of the six coordinates.
    frequency : (2,)
        Smallest and largest fundamental frequency, Hz; equal values fix it.
    samples : int
        Samples per period that the information is counted over; at least 4 n + 2.
    controller_period : float
        Step of the machine's controller, s, of which the period becomes a whole number.
        None until the configuration is resolved: then one over the experiment's sampling.
    """

    harmonics: Annotated[int, whole(1, _LARGEST_HARMONICS)] = 5
    frequency: Annotated[
        tuple[Annotated[Frequency, Positive], Annotated[Frequency, Positive]], Pair, Ascending
    ] = (0.1, 0.6)
    samples: Annotated[int, whole(6, _LARGEST_SAMPLES)] = 200
    controller_period: Annotated[Duration, Positive] | None = None

    @model_validator(mode="after")
    def _samples_resolve_the_harmonics(self) -> TrajectorySection:
        needed = 4 * self.harmonics + 2
        if self.samples < needed:
            raise refusal(
                f"{self.samples} samples are too few for {self.harmonics} harmonics",
                f"samples ≥ 4 · harmonics + 2 = {needed}",
                key="samples",
            )
        return self

    @model_validator(mode="after")
    def _controller_is_faster(self) -> TrajectorySection:
        shortest = 1 / self.frequency[1]
        if self.controller_period is not None and self.controller_period > shortest / 2:
            raise refusal(
                f"a controller period of {self.controller_period:g} s is too long for motions "
                f"of {shortest:g} s",
                f"controller_period ≤ {shortest / 2:g} s",
                key="controller_period",
            )
        return self
