"""`experiment:`, how the trajectory is executed and measured, and what disturbs it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal
from expdesign.configuration.quantity import (
    Angle,
    Force,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
)
from expdesign.configuration.scalars import Ascending, Pair, Seed, one_or_six, whole

_LARGEST_COUNT = 100_000


def _share(value: float) -> float:
    if not 0 <= value < 1:
        raise refusal(f"{value:g} is not a share of the samples", "0 ≤ share < 1")
    return value


class TrackingError(Section):
    """Periodic deviation of the executed from the designed motion, in other harmonics.

    Attributes
    ----------
    position, angle : float
        Size of the deviation of each coordinate, m and rad.
    harmonics : (2,)
        First and last harmonic that it contains.
    """

    position: Annotated[Length, NotNegative] = 0.001
    angle: Annotated[Angle, NotNegative] = 0.0
    harmonics: Annotated[
        tuple[Annotated[int, whole(1, 1000)], Annotated[int, whole(1, 1000)]], Pair, Ascending
    ] = (6, 15)


class Cogging(Section):
    """A force periodic in the strut's length: amplitude · sin(2π length / pitch + phase).

    Each is one value for all struts or six: amplitude in N, pitch in m, phase in rad.
    """

    amplitude: Annotated[tuple[Annotated[Force, NotNegative], ...], one_or_six("amplitudes")]
    pitch: Annotated[tuple[Annotated[Length, Positive], ...], one_or_six("pitches")]
    phase: Annotated[tuple[Angle, ...], one_or_six("phases")] = (0.0,) * 6


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
    """Execution of the trajectory; disturbances are off unless given.

    Attributes
    ----------
    periods : int
        Number of periods that are measured.
    sampling : float
        Of the measurement, Hz.
    seed : int
        Of noise and disturbances.
    tracking_error, cogging, quantisation, outliers : section or None
    drift : float
        Slow change of the strut lengths over the experiment, m.
    """

    periods: Annotated[int, whole(1, _LARGEST_COUNT)] = 10
    sampling: Annotated[Frequency, Positive] = 1000.0
    seed: Seed = 1
    tracking_error: TrackingError | None = None
    drift: Annotated[Length, NotNegative] = 0.0
    cogging: Cogging | None = None
    quantisation: Quantisation | None = None
    outliers: Outliers | None = None

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return 1 / self.sampling
