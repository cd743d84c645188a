"""`motion:`, how the machine gets from rest at home into the periods, and back."""

from __future__ import annotations

from typing import Annotated, Literal

from expdesign.configuration.base import Section
from expdesign.configuration.quantity import Jerk, Positive
from expdesign.configuration.scalars import one_of

Phase = Literal["start", "best"]


class MotionSection(Section):
    """Settings of the executable motion.

    Attributes
    ----------
    jerk : float or None
        Largest jerk of a strut, m/s³. None: it follows from the limit of the struts'
        acceleration and from the designed motion (`expdesign.motion.jerk`).
    phase : {"start", "best"}
        Where on its orbit the designed motion is entered and left: at its t = 0, or where the
        ramps are shortest.
    """

    jerk: Annotated[Jerk, Positive] | None = None
    phase: Annotated[Phase, one_of(Phase)] = "start"
