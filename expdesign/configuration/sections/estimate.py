"""`estimate:` and `montecarlo:`, from measured data to parameters, once or for many experiments."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from expdesign.configuration.parameters import known_parameter, parsed_parameter
from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import Distinct, at_least
from expdesign.configuration.values.quantity import Frequency, Positive
from expdesign.configuration.values.scalars import (
    Seed,
    by_key,
    one_of,
    whole,
    word_for_none,
)

Estimator = Literal["ls", "gm", "ml"]
Differentiation = Literal["fourier", "central", "butterworth"]
NoiseOrigin = Literal["auto", "estimated", "given"]
FrequencyOrigin = Literal["known", "estimated"]
Loss = Literal["squared", "huber"]

Estimators = Annotated[
    tuple[Annotated[Estimator, one_of(Estimator)], ...], at_least(1, "estimators"), Distinct
]

_LARGEST_HARMONICS = 10_000
_LARGEST_REPETITIONS = 10_000_000
_FIXED = "a list of parameters, or parameters with their values"
_BOUNDS = "parameters with their [min, max]"
_PRIORS = "parameters with their {std: …} or {value: …, std: …}"


def _fixed(name: str, item: object) -> float | None:
    known_parameter(name)
    return None if item is None else parsed_parameter(name, item)


def _names_alone(value: object) -> object:
    return {known_parameter(n): None for n in value} if isinstance(value, list | tuple) else value


def _bounds(name: str, item: Any) -> tuple[float, float]:
    known_parameter(name)
    if not isinstance(item, list | tuple) or len(item) != 2:  # noqa: PLR2004 - min and max
        raise refusal(f"{shown(item)} is no pair", _BOUNDS)
    low, high = (parsed_parameter(name, end) for end in item)
    if low >= high:
        raise refusal(f"min {low:g} is not below max {high:g}", _BOUNDS)
    return low, high


def _prior(name: str, item: Any) -> dict[str, float | None]:
    known_parameter(name)
    if not isinstance(item, dict) or not {"std"} <= set(item) <= {"value", "std"}:
        raise refusal(f"{shown(item)} does not state a prior", _PRIORS)
    std = parsed_parameter(name, item["std"])
    if std <= 0:
        raise refusal(f"the standard deviation {std:g} is not positive", _PRIORS)
    return {"value": _fixed(name, item.get("value")), "std": std}


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
    ``estimated`` from three periods on."""
    frequency: Annotated[FrequencyOrigin, one_of(FrequencyOrigin)] = "known"
    loss: Annotated[Loss, one_of(Loss)] = "squared"
    """``huber`` lets outliers count less."""
    cutoff: Annotated[Frequency, Positive] | None = None
    """Of the Butterworth filter, Hz; None: three times the highest frequency of the design."""
    fixed: Annotated[
        dict[str, float | None],
        by_key(_fixed, _FIXED),
        BeforeValidator(_names_alone),
    ] = Field(default_factory=dict)
    """Parameter → value in SI units, None for the robot's value."""
    prior: Annotated[
        dict[str, Prior],
        by_key(_prior, _PRIORS),
    ] = Field(default_factory=dict)
    bounds: Annotated[dict[str, tuple[float, float]], by_key(_bounds, _BOUNDS)] = Field(
        default_factory=dict
    )
    """Parameter → (min, max) in SI units."""


class MonteCarloSection(Section):
    """Study of the estimators' bias, spread and coverage in repeated simulated experiments."""

    repetitions: Annotated[int, whole(1, _LARGEST_REPETITIONS)] = 400
    estimators: Estimators = ("ls", "gm", "ml")
    seed: Seed = 0
    """From which the random stream of every repetition is spawned."""
