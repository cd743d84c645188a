"""`data:`, `estimate:` and `montecarlo:`, from a measured file to parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from expdesign.configuration.parameters import known_parameter, parsed_parameter
from expdesign.configuration.problem import refusal, require, shown
from expdesign.configuration.robot_description import RobotDescription
from expdesign.configuration.section import LATER, Section
from expdesign.configuration.sections.selection import SelectSection
from expdesign.configuration.values.channels import ForceOffsets, Offsets, Order, Signs
from expdesign.configuration.values.quantity import (
    CURRENT,
    DURATION,
    FORCE,
    LENGTH,
    Dimension,
    Duration,
    ForceConstant,
    Frequency,
    Number,
    Positive,
    unit_dimension,
)
from expdesign.configuration.values.scalars import (
    Distinct,
    FilledText,
    Seed,
    Sized,
    Text,
    at_least,
    by_key,
    one_of,
    per_strut,
    whole,
    word_for_none,
)
from expdesign.mechanism.hexapod import ACTUATORS, numbered

LENGTH_CHANNELS = numbered("q")
FORCE_CHANNELS = numbered("Q")
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period")
"""Columns of a measurement; `period` is optional."""

TimeGrid = Literal["uniform", "stamped"]
DecimalMark = Literal[".", ","]

CHANNEL_UNITS: dict[str, tuple[str, tuple[Dimension, ...]]] = {
    "t": ("a unit of time", (DURATION,)),
    "q": ("a unit of length", (LENGTH,)),
    "Q": ("a unit of force or of current", (FORCE, CURRENT)),
}
"""Units that the channels of a group may have."""

_Channel = Annotated[str, one_of(CHANNELS, "channel")]
_Units = Annotated[
    str, one_of((*CHANNEL_UNITS, *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels")
]


_ONE_CHARACTER = require(
    lambda text: len(text) == 1,
    "{shown} is not one character",
    "one character, such as ',' or '\\t'",
)
_STEP_SHARE = require(
    lambda value: 0 < value < 0.5,  # noqa: PLR2004 - half a step confuses two samples
    "{value:g} is no tolerance",
    "0 < time_tolerance < 0.5 (of a step)",
)


class Delay(Section):
    """By how much the channels lag behind their time stamps, s."""

    forces: Duration = 0.0
    lengths: Duration = 0.0


class OrderOfChannels(Section):
    """Order of the channels where those of lengths and forces are not in the same one."""

    q: Order | None = None
    Q: Order | None = None


class SignsOfChannels(Section):
    """Signs of the channels where those of lengths and forces are not the same."""

    q: Signs | None = None
    Q: Signs | None = None


class OffsetsOfChannels(Section):
    """What a channel's strut has where the channel reads zero, m and N."""

    q: Offsets | None = None
    Q: ForceOffsets | None = None


def _both_or_each(value: object) -> str:
    return "(inline)" if isinstance(value, dict | Section) else "(name)"


_Both = TypeVar("_Both")
_Each = TypeVar("_Each")
_BothOrEach = Annotated[
    Annotated[_Both, Tag("(name)")] | Annotated[_Each, Tag("(inline)")],
    Discriminator(_both_or_each),
]
"""One for lengths and forces, or each of them its own."""


class DataSection(Section):
    """Where a measurement stands and how it is read."""

    file: FilledText | None = None
    """The measured file, relative to the run file; `--data` names another."""
    columns: dict[_Channel, FilledText] = Field(default_factory=dict)
    """Channel (t, q1 …, Q1 …, period) → name in the file. Default: the same names."""
    units: dict[_Units, FilledText] = Field(default_factory=dict)
    """Channel, or group t, q, Q → unit in the file. Default: SI."""
    delimiter: Annotated[Text, _ONE_CHARACTER] = ","
    decimal: Annotated[DecimalMark, one_of(DecimalMark)] = "."
    force_constants: Annotated[tuple[ForceConstant, ...], per_strut("force constants")] | None = (
        None
    )
    """Force per ampere of the actuators, N/A, for files that hold currents."""
    order: Annotated[_BothOrEach[Order, OrderOfChannels] | None, LATER] = None
    """Number of the strut on each channel."""
    sign: Annotated[_BothOrEach[Signs, SignsOfChannels] | None, LATER] = None
    """Of the struts by their number: length or force = sign · channel + offset."""
    offset: Annotated[_BothOrEach[Offsets, OffsetsOfChannels] | None, LATER] = None
    """Length, m, at which the channel of a strut reads zero; of forces, N, by their group only."""
    start: Duration | None = None
    """Time of the trigger, s: rows before it are left out."""
    end: Duration | None = None
    """Time at which the measurement is over, s: rows from it on are left out."""
    delay: Delay = Delay()
    time: Annotated[TimeGrid, one_of(TimeGrid)] = "uniform"
    """Uniform time is replaced by the fitted grid, stamps are used as they are."""
    time_tolerance: Annotated[Number, _STEP_SHARE] = 0.01
    """Largest deviation from uniform time, as a share of a step."""

    @model_validator(mode="after")
    def _keys_fit_each_other(self) -> DataSection:
        if self.delimiter == self.decimal:
            message = f"'{self.decimal}' is both delimiter and decimal mark"
            raise refusal(message, "two different characters", key="decimal")
        if self.end is not None and self.start is not None and self.end <= self.start:
            message = f"the end, {self.end:g} s, is not after the start, {self.start:g} s"
            raise refusal(message, "data.end later than data.start", key="end")
        for column in self.columns.values():
            channels = [channel for channel, name in self.columns.items() if name == column]
            if len(channels) > 1:
                message = f"column {shown(column)} is both {' and '.join(channels)}"
                raise refusal(message, "a column for each channel", key="columns")
        for key, unit in self.units.items():
            allowed, dimensions = CHANNEL_UNITS[key[0]]
            dimension = unit_dimension(unit)
            if dimension not in dimensions:
                raise refusal(f"'{unit}' is no unit for {key}", allowed, key="units")
            if dimension is CURRENT and self.force_constants is None:
                raise refusal(
                    f"{key} is a current, but no force_constants are given",
                    "force_constants: one value, or one for each actuator, in N/A",
                    key="units",
                )
        return self

    def channel_order(self, group: str) -> tuple[int, ...]:
        """Return the strut, from 1, on each of the six channels of a group, ``q`` or ``Q``."""
        found = getattr(self.order, group) if isinstance(self.order, Section) else self.order
        return found or tuple(range(1, ACTUATORS + 1))

    def channel_signs(self, group: str) -> tuple[int, ...]:
        """Return the signs of the struts' channels in a group."""
        found = getattr(self.sign, group) if isinstance(self.sign, Section) else self.sign
        return found or (1,) * ACTUATORS

    @property
    def length_offsets(self) -> tuple[float, ...] | Literal["home"]:
        """Lengths of the struts at which their channels read zero, m, or at home."""
        found = self.offset.q if isinstance(self.offset, OffsetsOfChannels) else self.offset
        return found or (0.0,) * ACTUATORS

    @property
    def force_offsets(self) -> tuple[float, ...]:
        """Forces of the struts at which their channels read zero, N."""
        found = self.offset.Q if isinstance(self.offset, OffsetsOfChannels) else None
        return found or (0.0,) * ACTUATORS


Estimator = Literal["ls", "gm", "ml"]
Differentiation = Literal["fourier", "central", "butterworth"]
NoiseOrigin = Literal["auto", "estimated", "given"]
SpectrumOrigin = Literal["auto", "white", "estimated"]
FrequencyOrigin = Literal["known", "estimated"]
PriorOrigin = Literal["none", "robot"]
SystematicOrigin = Literal["budget", "estimated", "none"]
Loss = Literal["squared", "huber"]
Estimated = Literal["all", "base"]

Estimators = Annotated[
    tuple[Annotated[Estimator, one_of(Estimator)], ...], at_least(1, "estimators"), Distinct
]

_LARGEST_HARMONICS = 500
"""ML's motion has a dense matrix of 12 variables to each, squared: 0.3 GB."""

_FIXED = "a list of parameters, or parameters with their values"
_BOUNDS = "parameters with their [min, max]"
_PRIORS = (
    "parameters with their {std: …} or {value: …, std: …}; or the run folder of an estimate, for a "
    "payload"
)


def _fixed(name: str, item: object) -> float | None:
    return None if item is None else parsed_parameter(name, item)


def _names_alone(value: object) -> object:
    return {known_parameter(n): None for n in value} if isinstance(value, list | tuple) else value


def _bounds(name: str, item: Any) -> tuple[float, float]:
    if not isinstance(item, list | tuple) or len(item) != 2:  # noqa: PLR2004 - min and max
        raise refusal(f"{shown(item)} is no pair", _BOUNDS)
    low, high = (parsed_parameter(name, end) for end in item)
    if low >= high:
        raise refusal(f"min {low:g} is not below max {high:g}", _BOUNDS)
    return low, high


def _prior(name: str, item: Any) -> dict[str, float | None]:
    if not isinstance(item, dict) or not {"std"} <= set(item) <= {"value", "std"}:
        raise refusal(f"{shown(item)} does not state a prior", _PRIORS)
    std = parsed_parameter(name, item["std"])
    if std <= 0:
        raise refusal(f"the standard deviation {std:g} is not positive", _PRIORS)
    return {"value": _fixed(name, item.get("value")), "std": std}


def _prior_kind(value: object) -> str:
    if isinstance(value, str):
        return "(name)"
    robot = isinstance(value, RobotDescription)
    return "(inline)" if robot or (isinstance(value, dict) and "home" in value) else "(names)"


class Prior(Section):
    """A-priori knowledge that enters the estimate, in SI units; value None: the robot's."""

    value: float | None
    std: float


class EstimateSection(Section):
    """Settings of the estimation."""

    estimators: Estimators = ("ls", "gm", "ml")
    differentiation: Annotated[Differentiation, one_of(Differentiation)] = "fourier"
    """How rates and accelerations come from measured lengths."""
    harmonics: Annotated[int | None, *word_for_none("auto", whole(1, _LARGEST_HARMONICS))] = None
    """Of the kinematics; None (``auto`` in the YAML): chosen from the data."""
    noise: Annotated[NoiseOrigin, one_of(NoiseOrigin)] = "auto"
    """Covariances from the scatter between periods, or those of robot and run; ``auto`` is
    ``estimated`` where the periods have 250 degrees of freedom."""
    spectrum: Annotated[SpectrumOrigin, one_of(SpectrumOrigin), LATER] = "auto"
    """What the weights of GM and ML take the noise for: ``auto`` is ``estimated`` where the scatter
    between three or more periods speaks against ``white``."""
    systematic: Annotated[SystematicOrigin, one_of(SystematicOrigin), LATER] = "budget"
    """What becomes of the robot's tolerances: their share is counted, or maximum likelihood
    estimates what they are of, too."""
    frequency: Annotated[FrequencyOrigin, one_of(FrequencyOrigin)] = "known"
    loss: Annotated[Loss, one_of(Loss)] = "squared"
    """``huber`` lets outliers count less."""
    consistent: Annotated[bool, LATER] = False
    """Whether `identified-robot.yaml` has the nearest parameters that some set of bodies has, which
    are found in any case, instead of the estimate itself."""
    cutoff: Annotated[Frequency, Positive] | None = None
    """Of the Butterworth filter, Hz; None: three times the highest frequency of the design."""
    parameters: Annotated[Estimated, one_of(Estimated), LATER] = "all"
    """``base``: those that some motion within the limits of the machine shows, one for each
    combination; the others stay at the robot's values."""
    fixed: Annotated[
        dict[str, float | None],
        by_key(_fixed, _FIXED, known_parameter),
        BeforeValidator(_names_alone),
    ] = Field(default_factory=dict)
    """Parameter → value in SI units, None for the robot's value."""
    prior: Annotated[
        Annotated[FilledText, Tag("(name)")]
        | Annotated[RobotDescription, Tag("(inline)")]
        | Annotated[dict[str, Prior], by_key(_prior, _PRIORS, known_parameter), Tag("(names)")],
        Discriminator(_prior_kind),
    ] = Field(default_factory=dict)
    """Of single parameters; or the machine as it was identified, which carries an unknown payload
    now: a run folder, its identified-robot.yaml, or the machine itself."""
    prior_from: Annotated[PriorOrigin, one_of(PriorOrigin), LATER] = "none"
    """`robot`: what the robot file's `identification` knows is a prior, with its covariance."""
    bounds: Annotated[dict[str, tuple[float, float]], by_key(_bounds, _BOUNDS, known_parameter)] = (
        Field(default_factory=dict)
    )
    """Parameter → (min, max) in SI units."""
    select: Annotated[SelectSection | None, LATER] = None
    """Further terms that are estimated as far as the data support them; None: none is tried."""

    @model_validator(mode="after")
    def _one_prior(self) -> EstimateSection:
        if self.prior and self.prior_from != "none":
            message = "prior and prior_from are both given"
            raise refusal(message, "one of them", key="prior_from")
        if self.parameters == "base" and not isinstance(self.prior, dict):
            message = (
                "parameters is base, and prior a machine without its payload: it is known by its "
                "own parameters, not by combinations"
            )
            raise refusal(message, "parameters: all, or no prior", key="parameters")
        if self.fixed and not isinstance(self.prior, dict):
            message = "fixed, beside the prior of a whole machine: it holds what that held"
            raise refusal(message, "prior or fixed", key="fixed")
        return self

    @property
    def named_priors(self) -> Mapping[str, Prior]:
        """Those of single parameters."""
        return self.prior if isinstance(self.prior, dict) else {}


class MonteCarloSection(Section):
    """Study of the estimators' bias, spread and coverage in repeated simulated experiments."""

    repetitions: Sized = 400
    estimators: Estimators = ("ls", "gm", "ml")
    seed: Seed = 0
    """From which the random stream of every repetition is spawned."""
