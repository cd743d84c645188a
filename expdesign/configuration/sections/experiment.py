"""`experiment:`: the execution of the design and the disturbances of the twin."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from expdesign.configuration.bodies import FixedBodies
from expdesign.configuration.errors import refusal, require
from expdesign.configuration.fields import (
    Ascending,
    Distinct,
    Pair,
    Seed,
    Sized,
    at_least,
    per_strut,
    whole,
    word_for_none,
)
from expdesign.configuration.quantity import (
    Angle,
    Compliance,
    Duration,
    Force,
    Frequency,
    Length,
    NotNegative,
    Number,
    Positive,
    Share,
)
from expdesign.configuration.robot import RobotSource
from expdesign.configuration.section import LATER, Section
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
