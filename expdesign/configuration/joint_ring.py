"""Six joints on a circle, in pairs: the short form of `base_joints` and `platform_joints`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator

from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section, ShortForm
from expdesign.configuration.values.quantity import Angle, Length, Positive, quantity_text
from expdesign.configuration.values.scalars import one_of
from expdesign.mechanism.hexapod import ACTUATORS

PairedStruts = Literal["1-2", "2-3"]

_PAIRS = 3
_BETWEEN = 2 * math.pi / _PAIRS
_WIDEST = _BETWEEN / 2


def _half_angle(value: float) -> float:
    if not 0 <= value < _WIDEST:
        raise refusal(
            f"{quantity_text(value, 'rad')} is no half-angle between two joints of a pair",
            "from 0 to below 60 deg; joints that are further apart are a pair with the next ones",
        )
    return value


HalfAngle = Annotated[Angle, AfterValidator(_half_angle)]


class JointRing(Section):
    """Six joints on a circle about the z axis, three pairs that are 120° apart.

    Joint 1 is clockwise of the direction `rotation` and joint 2 as far counterclockwise of it, seen
    from above; so are joints 3 and 4, 5 and 6 of the directions 120° and 240° further.
    """

    radius: Annotated[Length, Positive]
    """m."""
    half_angle: HalfAngle
    """Between a joint and the middle of its pair, seen from the centre, rad."""
    pairs: Annotated[PairedStruts, one_of(PairedStruts)]
    """Joints that are a pair: 1 and 2, 3 and 4, 5 and 6; or 2 and 3, 4 and 5, 6 and 1."""
    rotation: Angle = 0.0
    """Direction in the middle of joints 1 and 2, from x towards y, rad."""
    z: Length = 0.0
    """Height of the circle, m."""

    @property
    def points(self) -> tuple[tuple[float, float, float], ...]:
        """The joints, (6, 3), m."""
        apart = self.half_angle if self.pairs == "1-2" else _WIDEST - self.half_angle
        angles = (
            self.rotation + (j // 2) * _BETWEEN + (apart if j % 2 else -apart)
            for j in range(ACTUATORS)
        )
        return tuple((self.radius * math.cos(a), self.radius * math.sin(a), self.z) for a in angles)


def _points(value: object) -> Any:
    return JointRing.model_validate(value).points if isinstance(value, Mapping) else value


OrRing = (BeforeValidator(_points), ShortForm(JointRing))
"""Takes a circle in place of six points."""
