"""`study:`, a question that takes many simulated experiments: which design, estimator, test."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section
from expdesign.configuration.sections.design import CRITERIA
from expdesign.configuration.sections.experiment import Cogging, TrackingError
from expdesign.configuration.sections.validation import ValidationMotion
from expdesign.configuration.values.lists import Distinct, at_least, exactly
from expdesign.configuration.values.quantity import Number
from expdesign.configuration.values.scalars import one_of, whole
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms import actuator_friction
from expdesign.mechanism.terms.rigid_platform import MASS

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


def _factor(value: float) -> float:
    if not 0 <= value < math.inf or value == 1:
        raise refusal(f"{value:g} makes no wrong parameter", "a factor other than 1, at least 0")
    return value


class StudySection(Section):
    """A comparison on the digital twin; each kind takes the keys named for it."""

    kind: Annotated[StudyKind, one_of(StudyKind)]
    repetitions: Annotated[int, whole(_FEWEST)] = 100
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
    wrong: dict[ParameterName, Annotated[Number, AfterValidator(_factor)]] = Field(
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
