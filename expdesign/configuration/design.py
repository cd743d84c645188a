"""`design:`, what is optimised and how the optimum is searched for."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, field_serializer

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal, shown
from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.quantity import Duration, Positive, Speed
from expdesign.configuration.scalars import Distinct, Seed, at_least, one_of, whole

# A criterion is a file of its name; listing the files keeps this schema free of imports.
_CRITERIA_FOLDER = Path(__file__).parents[1] / "information" / "criteria"
CRITERIA = tuple(
    sorted(file.stem for file in _CRITERIA_FOLDER.glob("*.py") if not file.stem.startswith("_"))
)
Search = Literal["restarts", "hopping"]
Start = Literal["periodic", "rest"]
Scaling = Literal["si", "nominal"]

_LARGEST_COUNT = 100_000


def _all_or_names(value: object) -> Any:
    if value == "all" and isinstance(value, str):
        return None
    if not isinstance(value, list | tuple):
        raise refusal(f"{shown(value)} is no choice of parameters", "all, or a list of names")
    return value


def _falling(widths: tuple[float, ...]) -> tuple[float, ...]:
    if any(a <= b for a, b in pairwise(widths)):
        raise refusal("the widths do not fall", "a list from blunt to sharp, such as [0.4, 0.1]")
    return widths


class DesignSection(Section):
    """Settings of the optimal design.

    Attributes
    ----------
    criterion : str
        One of `CRITERIA`: ``d``, ``a``, ``e``, ``condition``, and what an expert adds.
    starts : int
        Number of random starts.
    seed : int
        Of the random starts and of the hops.
    search : {"restarts", "hopping"}
        Only restarts, or then hops from the best motions, and new starts, in turn.
    hops : int
        Number of hops, of which every second is a new random start; without effect on restarts.
    start : {"periodic", "rest"}
        Whether the series starts at rest (rate and acceleration zero at t = 0).
    scaling : {"si", "nominal"}
        Columns of the information matrix for criteria that depend on it.
    parameters : tuple of str or None
        The parameters that the experiment shall identify; None (``all`` in the YAML): all.
    smoothing : tuple of float or None
        Falling widths of the smoothed friction sign, a strut speed in m/s: the problem is
        solved with the first, then, from that solution, with the next. None until the
        configuration is resolved: then shares of the largest strut speed that is allowed.
    max_iterations : int
        Of each smoothing width, within one start.
    max_seconds : float or None
        Time for all starts, s.
    """

    criterion: Annotated[str, one_of(CRITERIA)] = "d"
    starts: Annotated[int, whole(1, _LARGEST_COUNT)] = 8
    seed: Seed = 0
    search: Annotated[Search, one_of(Search)] = "restarts"
    hops: Annotated[int, whole(0, _LARGEST_COUNT)] = 100
    start: Annotated[Start, one_of(Start)] = "periodic"
    scaling: Annotated[Scaling, one_of(Scaling)] = "si"
    parameters: Annotated[
        Annotated[tuple[ParameterName, ...], at_least(1, "parameters"), Distinct] | None,
        BeforeValidator(_all_or_names),
    ] = None
    smoothing: (
        Annotated[
            tuple[Annotated[Speed, Positive], ...], at_least(1, "widths"), AfterValidator(_falling)
        ]
        | None
    ) = None
    max_iterations: Annotated[int, whole(1, _LARGEST_COUNT)] = 80
    max_seconds: Annotated[Duration, Positive] | None = None

    @field_serializer("parameters")
    def _all(self, parameters: tuple[str, ...] | None) -> list[str] | str:
        return "all" if parameters is None else list(parameters)
