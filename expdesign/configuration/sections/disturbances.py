"""What disturbs an experiment on the digital twin: keys of `experiment:`, off unless given."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from expdesign.configuration.problem import refusal, require
from expdesign.configuration.section import Section
from expdesign.configuration.values.quantity import (
    Angle,
    Force,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
    Share,
)
from expdesign.configuration.values.scalars import (
    Ascending,
    Distinct,
    Pair,
    at_least,
    per_strut,
    whole,
    word_for_none,
)
from expdesign.mechanism.hexapod import ACTUATORS

_Harmonic = Annotated[int, whole(1, 1000)]
_SHARE = require(
    lambda value: 0 <= value < 1, "{value:g} is not a share of the samples", "0 ≤ share < 1"
)


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

    share: Annotated[Number, _SHARE]
    length: Annotated[Length, NotNegative] = 0.0
    force: Annotated[Force, NotNegative] = 0.0


_PART = require(
    lambda value: 0 <= value < 0.5,  # noqa: PLR2004 - most of the recording is there
    "{value:g} of the samples is no recording",
    "0 ≤ share < 0.5",
)
_LARGEST_ROW = 10_000_000
_MOST_ROWS = 10_000
_NONE = (0.0,) * ACTUATORS

_GAIN = require(
    lambda value: value > -1, "{value:g} leaves nothing of the force", "a share above -1"
)
_Gains = Annotated[tuple[Annotated[Share, _GAIN], ...], per_strut("gains")]


class ForceConstantError(Section):
    """By which share forces are measured too large; the factors 1 + share are multiplied."""

    common: Annotated[Share, _GAIN] = 0.0
    """Of all actuators alike."""
    each: _Gains = _NONE
    """Of each actuator beyond it."""
    drift: _Gains = _NONE
    """What comes to it at the end of the experiment; linear in time."""


class Hum(Section):
    """A sinusoid in the measured forces that no motion makes: the mains, with its harmonics."""

    frequency: Annotated[Frequency, Positive] = 50.0
    amplitude: Annotated[tuple[Annotated[Force, NotNegative], ...], per_strut("amplitudes")]
    """Of the fundamental, N: one value for all actuators, or one for each."""
    phase: Annotated[tuple[Angle, ...] | None, *word_for_none("drawn", per_strut("phases"))] = None
    """At the first sample, rad, of amplitude · sin(k (2π f t + phase)); None (``drawn`` in the
    YAML): every repetition draws that of each actuator and harmonic."""
    harmonics: Annotated[tuple[Annotated[Number, NotNegative], ...], at_least(1, "amplitudes")] = (
        1.0,
    )
    """Amplitudes of harmonics 1, 2, … over `amplitude`."""


class Lost(Section):
    """Samples that are missing from the recording: the stamps of those that are there say so."""

    share: Annotated[Share, _PART] | None = None
    """Of the samples; every repetition draws its own."""
    rows: (
        Annotated[
            tuple[Annotated[int, whole(1, _LARGEST_ROW)], ...],
            at_least(1, "rows", _MOST_ROWS),
            Distinct,
        ]
        | None
    ) = None
    """Numbers of samples, from 1: the same in every repetition."""

    @model_validator(mode="after")
    def _one_way(self) -> Lost:
        if (self.share is None) == (self.rows is None):
            both = "both" if self.rows is not None else "neither"
            raise refusal(
                f"{both} of share and rows say which samples are lost", "share or rows", key="share"
            )
        return self
