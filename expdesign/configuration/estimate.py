"""`estimate:`, from measured data to parameters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_serializer
from pydantic_core import PydanticCustomError

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal, shown
from expdesign.configuration.parameters import known_parameter, parsed_parameter
from expdesign.configuration.quantity import Frequency, Positive
from expdesign.configuration.scalars import Distinct, at_least, one_of

Estimator = Literal["ls", "gm", "ml"]
Differentiation = Literal["fourier", "central", "butterworth"]
NoiseSource = Literal["auto", "estimated", "given"]
FrequencySource = Literal["known", "estimated"]
Loss = Literal["squared", "huber"]

Estimators = Annotated[
    tuple[Annotated[Estimator, one_of(Estimator)], ...], at_least(1, "estimators"), Distinct
]

_LARGEST_HARMONICS = 10_000


def _auto_or_count(value: object) -> Any:
    allowed = f"auto, or a whole number from 1 to {_LARGEST_HARMONICS}"
    if isinstance(value, str) and value == "auto":
        return None
    if isinstance(value, bool) or not isinstance(value, int):
        raise refusal(f"{shown(value)} is no number of harmonics", allowed)
    if not 1 <= value <= _LARGEST_HARMONICS:
        raise refusal(f"{shown(value)} is out of range", allowed)
    return value


def _parsed(name: str, value: object) -> float:
    try:
        return parsed_parameter(name, value)
    except PydanticCustomError as error:
        context = error.context or {}
        raise refusal(error.message(), context["allowed"], key=name) from None


def _by_parameter(value: object, wanted: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise refusal(f"{shown(value)} is not a mapping", wanted)
    return {known_parameter(name): item for name, item in value.items()}


def _fixed(value: object) -> dict[str, float | None]:
    wanted = "a list of parameters, or parameters with their values"
    if isinstance(value, list | tuple):
        return {known_parameter(name): None for name in value}
    return {
        name: None if item is None else _parsed(name, item)
        for name, item in _by_parameter(value, wanted).items()
    }


def _bounds(value: object) -> dict[str, tuple[float, float]]:
    wanted = "parameters with their [min, max]"
    bounds: dict[str, tuple[float, float]] = {}
    for name, item in _by_parameter(value, wanted).items():
        if not isinstance(item, list | tuple) or len(item) != 2:  # noqa: PLR2004 - min and max
            raise refusal(f"{shown(item)} is no pair", wanted, key=name)
        low, high = (_parsed(name, end) for end in item)
        if low >= high:
            raise refusal(f"min {low:g} is not below max {high:g}", wanted, key=name)
        bounds[name] = (low, high)
    return bounds


def _prior(value: object) -> dict[str, dict[str, float | None]]:
    wanted = "parameters with their {std: …} or {value: …, std: …}"
    priors: dict[str, dict[str, float | None]] = {}
    for name, item in _by_parameter(value, wanted).items():
        if not isinstance(item, dict) or not {"std"} <= set(item) <= {"value", "std"}:
            raise refusal(f"{shown(item)} does not state a prior", wanted, key=name)
        std = _parsed(name, item["std"])
        if std <= 0:
            raise refusal(f"the standard deviation {std:g} is not positive", wanted, key=name)
        given = item.get("value")
        priors[name] = {"value": None if given is None else _parsed(name, given), "std": std}
    return priors


class Prior(Section):
    """A-priori knowledge that enters the estimate, in SI units.

    Attributes
    ----------
    value : float or None
        None: the robot's value.
    std : float
        Its standard deviation.
    """

    value: float | None
    std: float


class EstimateSection(Section):
    """Settings of the estimation.

    Attributes
    ----------
    estimators : tuple of {"ls", "gm", "ml"}
    differentiation : {"fourier", "central", "butterworth"}
        How rates and accelerations come from measured lengths.
    harmonics : int or None
        Of the kinematics; None (``auto`` in the YAML): chosen from the data.
    noise : {"auto", "estimated", "given"}
        Covariances from the scatter between periods, or those of robot and run; ``auto`` is
        ``estimated`` from three periods on.
    frequency : {"known", "estimated"}
    loss : {"squared", "huber"}
        ``huber`` lets outliers count less.
    cutoff : float or None
        Of the Butterworth filter, Hz; None: three times the highest frequency of the design.
    fixed : dict
        Parameter → value in SI units, None for the robot's value.
    prior : dict
        Parameter → `Prior` in SI units.
    bounds : dict
        Parameter → (min, max) in SI units.
    """

    estimators: Estimators = ("ls", "gm", "ml")
    differentiation: Annotated[Differentiation, one_of(Differentiation)] = "fourier"
    harmonics: Annotated[int | None, BeforeValidator(_auto_or_count)] = None
    noise: Annotated[NoiseSource, one_of(NoiseSource)] = "auto"
    frequency: Annotated[FrequencySource, one_of(FrequencySource)] = "known"
    loss: Annotated[Loss, one_of(Loss)] = "squared"
    cutoff: Annotated[Frequency, Positive] | None = None
    fixed: Annotated[dict[str, float | None], BeforeValidator(_fixed)] = Field(default_factory=dict)
    prior: Annotated[dict[str, Prior], BeforeValidator(_prior)] = Field(default_factory=dict)
    bounds: Annotated[dict[str, tuple[float, float]], BeforeValidator(_bounds)] = Field(
        default_factory=dict
    )

    @field_serializer("harmonics")
    def _auto(self, harmonics: int | None) -> int | str:
        return "auto" if harmonics is None else harmonics
