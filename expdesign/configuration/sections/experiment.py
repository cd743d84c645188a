"""`experiment:` and `validate:`: what is executed, on the machine or on its twin."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from expdesign.configuration.bodies import FixedBodies
from expdesign.configuration.problem import refusal, require
from expdesign.configuration.robot_description import RobotSource
from expdesign.configuration.section import LATER, Section
from expdesign.configuration.sections.disturbances import (
    Cogging,
    ForceConstantError,
    Hum,
    Lost,
    Outliers,
    Quantisation,
    TrackingError,
)
from expdesign.configuration.values.force_tolerance import ToleranceOfForce
from expdesign.configuration.values.quantity import (
    Compliance,
    Duration,
    Frequency,
    Length,
    NotNegative,
    Positive,
    Share,
    Speed,
)
from expdesign.configuration.values.scalars import (
    Direction,
    FilledText,
    Pose,
    Seed,
    Sized,
    at_least,
    one_of,
    per_strut,
)
from expdesign.mechanism.hexapod import ACTUATORS

_CLOCK = require(
    lambda value: abs(value) < 0.1,  # noqa: PLR2004 - no clock is that wrong
    "{value:g} is no error of a clock",
    "a share between -0.1 and 0.1",
)


class ExperimentSection(Section):
    """Execution of the trajectory; disturbances are off unless given."""

    periods: Sized = 10
    """Number of periods that are measured."""
    sampling: Annotated[Frequency, Positive] = 1000.0
    """Of the measurement, Hz."""
    seed: Seed = 1
    """Of noise and disturbances."""
    tracking_error: TrackingError | None = None
    drift: Annotated[Length, NotNegative] = 0.0
    """Slow change of the strut lengths, m at the end of the experiment."""
    cogging: Cogging | None = None
    quantisation: Quantisation | None = None
    outliers: Outliers | None = None
    truth: Annotated[RobotSource | None, LATER] = None
    """The machine that is measured, where it is not the run's robot: one that ships, a path
    relative to the run file, or the machine itself."""
    payload: Annotated[FixedBodies, LATER] = ()
    """What the platform carries beyond the robot's own bodies, as far as it is known: limits of
    forces hold with it, and the machine that the twin measures has it."""
    force_constant: Annotated[ForceConstantError | None, LATER] = None
    hum: Annotated[Hum | None, LATER] = None
    delay: Annotated[Duration, LATER] = 0.0
    """By how much the measured forces lag behind the lengths, s."""
    clock: Annotated[Share, _CLOCK, LATER] = 0.0
    """By which share the stamps of the recording run fast, against the controller's clock."""
    strut_length: Annotated[tuple[Length, ...], per_strut("errors"), LATER] = (0.0,) * ACTUATORS
    """By how much each length is measured too long, m: its zero is off."""
    compliance: Annotated[
        tuple[Annotated[Compliance, NotNegative], ...], per_strut("compliances"), LATER
    ] = (0.0,) * ACTUATORS
    """Of the struts, between motor with its sensor and platform, m/N."""
    lost: Annotated[Lost | None, LATER] = None

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return 1 / self.sampling


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
