"""`data:`, `estimate:` and `montecarlo:`: recordings, estimators, and the study of estimators."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from expdesign.configuration import quantity, schema
from expdesign.configuration.actuator_units import (
    FORCE_KINDS,
    LENGTH_KINDS,
    VOLTAGE_KINDS,
    ActuatorUnits,
)
from expdesign.configuration.errors import quote, refusal, require
from expdesign.configuration.parameters import FurtherTerms, check_parameter, parse_parameter
from expdesign.configuration.robot import ResolvedRobot, RobotDescription
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names

LENGTH_CHANNELS = actuator_names("q")
FORCE_CHANNELS = actuator_names("Q")
SUPPLY = "U"
"""Channel of the motors' supply voltage."""
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period", SUPPLY)
"""Columns of a recording; `period` and the supply are optional."""
CHANNEL_UNITS: dict[str, tuple[str, tuple[quantity.Quantity, ...]]] = {
    "t": ("a unit of time", (quantity.DURATION,)),
    "q": ("a unit of length, of the motor's angle, or count", LENGTH_KINDS),
    "Q": ("a unit of force, of the motor's torque, current or voltage, or duty", FORCE_KINDS),
    SUPPLY: ("a unit of voltage", (quantity.VOLTAGE,)),
}
"""Quantities of the channels in a group, with words for messages."""
_Channel = Annotated[str, schema.one_of((*CHANNELS, "tQ"), "channel")]
_Units = Annotated[
    str,
    schema.one_of(
        (*CHANNEL_UNITS, "tQ", *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels"
    ),
]
_Filtered = Annotated[
    str,
    schema.one_of(("q", "Q", *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels"),
]
TIME_OF_FORCES = "tQ"
"""Channel of the time in the file of the forces, if its name is not that of the lengths."""
_ONE_CHARACTER = require(
    lambda text: len(text) == 1,
    "{quoted} is not one character",
    "one character, such as ',' or '\\t'",
)


_Delays = schema.PerStrut[quantity.Duration]
Scales = schema.PerStrut[Annotated[quantity.Number, Field(gt=0)]]
"""Factor of each strut by its number."""


class Delay(schema.Section):
    """Delays of the channels against their time stamps, s, one or six by the struts' numbers."""

    forces: _Delays = (0.0,) * ACTUATORS
    lengths: _Delays = (0.0,) * ACTUATORS


class ChannelFilter(schema.Section):
    """Butterworth low-pass filter that the values of a channel have passed."""

    low_pass: Annotated[quantity.Frequency, quantity.Positive]
    """Frequency at which a causal filter leaves 0.71 of the amplitude, Hz."""
    order: Annotated[int, schema.whole(1, 8)] = 1
    zero_phase: bool = False
    """Applied forwards and backwards: the square of the gain and no delay."""
    sampling: Annotated[quantity.Frequency, quantity.Positive] | None = None
    """Rate at which a digital filter is computed (bilinear transform), Hz; None: continuous."""

    @model_validator(mode="after")
    def _check_rate(self) -> ChannelFilter:
        if self.sampling is not None and self.low_pass >= self.sampling / 2:
            message = (
                f"a digital filter at {self.sampling:g} Hz has no cut-off {self.low_pass:g} Hz"
            )
            raise refusal(message, "one below half of `sampling`", key="low_pass")
        return self


class OrderByChannel(schema.Section):
    """Separate orders of the channels for lengths and forces."""

    q: schema.Order | None = None
    Q: schema.Order | None = None


class SignsByChannel(schema.Section):
    """Separate signs of the channels for lengths and forces."""

    q: schema.Signs | None = None
    Q: schema.Signs | None = None


class ScalesByChannel(schema.Section):
    """Separate scales of the channels for lengths and forces."""

    q: Scales | None = None
    Q: Scales | None = None


class OffsetsByChannel(schema.Section):
    """Lengths, m, and forces, N, of the struts at readings of zero."""

    q: schema.Offsets | None = None
    Q: schema.ForceOffsets | None = None


class Header(schema.Section):
    """Lines of a text file around the names of its columns."""

    before: Annotated[int, schema.whole(0, 1000)] = 0
    """Lines before that of the names."""
    names: Annotated[tuple[str, ...], schema.at_least(2, "names")] | None = None
    """Names of the columns in their order, for a file without them."""
    after: Annotated[int, schema.whole(0, 1000)] = 0
    """Lines between the names and the numbers, such as units."""

    @property
    def lines(self) -> int:
        """Number of lines before the numbers."""
        return self.before + (self.names is None) + self.after


class DataFiles(schema.Section):
    """Two files of one recording, with stamps of one clock and rates of their own."""

    lengths: schema.FilledText
    forces: schema.FilledText


def name_in_run_file(run: Path | None, file: str | Path) -> str:
    """Return the path of a file relative to a run file; without one, to the current folder."""
    folder = Path.cwd() if run is None else run.absolute().parent
    return os.path.relpath(Path(file).absolute(), folder)


class DataSection(schema.Section):
    """Location and format of a recording."""

    file: schema.FilledText | None = None
    """File of the recording, relative to the run file; `--data` overrides it."""
    files: DataFiles | None = None
    """Files of lengths and forces in place of one file; `--data` names that of the lengths."""
    sampling: Annotated[quantity.Frequency, quantity.Positive] | None = None
    """Sampling frequency of a file without time, Hz."""
    columns: dict[_Channel, schema.FilledText] = Field(default_factory=dict)
    """Channel (t, q1 …, Q1 …, period, U, tQ) → name in the file. Default: the same names, no U."""
    units: dict[_Units, schema.FilledText] = Field(default_factory=dict)
    """Channel, or group t, q, Q, U → unit in the file. Default: SI."""
    header: Header = Header()
    delimiter: Annotated[str, _ONE_CHARACTER] = ","
    decimal: Literal[".", ","] = "."
    force_constants: schema.PerStrut[quantity.ForceConstant] | None = None
    """Force per ampere of the actuators, N/A, for files that hold currents."""
    counts_per_metre: schema.Counts | None = None
    """Counts of one metre of a strut, for files that hold counts."""
    counts_per_revolution: schema.Counts | None = None
    """Counts of one turn of a motor, for files that hold counts, instead of those per metre."""
    order: schema.PlainOrSection[schema.Order, OrderByChannel] | None = None
    """Number of the strut on each channel."""
    sign: schema.PlainOrSection[schema.Signs, SignsByChannel] | None = None
    """Signs by the struts' numbers: length or force = sign · scale · channel + offset."""
    scale: schema.PlainOrSection[Scales, ScalesByChannel] | None = None
    """Factors by the struts' numbers, in addition to those of the units."""
    offset: schema.PlainOrSection[schema.Offsets, OffsetsByChannel] | None = None
    """Lengths of the struts at readings of zero, m; forces, N, in a mapping with the key Q."""
    start: quantity.Duration | None = None
    """Time of the trigger, s: earlier rows are ignored."""
    end: quantity.Duration | None = None
    """End of the measurement, s: rows from then on are ignored."""
    delay: Delay = Delay()
    filter: dict[_Filtered, ChannelFilter] = Field(default_factory=dict)
    """Channel, or group q, Q → low-pass filter that its values have passed."""
    time: Literal["uniform", "stamped"] = "uniform"
    """Uniform time is replaced by the fitted grid, stamps are used as they are."""
    time_tolerance: Annotated[quantity.Number, Field(gt=0, lt=0.5)] = 0.01
    """Largest deviation from uniform time, as a share of a step."""

    @property
    def recording(self) -> str | None:
        """File of the recording, or of its lengths."""
        return self.file if self.files is None else self.files.lengths

    def with_files(self, change: Callable[[str], str]) -> DataSection:
        """Return the section with other names of its files, each the result of a function."""
        files = self.files and DataFiles(**{key: change(file) for key, file in self.files})
        return self.model_copy(update={"file": self.file and change(self.file), "files": files})

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that a file may contain: all, or those of one group."""
        return CHANNELS if self.sampling is None else CHANNELS[1:]

    def unit_of(self, channel: str) -> str | None:
        """Return the unit of a channel in the file; None: SI, or that of its header."""
        return self.units.get(channel, self.units.get(channel[0]))

    @property
    def voltages(self) -> bool:
        """Whether the forces are stated as voltages or duty cycles of the motors."""
        units = [self.unit_of(channel) or "N" for channel in FORCE_CHANNELS]
        return all(quantity.quantity_of_unit(unit) in VOLTAGE_KINDS for unit in units)

    def of_group(self, group: Literal["q", "Q"]) -> DataSection:
        """Return the section for the file of the lengths, ``q``, or of the forces, ``Q``."""

        def own(given: dict[str, Any]) -> dict[str, Any]:
            time = given.get(TIME_OF_FORCES, given.get("t")) if group == "Q" else given.get("t")
            others = {key: value for key, value in given.items() if key[0] != "t"}
            return others if time is None else {"t": time, **others}

        changes = {"files": None, "columns": own(self.columns), "units": own(self.units)}
        return DataOfGroup.model_construct(**{**dict(self), **changes, "group": group})

    @model_validator(mode="after")
    def _check_combination(self) -> DataSection:
        if self.file is not None and self.files is not None:
            raise refusal("file and files are both given", "one of them", key="files")
        if self.files is None and TIME_OF_FORCES in {**self.columns, **self.units}:
            raise refusal("tQ is the time in a second file", "data.files", key="files")
        if self.delimiter == self.decimal:
            message = f"'{self.decimal}' is both delimiter and decimal mark"
            raise refusal(message, "two different characters", key="decimal")
        if self.end is not None and self.start is not None and self.end <= self.start:
            message = f"the end, {self.end:g} s, is not after the start, {self.start:g} s"
            raise refusal(message, "data.end later than data.start", key="end")
        for own, column in self.columns.items():
            channels = [
                channel
                for channel, name in self.columns.items()
                if name == column and (self.files is None or own[0] == channel[0])
            ]
            if len(channels) > 1:
                message = f"column {quote(column)} is both {' and '.join(channels)}"
                raise refusal(message, "a column for each channel", key="columns")
        if self.counts_per_metre is not None and self.counts_per_revolution is not None:
            message = "counts_per_metre and counts_per_revolution are both given"
            raise refusal(message, "one of the two", key="counts_per_revolution")
        for key, unit in self.units.items():
            allowed, kinds = CHANNEL_UNITS[key[0]]
            kind = quantity.quantity_of_unit(unit)
            if kind is None or kind not in kinds:
                raise refusal(f"'{unit}' is not a unit for {key}", allowed, key="units")
            # The robot file may have what other units need.
            if kind is quantity.COUNT and (missing := self.actuator_units().missing(unit)):
                message = f"{key} is {kind.name}, but {missing[0]}"
                raise refusal(message, missing[1], key="units")
        return self

    def actuator_units(self, robot: ResolvedRobot | None = None) -> ActuatorUnits:
        """Return the units of lengths and forces; without a robot its drive is not missing."""
        return ActuatorUnits(
            robot,
            self.counts_per_metre,
            self.counts_per_revolution,
            self.force_constants,
            SUPPLY in self.columns,
        )

    def channel_order(self, group: str) -> tuple[int, ...]:
        """Return the strut, from 1, on each of the six channels of a group, ``q`` or ``Q``."""
        found = getattr(self.order, group) if isinstance(self.order, schema.Section) else self.order
        return found or tuple(range(1, ACTUATORS + 1))

    def channel_signs(self, group: str) -> tuple[int, ...]:
        """Return the signs of the struts' channels in a group."""
        found = getattr(self.sign, group) if isinstance(self.sign, schema.Section) else self.sign
        return found or (1,) * ACTUATORS

    def channel_scales(self, group: str) -> tuple[float, ...]:
        """Return the factors of the struts' channels in a group."""
        found = getattr(self.scale, group) if isinstance(self.scale, schema.Section) else self.scale
        return found or (1.0,) * ACTUATORS

    @property
    def filtered_keys(self) -> tuple[str, ...]:
        """Keys that give single channels a response: a filter, or different delays."""
        apart = any(len(set(self.channel_delays(group))) > 1 for group in "qQ")
        return ("filter",) * bool(self.filter) + ("delay",) * apart

    def channel_delays(self, group: str) -> tuple[float, ...]:
        """Return the delays of the struts' channels in a group, s."""
        return self.delay.forces if group == "Q" else self.delay.lengths

    def channel_filters(self, group: str) -> tuple[ChannelFilter | None, ...]:
        """Return the filters of the struts' channels in a group."""
        order = self.channel_order(group)
        names = (f"{group}{order.index(strut) + 1}" for strut in range(1, ACTUATORS + 1))
        return tuple(self.filter.get(name, self.filter.get(group)) for name in names)

    @property
    def length_offsets(self) -> tuple[float, ...] | Literal["home"]:
        """Lengths of the struts at readings of zero, m; ``"home"``: their lengths at home."""
        found = self.offset.q if isinstance(self.offset, OffsetsByChannel) else self.offset
        return found or (0.0,) * ACTUATORS

    @property
    def force_offsets(self) -> tuple[float, ...]:
        """Forces of the struts at readings of zero, N."""
        found = self.offset.Q if isinstance(self.offset, OffsetsByChannel) else None
        return found or (0.0,) * ACTUATORS


class DataOfGroup(DataSection):
    """Format of a file that has the lengths or the forces alone."""

    group: Literal["q", "Q"]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the file may contain."""
        own = (*LENGTH_CHANNELS, "period") if self.group == "q" else (*FORCE_CHANNELS, SUPPLY)
        return tuple(channel for channel in super().channels if channel in ("t", *own))


SelectionCriterion = Literal["bic", "f", "holdout"]
DEFAULT_LEVEL = 0.01


class SelectSection(schema.Section):
    """Candidate terms for a selection by the data."""

    candidates: FurtherTerms
    """Terms in the notation of a robot file's `terms`."""
    by: SelectionCriterion = "bic"
    """Criterion of a step: Schwarz's criterion, an F test, or held-out forces."""
    level: Annotated[quantity.Number, Field(gt=0, lt=1)] | None = None
    """Familywise level of the F tests, None for `DEFAULT_LEVEL` with `by: f`."""

    @model_validator(mode="after")
    def _check_level(self) -> SelectSection:
        if self.level is not None and self.by != "f":
            raise refusal(f"by: {self.by} has no level", "level with by: f alone", key="level")
        return self


Estimator = Literal["ls", "gm", "ml"]
SpectrumOrigin = Literal["auto", "white", "estimated"]
Estimated = Literal["all", "base"]
Estimators = Annotated[tuple[Estimator, ...], schema.at_least(1, "estimators"), schema.Distinct]
_LARGEST_HARMONICS = 500
"""ML's motion has a dense matrix with 12 variables per harmonic: 0.3 GB."""
_FIXED = "a list of parameters, or parameters with their values"
_BOUNDS = "parameters with their [min, max]"
_PRIORS = (
    "parameters with their {std: …} or {value: …, std: …}; or the run folder of an estimate, for a "
    "payload"
)


def _read_fixed(name: str, item: object) -> float | None:
    return None if item is None else parse_parameter(name, item)


def _read_bounds(name: str, item: Any) -> tuple[float, float]:
    if not isinstance(item, list | tuple) or len(item) != 2:  # noqa: PLR2004 - min and max
        raise refusal(f"{quote(item)} is not a pair", _BOUNDS)
    low, high = (parse_parameter(name, end) for end in item)
    if low >= high:
        raise refusal(f"min {low:g} is not below max {high:g}", _BOUNDS)
    return low, high


def _read_prior(name: str, item: Any) -> dict[str, float | None]:
    if not isinstance(item, dict) or not {"std"} <= set(item) <= {"value", "std"}:
        raise refusal(f"{quote(item)} does not state a prior", _PRIORS)
    std = parse_parameter(name, item["std"])
    if std <= 0:
        raise refusal(f"the standard deviation {std:g} is not positive", _PRIORS)
    return {"value": _read_fixed(name, item.get("value")), "std": std}


def _prior_kind(value: object) -> str:
    if isinstance(value, str):
        return "(name)"
    robot = isinstance(value, RobotDescription)
    return "(inline)" if robot or (isinstance(value, dict) and "home" in value) else "(names)"


class Prior(schema.Section):
    """A-priori knowledge of a parameter, in SI units; value None: the robot's."""

    value: float | None
    std: float


class EstimateSection(schema.Section):
    """Settings of the estimation."""

    estimators: Estimators = ("ls", "gm", "ml")
    differentiation: Literal["auto", "fourier", "spline", "central", "butterworth"] = "auto"
    """Method for rates and accelerations from measured lengths; ``auto``: ``spline`` for a motion
    without a period, otherwise ``fourier``."""
    harmonics: Annotated[
        int | None, *schema.word_for_none("auto", schema.whole(1, _LARGEST_HARMONICS))
    ] = None
    """Harmonics of the kinematics; None (``auto`` in the YAML): chosen from the data."""
    noise: Literal["auto", "estimated", "given"] = "auto"
    """Covariances from the scatter between periods, or those of robot and run; ``auto`` is
    ``estimated`` where the periods have 250 degrees of freedom."""
    spectrum: SpectrumOrigin = "auto"
    """Noise model in the weights of GM and ML: ``auto`` is ``estimated`` if the scatter between
    three or more periods is significantly not white."""
    systematic: Literal["auto", "estimated", "budget", "none"] = "auto"
    """Treatment of the robot's tolerances: maximum likelihood estimates the deviations, too, or
    their share is added to the covariance, as LS and GM always do; ``auto`` is ``estimated`` where
    maximum likelihood and tolerances are given."""
    frequency: Literal["known", "estimated"] = "known"
    loss: Literal["squared", "huber"] = "squared"
    """``huber`` reduces the weight of outliers."""
    consistent: bool = False
    """`identified-robot.yaml` has the nearest physically consistent parameters instead of the
    estimate itself."""
    cutoff: Annotated[quantity.Frequency, quantity.Positive] | None = None
    """Cutoff of the Butterworth filter, Hz, by default three times the highest designed one."""
    parameters: Estimated = "all"
    """``base``: the combinations that motions within the machine's limits can excite; the other
    parameters keep the robot's values."""
    fixed: Annotated[
        dict[str, float | None],
        schema.by_key(_read_fixed, _FIXED, check_parameter),
        BeforeValidator(
            lambda v: dict.fromkeys(map(check_parameter, v)) if isinstance(v, list | tuple) else v
        ),
    ] = Field(default_factory=dict)
    """Parameter → value in SI units, None for the robot's value."""
    prior: Annotated[
        Annotated[schema.FilledText, Tag("(name)")]
        | Annotated[RobotDescription, Tag("(inline)")]
        | Annotated[
            dict[str, Prior], schema.by_key(_read_prior, _PRIORS, check_parameter), Tag("(names)")
        ],
        Discriminator(_prior_kind),
    ] = Field(default_factory=dict)
    """Priors of single parameters; or the identified machine without its unknown payload: a run
    folder, its identified-robot.yaml, or the machine itself."""
    prior_from: Literal["none", "robot"] = "none"
    """`robot`: the robot file's `identification` is a prior, with its covariance."""
    bounds: Annotated[
        dict[str, tuple[float, float]], schema.by_key(_read_bounds, _BOUNDS, check_parameter)
    ] = Field(default_factory=dict)
    """Parameter → (min, max) in SI units."""
    select: SelectSection | None = None
    """Selection of further terms by the data, by default none."""

    @property
    def estimates_tolerances(self) -> bool:
        """Whether the best estimator estimates the deviations within the robot's tolerances."""
        return self.systematic in ("auto", "estimated") and "ml" in self.estimators

    @model_validator(mode="after")
    def _check_prior(self) -> EstimateSection:
        if self.prior and self.prior_from != "none":
            message = "prior and prior_from are both given"
            raise refusal(message, "one of them", key="prior_from")
        if self.parameters == "base" and not isinstance(self.prior, dict):
            message = (
                "parameters is base, but prior is a whole machine with a covariance of its single "
                "parameters"
            )
            raise refusal(message, "parameters: all, or no prior", key="parameters")
        if self.fixed and not isinstance(self.prior, dict):
            message = "fixed and the prior of a whole machine are both given"
            raise refusal(message, "prior or fixed", key="fixed")
        return self

    @model_validator(mode="after")
    def _check_spline(self) -> EstimateSection:
        for key, periodic in {
            "harmonics": self.harmonics is not None,
            "frequency": self.frequency == "estimated",
            "loss": self.loss == "huber",
            "select": self.select is not None,
        }.items():
            if self.differentiation == "spline" and periodic:
                message = f"{key} is for motions with a period, and differentiation is spline"
                raise refusal(message, f"no {key}, or differentiation: fourier", key=key)
        return self

    @property
    def pointwise(self) -> bool:
        """Whether rates and accelerations are differences between neighbouring samples."""
        return self.differentiation in ("central", "butterworth")

    @property
    def named_priors(self) -> Mapping[str, Prior]:
        """Priors of single parameters."""
        return self.prior if isinstance(self.prior, dict) else {}


MOST_REPETITIONS = 400_000
"""Four gigabytes of estimates and standard deviations."""


class MonteCarloSection(schema.Section):
    """Study of the estimators' bias, spread and coverage in repeated simulated experiments."""

    repetitions: Annotated[int, schema.whole(1, MOST_REPETITIONS)] = 400
    estimators: Estimators = ("ls", "gm", "ml")
    seed: schema.Seed = 0
    """Root seed of the random streams of all repetitions."""
