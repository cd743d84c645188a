"""`estimate:` and `montecarlo:`: from recordings to parameters, and the study of estimators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from expdesign.configuration.errors import refusal, require, shown
from expdesign.configuration.fields import (
    Distinct,
    FilledText,
    Seed,
    Sized,
    at_least,
    by_key,
    one_of,
    whole,
    word_for_none,
)
from expdesign.configuration.parameters import FurtherTerms, known_parameter, parsed_parameter
from expdesign.configuration.quantity import Frequency, Number, Positive
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.section import LATER, Section

SelectionCriterion = Literal["bic", "f", "holdout"]
_LEVEL_SHARE = require(
    lambda value: 0 < value < 1, "{value:g} is no level of a test", "0 < level < 1, such as 0.01"
)
DEFAULT_LEVEL = 0.01


class SelectSection(Section):
    """Terms that the robot may lack, of which the data choose."""

    candidates: FurtherTerms
    """As in a robot file's `terms`."""
    by: Annotated[SelectionCriterion, one_of(SelectionCriterion)] = "bic"
    """What judges a step: Schwarz's criterion, an F test, or forces that were not fitted."""
    level: Annotated[Number, _LEVEL_SHARE] | None = None
    """Of the F tests: how often one of all candidates enters though none belongs there; None:
    `DEFAULT_LEVEL`, where `by` is `f`."""

    @model_validator(mode="after")
    def _level_of_a_test(self) -> SelectSection:
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
