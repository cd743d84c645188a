"""`experiment:`, how the trajectory is executed and measured, and what disturbs it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import Ascending, Pair, per_strut
from expdesign.configuration.values.quantity import (
    Angle,
    Force,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
)
from expdesign.configuration.values.scalars import Count, Seed, whole
from expdesign.mechanism.hexapod import ACTUATORS

_Harmonic = Annotated[int, whole(1, 1000)]


def _share(value: float) -> float:
    if not 0 <= value < 1:
        raise refusal(f"{value:g} is not a share of the samples", "0 ≤ share < 1")
    return value


class TrackingError(Section):
    """Periodic deviation of the executed from the designed motion, in other harmonics."""

    position: Annotated[Length, NotNegative] = 0.001
    """Root mean square of the deviation of x, y and z each, m."""
    angle: Annotated[Angle, NotNegative] = 0.0
    """The same of φ, θ and ψ, rad."""
    harmonics: Annotated[tuple[_Harmonic, _Harmonic], Pair, Ascending] = (6, 15)
    """First and last harmonic that it contains."""


class Cogging(Section):
    """A force periodic in the strut's length: amplitude · sin(2π length / pitch + phase).

    One value for all struts, or one for each: amplitude in N, pitch in m, phase in rad.
    """

    amplitude: Annotated[tuple[Annotated[Force, NotNegative], ...], per_strut("amplitudes")]
    pitch: Annotated[tuple[Annotated[Length, Positive], ...], per_strut("pitches")]
    phase: Annotated[tuple[Angle, ...], per_strut("phases")] = (0.0,) * ACTUATORS


class Quantisation(Section):
    """Resolution of the measured strut lengths (m) and forces (N); 0 is none."""

    length: Annotated[Length, NotNegative] = 0.0
    force: Annotated[Force, NotNegative] = 0.0


class Outliers(Section):
    """Rare gross errors: the share of samples, and their size in the lengths (m) and forces (N)."""

    share: Annotated[Number, AfterValidator(_share)]
    length: Annotated[Length, NotNegative] = 0.0
    force: Annotated[Force, NotNegative] = 0.0


class ExperimentSection(Section):
    """Execution of the trajectory; disturbances are off unless given."""

    periods: Count = 10
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

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return 1 / self.sampling
