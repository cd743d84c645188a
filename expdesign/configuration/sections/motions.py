"""`validate:` and `feedforward:`: benchmark motions for predicted forces and for control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, PlainSerializer, model_validator

from expdesign.configuration.errors import refusal, shown
from expdesign.configuration.fields import Direction, FilledText, Pose, Sized, at_least, one_of
from expdesign.configuration.quantity import (
    FORCE,
    SHARE,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
    Speed,
)
from expdesign.configuration.section import LATER, Section

_ALLOWED = 'a force above 0 such as "5 N", or a share of the range such as "3 %", 100 % at most'


@dataclass(frozen=True)
class ForceTolerance:
    """An error that is good enough."""

    value: float
    relative: bool
    """The value is a share of the range, and no force in N."""

    def force(self, span: float) -> float:
        """Return it in N for a force that has this range, N."""
        return self.value * span if self.relative else self.value

    @property
    def text(self) -> str:
        """As a user writes it."""
        return f"{100 * self.value:.15g} %" if self.relative else f"{self.value:.15g} N"


def _read(value: object) -> ForceTolerance | None:
    if value is None or isinstance(value, ForceTolerance):
        return value
    relative = isinstance(value, str) and value.rstrip().endswith("%")
    try:
        number = (SHARE if relative else FORCE).parse(value)
    except ValueError as error:
        raise refusal(f"{shown(value)} is no tolerance of a force", _ALLOWED) from error
    if number <= 0:
        raise refusal(f"{shown(value)} is not positive", _ALLOWED)
    if relative and number > 1:
        raise refusal(f"{shown(value)} is more than the whole range of the force", _ALLOWED)
    return ForceTolerance(number, relative)


ToleranceOfForce = Annotated[
    ForceTolerance | None,
    BeforeValidator(_read),
    PlainSerializer(lambda found: None if found is None else found.text),
]
"""None: there is none."""


Computed = Literal["circle", "line", "spline"]
Motion = Literal["circle", "line", "spline", "file"]
Mirror = Literal["none", "xz", "yz"]


class BenchmarkMotion(Section):
    """A motion that is computed from a few numbers."""

    motion: Annotated[str, one_of(Computed)]
    mirror: Annotated[Mirror, one_of(Mirror)] = "none"
    """Plane in which the motion is mirrored."""
    periods: Sized = 10
    radius: Annotated[Length, Positive] = 0.15
    """Of the circle, m."""
    speed: Annotated[Speed, Positive] = 1.0
    """Of the TCP, m/s: on the circle, the largest on line and spline."""
    normal: Direction = (0.0, -0.5, 0.8660254037844386)
    """Of the circle's plane, base frame."""
    poses: Annotated[tuple[Pose, ...], at_least(2, "poses")] | None = None
    """Ends of the line, or points of the spline."""

    @model_validator(mode="after")
    def _motion_is_complete(self) -> Self:
        if self.motion in ("line", "spline") and self.poses is None:
            raise refusal(
                f"motion '{self.motion}' has no poses",
                "poses: a list of 2 or more poses",
                key="poses",
            )
        return self


class ValidationMotion(BenchmarkMotion):
    """One motion for the comparison of measured and predicted forces."""

    motion: Annotated[Motion, one_of(Motion)]
    file: FilledText | None = None
    """A recorded motion, relative to the run file."""
    tolerance: Annotated[ToleranceOfForce, LATER] = None
    """Root mean square of the prediction's error that is good enough, in N or of the range."""

    @model_validator(mode="after")
    def _recorded_motion_has_a_file(self) -> Self:
        if self.motion == "file" and self.file is None:
            raise refusal("motion 'file' names no file", "file: the recorded motion", key="file")
        return self


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
