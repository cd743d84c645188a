"""`experiment:`, `validate:`, `feedforward:`: the twin, and benchmark motions for predictions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, PlainSerializer, model_validator

from expdesign.configuration import schema
from expdesign.configuration.bodies import FixedBodies
from expdesign.configuration.errors import quote, refusal
from expdesign.configuration.estimate import Delay
from expdesign.configuration.quantity import (
    FORCE,
    SHARE,
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
    Speed,
)
from expdesign.configuration.robot import RobotSource
from expdesign.mechanism.hexapod import ACTUATORS

_Harmonic = Annotated[int, schema.whole(1, 1000)]
_ROUNDING = 1e-12
_WHOLE = 1e-6
"""Largest error of the last period, in samples, for equal periods of whole samples."""


class TrackingError(schema.Section):
    """Periodic deviation of the executed from the designed motion, in other harmonics."""

    position: Annotated[Length, NotNegative] = 0.001
    """Root mean square of the deviation of x, y and z each, m."""
    angle: Annotated[Angle, NotNegative] = 0.0
    """Root mean square of the deviation of φ, θ and ψ each, rad."""
    harmonics: Annotated[tuple[_Harmonic, _Harmonic], schema.Pair, schema.Ascending] = (6, 15)
    """First and last harmonic of the deviation."""


class Cogging(schema.Section):
    """A force periodic in the strut's length: amplitude · sin(2π length / pitch + phase).

    One value for all struts, or one for each: amplitude in N, pitch in m, phase in rad.
    """

    amplitude: schema.PerStrut[Annotated[Force, NotNegative]]
    pitch: schema.PerStrut[Annotated[Length, Positive]]
    phase: schema.PerStrut[Angle] = (0.0,) * ACTUATORS


class Quantisation(schema.Section):
    """Resolution of the measured strut lengths (m) and forces (N); 0 is none."""

    length: Annotated[Length, NotNegative] = 0.0
    force: Annotated[Force, NotNegative] = 0.0


class Outliers(schema.Section):
    """Rare gross errors: the share of samples, and their size in the lengths (m) and forces (N)."""

    share: Annotated[Number, Field(ge=0, lt=1)]
    length: Annotated[Length, NotNegative] = 0.0
    force: Annotated[Force, NotNegative] = 0.0


_LARGEST_ROW = 10_000_000
_MOST_ROWS = 10_000
_NONE = (0.0,) * ACTUATORS
_GAIN = Field(gt=-1)
"""Below, the measured force vanishes or changes its sign."""
_Gains = schema.PerStrut[Annotated[Share, _GAIN]]


class ForceConstantError(schema.Section):
    """Relative errors of the force constants; the factors 1 + share are multiplied."""

    common: Annotated[Share, _GAIN] = 0.0
    """Common error of all actuators."""
    each: _Gains = _NONE
    """Additional error of each actuator."""
    drift: _Gains = _NONE
    """Additional error at the end of the experiment; linear in time."""


class HumDisturbance(schema.Section):
    """A sinusoid in the measured forces from the mains, with its harmonics."""

    frequency: Annotated[Frequency, Positive] = 50.0
    amplitude: schema.PerStrut[Annotated[Force, NotNegative]]
    """Amplitude of the fundamental, N: one value for all actuators, or one for each."""
    phase: Annotated[tuple[Angle, ...] | None, *schema.word_for_none("drawn", schema.per_strut)] = (
        None
    )
    """Phase at the first sample, rad, of amplitude · sin(k (2π f t + phase)); None (``drawn`` in
    the YAML): every repetition draws one for each actuator and harmonic."""
    harmonics: Annotated[
        tuple[Annotated[Number, NotNegative], ...], schema.at_least(1, "amplitudes")
    ] = (1.0,)
    """Amplitudes of harmonics 1, 2, … over `amplitude`."""


class Lost(schema.Section):
    """Lost samples of the recording, visible as gaps between the time stamps."""

    share: Annotated[Share, Field(ge=0, lt=0.5)] | None = None
    """Share of the samples; every repetition draws others."""
    rows: (
        Annotated[
            tuple[Annotated[int, schema.whole(1, _LARGEST_ROW)], ...],
            schema.at_least(1, "rows", _MOST_ROWS),
            schema.Distinct,
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


_TimeConstants = schema.PerStrut[Annotated[Duration, NotNegative]]


class LowPass(schema.Section):
    """Time constants of first-order low passes of single channels, s, one or six."""

    forces: _TimeConstants = (0.0,) * ACTUATORS
    lengths: _TimeConstants = (0.0,) * ACTUATORS


class ExperimentSection(schema.Section):
    """Execution of the trajectory, and disturbances of the twin, by default none."""

    periods: schema.Count = 10
    """Number of measured periods."""
    sampling: Annotated[Frequency, Positive] = 1000.0
    """Sampling of the measurement, Hz."""
    seed: schema.Seed = 1
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
    follows: Literal["lengths", "platform"] = "lengths"
    """What the twin's controller follows: strut lengths of the designed motion, with the joints of
    the robot file, or the motion of the platform itself, as after a perfect calibration. They
    differ for a true machine with other joints or zeros of lengths."""
    payload: FixedBodies = ()
    """Known bodies on the platform in addition to the robot's: limits of forces hold with them, and
    the twin has them."""
    force_constant: ForceConstantError | None = None
    hum: HumDisturbance | None = None
    delay: Duration = 0.0
    """Delay of the measured forces against the lengths, s."""
    channel_delay: Delay = Delay()
    low_pass: LowPass = LowPass()
    clock: Annotated[Share, Field(gt=-0.1, lt=0.1)] = 0.0
    """Relative error of the recording's clock against the controller's, positive if fast."""
    strut_length: schema.PerStrut[Length] = (0.0,) * ACTUATORS
    """Zero errors of the length measurements, m, positive if too long."""
    compliance: schema.PerStrut[Annotated[Compliance, NotNegative]] = (0.0,) * ACTUATORS
    """Compliance of the struts, between motor with its sensor and platform, m/N."""
    lost: Lost | None = None

    @property
    def step(self) -> float:
        """Time between two samples, s."""
        return 1 / self.sampling

    def samples_per_period(self, period: float) -> int | float:
        """Return the samples of a period, whole where all periods have the same phases."""
        steps = period * self.sampling
        nearest = round(steps)
        alike = nearest >= 1 and abs(steps - nearest) * self.periods < _WHOLE
        return nearest if alike else steps

    def count_samples(self, period: float) -> int:
        """Return the number of samples of all periods.

        Examples
        --------
        >>> ExperimentSection(periods=10, sampling=500).count_samples(2.0)
        10000
        """
        return int(self.periods * self.samples_per_period(period) * (1 + _ROUNDING))


_ALLOWED = 'a force above 0 such as "5 N", or a share of the range such as "3 %", 100 % at most'


@dataclass(frozen=True)
class ForceTolerance:
    """An acceptable error of a force, in N or as a share of the force's range."""

    value: float
    relative: bool
    """True for a share of the range, False for a force in N."""

    def force(self, span: float) -> float:
        """Return the tolerance in N for a force with a range in N.

        Examples
        --------
        >>> ForceTolerance(0.03, relative=True).force(200.0)
        6.0
        """
        return self.value * span if self.relative else self.value

    @property
    def text(self) -> str:
        """The tolerance in the user's notation."""
        return f"{100 * self.value:.15g} %" if self.relative else f"{self.value:.15g} N"


def _read_tolerance(value: object) -> ForceTolerance | None:
    if value is None or isinstance(value, ForceTolerance):
        return value
    relative = isinstance(value, str) and value.rstrip().endswith("%")
    try:
        number = (SHARE if relative else FORCE).parse(value)
    except ValueError as error:
        raise refusal(f"{quote(value)} is not a tolerance of a force", _ALLOWED) from error
    if number <= 0:
        raise refusal(f"{quote(value)} is not positive", _ALLOWED)
    if relative and number > 1:
        raise refusal(f"{quote(value)} is more than the whole range of the force", _ALLOWED)
    return ForceTolerance(number, relative)


ToleranceOfForce = Annotated[
    ForceTolerance | None,
    BeforeValidator(_read_tolerance),
    PlainSerializer(lambda found: None if found is None else found.text),
]

Motion = Literal["circle", "line", "spline", "file"]


class BenchmarkMotion(schema.Section):
    """A motion from a few numbers."""

    motion: str
    mirror: Literal["none", "xz", "yz"] = "none"
    """Plane in which the motion is mirrored."""
    periods: schema.Count = 10
    radius: Annotated[Length, Positive] = 0.15
    """Radius of the circle, m."""
    speed: Annotated[Speed, Positive] = 1.0
    """Speed of the TCP, m/s: on the circle, or the largest on line and spline."""
    normal: schema.Direction = (0.0, -0.5, 0.8660254037844386)
    """Normal of the circle's plane, base frame."""
    poses: Annotated[tuple[schema.Pose, ...], schema.at_least(2, "poses")] | None = None
    """Ends of the line, or points of the spline."""

    @model_validator(mode="after")
    def _check_poses(self) -> Self:
        if self.motion in ("line", "spline") and self.poses is None:
            raise refusal(
                f"motion '{self.motion}' has no poses",
                "poses: a list of 2 or more poses",
                key="poses",
            )
        return self


class ValidationMotion(BenchmarkMotion):
    """One motion for the comparison of measured and predicted forces."""

    motion: Motion
    file: schema.FilledText | None = None
    """A recorded motion, relative to the run file."""
    tolerance: ToleranceOfForce = None
    """Acceptable root mean square of the prediction's error, in N or as a share of the range."""

    @model_validator(mode="after")
    def _check_file(self) -> Self:
        if self.motion == "file" and self.file is None:
            raise refusal("motion 'file' names no file", "file: the recorded motion", key="file")
        return self


class FeedforwardSection(BenchmarkMotion):
    """Reference motion, and controller of every strut."""

    motion: Literal["design", "circle", "line", "spline"] = "circle"
    periods: schema.Count = 2
    """Number of simulated periods; the last one is judged."""
    bandwidth: Annotated[Frequency, Positive] = 10.0
    """Natural frequency of a controlled strut, Hz."""
    damping: Annotated[Number, Positive] = 0.7
    """Damping ratio of a controlled strut."""
    integral: Annotated[Frequency, NotNegative] = 1.0
    """Corner frequency of the integral action, Hz; 0: none."""
    filter: Annotated[Frequency, Positive] = 100.0
    """Corner frequency of the low-pass filter of the differentiated length, Hz."""

    @model_validator(mode="after")
    def _check_stability(self) -> FeedforwardSection:
        # Routh: the roots of m s³ + d s² + k s + k ω_i decay while ω_i < d/m = 2 D ω. Struts that
        # move together may move up to twice the mass of a single one.
        if self.integral >= self.damping * self.bandwidth:
            raise refusal(
                f"with an integral action of {self.integral:g} Hz the controller is unstable",
                f"less than damping times bandwidth, {self.damping * self.bandwidth:g} Hz; a "
                "tenth of the bandwidth is usual",
                key="integral",
            )
        return self

    @model_validator(mode="after")
    def _check_mirror(self) -> FeedforwardSection:
        if self.motion == "design" and self.mirror != "none":
            raise refusal("the design cannot be mirrored", "mirror: none", key="mirror")
        return self
