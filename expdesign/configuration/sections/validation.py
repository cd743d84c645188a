"""`validate:`, motions that were not used for the estimate and on which it is tested."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import Direction, Pose, at_least
from expdesign.configuration.values.quantity import Length, Positive, Speed
from expdesign.configuration.values.scalars import Count, FilledText, one_of

Motion = Literal["circle", "line", "spline", "file"]
Mirror = Literal["none", "xz", "yz"]


class ValidationMotion(Section):
    """One motion for the comparison of measured and predicted forces."""

    motion: Annotated[Motion, one_of(Motion)]
    mirror: Annotated[Mirror, one_of(Mirror)] = "none"
    """Plane in which the motion is mirrored."""
    periods: Count = 10
    radius: Annotated[Length, Positive] = 0.15
    """Of the circle, m."""
    speed: Annotated[Speed, Positive] = 1.0
    """Of the TCP, m/s: on the circle, the largest on line and spline."""
    normal: Direction = (0.0, -0.5, 0.8660254037844386)
    """Of the circle's plane, base frame."""
    poses: Annotated[tuple[Pose, ...], at_least(2, "poses")] | None = None
    """Ends of the line, or points of the spline."""
    file: FilledText | None = None
    """A recorded motion, relative to the run file."""

    @model_validator(mode="after")
    def _motion_is_complete(self) -> ValidationMotion:
        if self.motion == "file" and self.file is None:
            raise refusal("motion 'file' names no file", "file: the recorded motion", key="file")
        if self.motion in ("line", "spline") and self.poses is None:
            raise refusal(
                f"motion '{self.motion}' has no poses",
                "poses: a list of 2 or more poses",
                key="poses",
            )
        return self
