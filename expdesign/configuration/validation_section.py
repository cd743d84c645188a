"""`validate:`, motions that were not used for the estimate and on which it is tested."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, model_validator

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal
from expdesign.configuration.quantity import Length, Number, Positive, Speed
from expdesign.configuration.robot_section import Pose
from expdesign.configuration.scalars import FilledText, at_least, exactly, one_of, whole

Motion = Literal["circle", "line", "spline", "file"]
Mirror = Literal["none", "xz", "yz"]

_LARGEST_COUNT = 100_000


def _direction(vector: tuple[float, ...]) -> tuple[float, ...]:
    if not any(vector):
        raise refusal("the vector is zero", "a direction [x, y, z]")
    return vector


class ValidationMotion(Section):
    """One motion for the comparison of measured and predicted forces.

    Attributes
    ----------
    motion : {"circle", "line", "spline", "file"}
    mirror : {"none", "xz", "yz"}
        Plane in which the motion is mirrored.
    periods : int
    radius, speed : float
        Of the circle, m, and of the TCP on circle and line, m/s.
    normal : (3,)
        Of the circle's plane, in the base frame.
    poses : tuple of (6,) or None
        Ends of the line, or points of the spline.
    file : str or None
        A recorded motion, relative to the run file.
    """

    motion: Annotated[Motion, one_of(Motion)]
    mirror: Annotated[Mirror, one_of(Mirror)] = "none"
    periods: Annotated[int, whole(1, _LARGEST_COUNT)] = 10
    radius: Annotated[Length, Positive] = 0.15
    speed: Annotated[Speed, Positive] = 1.0
    normal: Annotated[
        tuple[Number, ...], exactly(3, "components [x, y, z]"), AfterValidator(_direction)
    ] = (0.0, -0.5, 0.8660254037844386)
    poses: Annotated[tuple[Pose, ...], at_least(2, "poses")] | None = None
    file: FilledText | None = None

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
