"""`experiment:`: the execution of the design and the disturbances of the twin."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from expdesign.configuration.bodies import FixedBodies
from expdesign.configuration.errors import refusal, require
from expdesign.configuration.fields import (
    Ascending,
    Count,
    Distinct,
    Pair,
    Seed,
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
from expdesign.configuration.section import Section
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
    """Root mean square of the deviation of φ, θ and ψ each, rad."""
    harmonics: Annotated[tuple[_Harmonic, _Harmonic], Pair, Ascending] = (6, 15)
    """First and last harmonic of the deviation."""


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
    "a share of {value:g} leaves too few samples",
    "0 ≤ share < 0.5",
)
_LARGEST_ROW = 10_000_000
_MOST_ROWS = 10_000
_NONE = (0.0,) * ACTUATORS
_GAIN = require(
    lambda value: value > -1,
    "with {value:g} the measured force vanishes or changes its sign",
    "a share above -1",
)
_Gains = Annotated[tuple[Annotated[Share, _GAIN], ...], per_strut("gains")]


class ForceConstantError(Section):
    """Relative errors of the force constants; the factors 1 + share are multiplied."""

    common: Annotated[Share, _GAIN] = 0.0
    """Common error of all actuators."""
    each: _Gains = _NONE
    """Additional error of each actuator."""
    drift: _Gains = _NONE
    """Additional error at the end of the experiment; linear in time."""


class HumDisturbance(Section):
    """A sinusoid in the measured forces from the mains, with its harmonics."""

    frequency: Annotated[Frequency, Positive] = 50.0
    amplitude: Annotated[tuple[Annotated[Force, NotNegative], ...], per_strut("amplitudes")]
    """Amplitude of the fundamental, N: one value for all actuators, or one for each."""
    phase: Annotated[tuple[Angle, ...] | None, *word_for_none("drawn", per_strut("phases"))] = None
    """Phase at the first sample, rad, of amplitude · sin(k (2π f t + phase)); None (``drawn`` in
    the YAML): every repetition draws one for each actuator and harmonic."""
    harmonics: Annotated[tuple[Annotated[Number, NotNegative], ...], at_least(1, "amplitudes")] = (
        1.0,
    )
    """Amplitudes of harmonics 1, 2, … over `amplitude`."""


class Lost(Section):
    """Lost samples of the recording, visible as gaps between the time stamps."""

    share: Annotated[Share, _PART] | None = None
    """Share of the samples; every repetition draws others."""
    rows: (
        Annotated[
            tuple[Annotated[int, whole(1, _LARGEST_ROW)], ...],
            at_least(1, "rows", _MOST_ROWS),
            Distinct,
        ]
        | None
    ) = None
    """Numbers of the lost samples, from 1, the same in every repetition."""

    @model_validator(mode="after")
    def _check_one_form(self) -> Lost:
        if (self.share is None) == (self.rows is None):
            both = "both" if self.rows is not None else "neither"
            raise refusal(f"{both} of share and rows are given", "share or rows", key="share")
        return self


_CLOCK = require(
    lambda value: abs(value) < 0.1,  # noqa: PLR2004 - no clock is that wrong
    "{value:g} is not an error of a clock",
    "a share between -0.1 and 0.1",
)


class ExperimentSection(Section):
    """Execution of the trajectory, and disturbances of the twin, by default none."""

    periods: Count = 10
    """Number of measured periods."""
    sampling: Annotated[Frequency, Positive] = 1000.0
    """Sampling of the measurement, Hz."""
    seed: Seed = 1
    """Seed of noise and disturbances."""
    tracking_error: TrackingError | None = None
    drift: Annotated[Length, NotNegative] = 0.0
    """Drift of the strut lengths at the end of the experiment, m."""
    cogging: Cogging | None = None
    quantisation: Quantisation | None = None
    outliers: Outliers | None = None
    truth: RobotSource | None = None
    """True machine of the twin, by default the run's robot: the name of an included robot, a path
    relative to the run file, or the machine itself."""
    payload: FixedBodies = ()
    """Known bodies on the platform in addition to the robot's: limits of forces hold with them, and
    the twin has them."""
    force_constant: ForceConstantError | None = None
    hum: HumDisturbance | None = None
    delay: Duration = 0.0
    """Delay of the measured forces against the lengths, s."""
    clock: Annotated[Share, _CLOCK] = 0.0
    """Relative error of the recording's clock against the controller's, positive if fast."""
    strut_length: Annotated[tuple[Length, ...], per_strut("errors")] = (0.0,) * ACTUATORS
    """Zero errors of the length measurements, m, positive if too long."""
    compliance: Annotated[
        tuple[Annotated[Compliance, NotNegative], ...], per_strut("compliances")
    ] = (0.0,) * ACTUATORS
    """Compliance of the struts, between motor with its sensor and platform, m/N."""
    lost: Lost | None = None

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return 1 / self.sampling
