"""`trajectory:` and `motion:`, the periodic motions to choose from, and the way in and out."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import Ascending, Pair
from expdesign.configuration.values.quantity import Duration, Frequency, Jerk, Positive
from expdesign.configuration.values.scalars import Count, one_of, whole

_LARGEST_HARMONICS = 100

Phase = Literal["start", "best"]


class TrajectorySection(Section):
    """The family of finite Fourier series among which the design chooses."""

    harmonics: Annotated[int, whole(1, _LARGEST_HARMONICS)] = 5
    """Number n of harmonics in each of the coordinates."""
    frequency: Annotated[
        tuple[Annotated[Frequency, Positive], Annotated[Frequency, Positive]], Pair, Ascending
    ] = (0.1, 0.6)
    """Smallest and largest fundamental frequency, Hz; equal values fix it."""
    samples: Count = 200
    """Samples per period that the information is counted over; at least 4 n + 2."""
    controller_period: Annotated[Duration, Positive] | None = None
    """Step of the machine's controller, s, of which the period becomes a whole number.
    None until the run is resolved: then one over the experiment's sampling."""

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


class MotionSection(Section):
    """How the machine gets from rest at home into the periods, and back."""

    jerk: Annotated[Jerk, Positive] | None = None
    """Largest jerk of a strut, m/s³. None: it follows from the limit of the struts' acceleration
    and from the designed motion (`expdesign.motion.limits`)."""
    phase: Annotated[Phase, one_of(Phase)] = "start"
    """Where on its orbit the designed motion is entered and left: at its t = 0, or where the
    ramps are shortest."""
