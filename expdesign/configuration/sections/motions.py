"""`validate:` and `feedforward:`: benchmark motions for predicted forces and for control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, PlainSerializer, model_validator

from expdesign.configuration.errors import quote, refusal
from expdesign.configuration.fields import Count, Direction, FilledText, Pose, at_least, one_of
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
from expdesign.configuration.section import Section

_ALLOWED = 'a force above 0 such as "5 N", or a share of the range such as "3 %", 100 % at most'


@dataclass(frozen=True)
class ForceTolerance:
    """An acceptable error of a force, in N or as a share of the force's range."""

    value: float
    relative: bool
    """True for a share of the range, False for a force in N."""

    def force(self, span: float) -> float:
        """Return the tolerance in N for a force with a range in N.

        Examples
        --------
        >>> ForceTolerance(0.03, relative=True).force(200.0)
        6.0
        """
        return self.value * span if self.relative else self.value

    @property
    def text(self) -> str:
        """The tolerance in the user's notation."""
        return f"{100 * self.value:.15g} %" if self.relative else f"{self.value:.15g} N"


def _read_tolerance(value: object) -> ForceTolerance | None:
    if value is None or isinstance(value, ForceTolerance):
        return value
    relative = isinstance(value, str) and value.rstrip().endswith("%")
    try:
        number = (SHARE if relative else FORCE).parse(value)
    except ValueError as error:
        raise refusal(f"{quote(value)} is not a tolerance of a force", _ALLOWED) from error
    if number <= 0:
        raise refusal(f"{quote(value)} is not positive", _ALLOWED)
    if relative and number > 1:
        raise refusal(f"{quote(value)} is more than the whole range of the force", _ALLOWED)
    return ForceTolerance(number, relative)


ToleranceOfForce = Annotated[
    ForceTolerance | None,
    BeforeValidator(_read_tolerance),
    PlainSerializer(lambda found: None if found is None else found.text),
]


Computed = Literal["circle", "line", "spline"]
Motion = Literal["circle", "line", "spline", "file"]
Mirror = Literal["none", "xz", "yz"]


class BenchmarkMotion(Section):
    """A motion from a few numbers."""

    motion: Annotated[str, one_of(Computed)]
    mirror: Annotated[Mirror, one_of(Mirror)] = "none"
    """Plane in which the motion is mirrored."""
    periods: Count = 10
    radius: Annotated[Length, Positive] = 0.15
    """Radius of the circle, m."""
    speed: Annotated[Speed, Positive] = 1.0
    """Speed of the TCP, m/s: on the circle, or the largest on line and spline."""
    normal: Direction = (0.0, -0.5, 0.8660254037844386)
    """Normal of the circle's plane, base frame."""
    poses: Annotated[tuple[Pose, ...], at_least(2, "poses")] | None = None
    """Ends of the line, or points of the spline."""

    @model_validator(mode="after")
    def _check_poses(self) -> Self:
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
    tolerance: ToleranceOfForce = None
    """Acceptable root mean square of the prediction's error, in N or as a share of the range."""

    @model_validator(mode="after")
    def _check_file(self) -> Self:
        if self.motion == "file" and self.file is None:
            raise refusal("motion 'file' names no file", "file: the recorded motion", key="file")
        return self


Followed = Literal["design", "circle", "line", "spline"]


class FeedforwardSection(BenchmarkMotion):
    """Reference motion, and controller of every strut."""

    motion: Annotated[Followed, one_of(Followed)] = "circle"
    periods: Count = 2
    """Number of simulated periods; the last one is judged."""
    bandwidth: Annotated[Frequency, Positive] = 10.0
    """Natural frequency of a controlled strut, Hz."""
    damping: Annotated[Number, Positive] = 0.7
    """Damping ratio of a controlled strut."""
    integral: Annotated[Frequency, NotNegative] = 1.0
    """Corner frequency of the integral action, Hz; 0: none."""
    filter: Annotated[Frequency, Positive] = 100.0
    """Corner frequency of the low-pass filter of the differentiated length, Hz."""

    @model_validator(mode="after")
    def _check_stability(self) -> FeedforwardSection:
        # Routh: the roots of m s³ + d s² + k s + k ω_i decay while ω_i < d/m = 2 D ω. Struts that
        # move together may move up to twice the mass of a single one.
        if self.integral >= self.damping * self.bandwidth:
            raise refusal(
                f"with an integral action of {self.integral:g} Hz the controller is unstable",
                f"less than damping times bandwidth, {self.damping * self.bandwidth:g} Hz; a "
                "tenth of the bandwidth is usual",
                key="integral",
            )
        return self

    @model_validator(mode="after")
    def _check_mirror(self) -> FeedforwardSection:
        if self.motion == "design" and self.mirror != "none":
            raise refusal("the design cannot be mirrored", "mirror: none", key="mirror")
        return self
