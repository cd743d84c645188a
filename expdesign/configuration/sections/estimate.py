"""`estimate:` and `montecarlo:`: from recordings to parameters, and the study of estimators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from expdesign.configuration.errors import quote, refusal, require
from expdesign.configuration.fields import (
    Distinct,
    FilledText,
    Seed,
    at_least,
    by_key,
    one_of,
    whole,
    word_for_none,
)
from expdesign.configuration.parameters import FurtherTerms, check_parameter, parse_parameter
from expdesign.configuration.quantity import Frequency, Number, Positive
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.section import Section

SelectionCriterion = Literal["bic", "f", "holdout"]
_LEVEL_SHARE = require(
    lambda value: 0 < value < 1, "{value:g} is not a level of a test", "0 < level < 1, such as 0.01"
)
DEFAULT_LEVEL = 0.01


class SelectSection(Section):
    """Candidate terms for a selection by the data."""

    candidates: FurtherTerms
    """Terms in the notation of a robot file's `terms`."""
    by: Annotated[SelectionCriterion, one_of(SelectionCriterion)] = "bic"
    """Criterion of a step: Schwarz's criterion, an F test, or held-out forces."""
    level: Annotated[Number, _LEVEL_SHARE] | None = None
    """Familywise level of the F tests, None for `DEFAULT_LEVEL` with `by: f`."""

    @model_validator(mode="after")
    def _check_level(self) -> SelectSection:
        if self.level is not None and self.by != "f":
            raise refusal(f"by: {self.by} has no level", "level with by: f alone", key="level")
        return self


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
"""ML's motion has a dense matrix with 12 variables per harmonic: 0.3 GB."""
_FIXED = "a list of parameters, or parameters with their values"
_BOUNDS = "parameters with their [min, max]"
_PRIORS = (
    "parameters with their {std: …} or {value: …, std: …}; or the run folder of an estimate, for a "
    "payload"
)


def _read_fixed(name: str, item: object) -> float | None:
    return None if item is None else parse_parameter(name, item)


def _read_names(value: object) -> object:
    return {check_parameter(n): None for n in value} if isinstance(value, list | tuple) else value


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


class Prior(Section):
    """A-priori knowledge of a parameter, in SI units; value None: the robot's."""

    value: float | None
    std: float


class EstimateSection(Section):
    """Settings of the estimation."""

    estimators: Estimators = ("ls", "gm", "ml")
    differentiation: Annotated[Differentiation, one_of(Differentiation)] = "fourier"
    """Method for rates and accelerations from measured lengths."""
    harmonics: Annotated[int | None, *word_for_none("auto", whole(1, _LARGEST_HARMONICS))] = None
    """Harmonics of the kinematics; None (``auto`` in the YAML): chosen from the data."""
    noise: Annotated[NoiseOrigin, one_of(NoiseOrigin)] = "auto"
    """Covariances from the scatter between periods, or those of robot and run; ``auto`` is
    ``estimated`` where the periods have 250 degrees of freedom."""
    spectrum: Annotated[SpectrumOrigin, one_of(SpectrumOrigin)] = "auto"
    """Noise model in the weights of GM and ML: ``auto`` is ``estimated`` if the scatter between
    three or more periods is significantly not white."""
    systematic: Annotated[SystematicOrigin, one_of(SystematicOrigin)] = "budget"
    """Treatment of the robot's tolerances: their share is added to the covariance, or maximum
    likelihood estimates the deviations, too."""
    frequency: Annotated[FrequencyOrigin, one_of(FrequencyOrigin)] = "known"
    loss: Annotated[Loss, one_of(Loss)] = "squared"
    """``huber`` reduces the weight of outliers."""
    consistent: bool = False
    """`identified-robot.yaml` has the nearest physically consistent parameters instead of the
    estimate itself."""
    cutoff: Annotated[Frequency, Positive] | None = None
    """Cutoff of the Butterworth filter, Hz, by default three times the highest designed one."""
    parameters: Annotated[Estimated, one_of(Estimated)] = "all"
    """``base``: the combinations that motions within the machine's limits can excite; the other
    parameters keep the robot's values."""
    fixed: Annotated[
        dict[str, float | None],
        by_key(_read_fixed, _FIXED, check_parameter),
        BeforeValidator(_read_names),
    ] = Field(default_factory=dict)
    """Parameter → value in SI units, None for the robot's value."""
    prior: Annotated[
        Annotated[FilledText, Tag("(name)")]
        | Annotated[RobotDescription, Tag("(inline)")]
        | Annotated[
            dict[str, Prior], by_key(_read_prior, _PRIORS, check_parameter), Tag("(names)")
        ],
        Discriminator(_prior_kind),
    ] = Field(default_factory=dict)
    """Priors of single parameters; or the identified machine without its unknown payload: a run
    folder, its identified-robot.yaml, or the machine itself."""
    prior_from: Annotated[PriorOrigin, one_of(PriorOrigin)] = "none"
    """`robot`: the robot file's `identification` is a prior, with its covariance."""
    bounds: Annotated[
        dict[str, tuple[float, float]], by_key(_read_bounds, _BOUNDS, check_parameter)
    ] = Field(default_factory=dict)
    """Parameter → (min, max) in SI units."""
    select: SelectSection | None = None
    """Selection of further terms by the data, by default none."""

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

    @property
    def named_priors(self) -> Mapping[str, Prior]:
        """Priors of single parameters."""
        return self.prior if isinstance(self.prior, dict) else {}


MOST_REPETITIONS = 400_000
"""Four gigabytes of estimates and standard deviations."""


class MonteCarloSection(Section):
    """Study of the estimators' bias, spread and coverage in repeated simulated experiments."""

    repetitions: Annotated[int, whole(1, MOST_REPETITIONS)] = 400
    estimators: Estimators = ("ls", "gm", "ml")
    seed: Seed = 0
    """Root seed of the random streams of all repetitions."""
