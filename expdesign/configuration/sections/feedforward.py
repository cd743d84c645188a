"""`feedforward:`: a motion under a position controller, with and without the model's forces."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.problem import refusal
from expdesign.configuration.sections.experiment import BenchmarkMotion
from expdesign.configuration.values.quantity import Frequency, NotNegative, Number, Positive
from expdesign.configuration.values.scalars import Sized, one_of

Followed = Literal["design", "circle", "line", "spline"]


class FeedforwardSection(BenchmarkMotion):
    """The motion that is followed, and the controller of every strut."""

    motion: Annotated[Followed, one_of(Followed)] = "circle"
    periods: Sized = 2
    """Number of periods that are simulated; the last one is judged."""
    bandwidth: Annotated[Frequency, Positive] = 10.0
    """Natural frequency of a strut under its controller, Hz."""
    damping: Annotated[Number, Positive] = 0.7
    """Damping ratio of the same."""
    integral: Annotated[Frequency, NotNegative] = 1.0
    """Corner frequency of the integral action, Hz; 0: none."""
    filter: Annotated[Frequency, Positive] = 100.0
    """Corner frequency of the filter behind the difference that stands for a speed, Hz."""

    @model_validator(mode="after")
    def _integral_is_slow(self) -> FeedforwardSection:
        # Routh: the roots of m s³ + d s² + k s + k ω_i decay while ω_i < d/m = 2 D ω. Struts that
        # move together may move up to twice the mass of one by itself.
        if self.integral >= self.damping * self.bandwidth:
            raise refusal(
                f"with an integral action of {self.integral:g} Hz the controller is unstable",
                f"less than damping times bandwidth, {self.damping * self.bandwidth:g} Hz; a "
                "tenth of the bandwidth is usual",
                key="integral",
            )
        return self

    @model_validator(mode="after")
    def _design_is_followed_as_it_is(self) -> FeedforwardSection:
        if self.motion == "design" and self.mirror != "none":
            raise refusal("the design is followed as it is", "mirror: none", key="mirror")
        return self
