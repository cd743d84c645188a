"""`experiment:`, `validate:` and `study:`: what is executed, on the machine or on its twin."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from expdesign.configuration.bodies import FixedBodies
from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.problem import refusal, require
from expdesign.configuration.robot_description import RobotSource
from expdesign.configuration.section import LATER, Section
from expdesign.configuration.sections.design import CRITERIA
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
    Number,
    Positive,
    Share,
    Speed,
)
from expdesign.configuration.values.scalars import (
    Direction,
    Distinct,
    FilledText,
    Pose,
    Seed,
    Sized,
    at_least,
    exactly,
    one_of,
    per_strut,
    whole,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms import actuator_friction
from expdesign.mechanism.terms.rigid_platform import MASS

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


StudyKind = Literal["design", "identification", "validation"]
Kinematics = Literal["exact", "fourier", "central"]

_KEYS: dict[str, tuple[str, ...]] = {
    "design": ("sets", "criteria", "kinematics", "shown"),
    "identification": ("tracking_error",),
    "validation": ("cogging", "motions", "wrong"),
}
"""Of each kind alone; `kind` and `repetitions` are of all."""

_MOST_SETS = 1000
_FEWEST = 3
_FRICTION = tuple(p.name for p in actuator_friction.TERM.parameters)


_FACTOR = require(
    lambda value: 0 <= value != 1,
    "{value:g} makes no wrong parameter",
    "a factor other than 1, at least 0",
)


class StudySection(Section):
    """A comparison on the digital twin; each kind takes the keys named for it."""

    kind: Annotated[StudyKind, one_of(StudyKind)]
    repetitions: Annotated[int, whole(_FEWEST, None)] = 100
    """Simulated experiments: of every design, of every estimator, or identifications with the
    validation that follows."""
    sets: Annotated[int, whole(1, _MOST_SETS)] = 5
    """Kind design: sets of initial parameters; set k searches from `design.seed` + k − 1."""
    criteria: Annotated[
        tuple[Annotated[str, one_of(CRITERIA)], ...], exactly(2, "criteria"), Distinct
    ] = ("d", "condition")
    """Kind design: the criteria that are compared."""
    kinematics: Annotated[
        tuple[Annotated[Kinematics, one_of(Kinematics)], ...], at_least(1, "kinds"), Distinct
    ] = ("exact", "fourier", "central")
    """Kind design: without noise of the lengths, or with it and one of the differentiations."""
    shown: Annotated[tuple[ParameterName, ...], at_least(1, "parameters"), Distinct] = (
        "p10",
        "r1",
        "v1",
    )
    """Kind design: parameters whose distributions are drawn."""
    tracking_error: TrackingError = TrackingError(position=0.001, angle=math.radians(0.1))
    """Kind identification: of the disturbed experiments."""
    cogging: Cogging = Cogging(
        amplitude=(0.0, 0.0, 14.8, 21.1, 0.0, 0.0),
        pitch=(0.03,) * ACTUATORS,
        phase=(0.0, 0.0, 0.3, 1.1, 0.0, 0.0),
    )
    """Kind validation: what the model does not know."""
    motions: Annotated[tuple[ValidationMotion, ...], at_least(1, "motions")] = (
        ValidationMotion(motion="circle"),
        ValidationMotion(motion="circle", mirror="xz"),
    )
    """Kind validation: motions that are predicted."""
    wrong: dict[ParameterName, Annotated[Number, _FACTOR]] = Field(
        default_factory=lambda: {MASS: 1.2} | dict.fromkeys(_FRICTION, 0.5)
    )
    """Kind validation: factors of parameters, each wrong in turn."""

    @model_validator(mode="after")
    def _keys_are_of_this_kind(self) -> StudySection:
        # With their defaults they stand in every resolved run file, and say nothing.
        others = {key for kind, keys in _KEYS.items() if kind != self.kind for key in keys}
        for key in sorted(others & self.model_fields_set):
            default = type(self).model_fields[key].get_default(call_default_factory=True)
            if getattr(self, key) != default:
                raise refusal(
                    f"a study of kind {self.kind} has no '{key}'",
                    ", ".join(("kind", "repetitions", *_KEYS[self.kind])),
                    key=key,
                )
        return self
