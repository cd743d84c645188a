"""`design:`, what is optimised and how the optimum is searched for."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator

from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.problem import refusal
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import Distinct, at_least
from expdesign.configuration.values.quantity import Duration, Positive, Speed
from expdesign.configuration.values.scalars import Count, Seed, one_of, whole, word_for_none

CRITERIA = ("a", "condition", "d", "e")
"""The keys of `expdesign.information.criteria`, which is above this floor."""

Search = Literal["restarts", "hopping"]
Start = Literal["periodic", "rest"]
Scaling = Literal["si", "nominal"]


def _falling(widths: tuple[float, ...]) -> tuple[float, ...]:
    if any(a <= b for a, b in pairwise(widths)):
        raise refusal("the widths do not fall", "a list from blunt to sharp, such as [0.4, 0.1]")
    return widths


class DesignSection(Section):
    """Settings of the optimal design."""

    criterion: Annotated[str, one_of(CRITERIA)] = "d"
    starts: Count = 8
    """Number of random starts."""
    seed: Seed = 0
    """Of the random starts and of the hops."""
    search: Annotated[Search, one_of(Search)] = "restarts"
    """Only restarts, or then hops from the best motions, and new starts, in turn."""
    hops: Annotated[int, whole(0)] = 100
    """Number of hops, of which every second is a new start; without effect on restarts."""
    start: Annotated[Start, one_of(Start)] = "periodic"
    """Whether the series starts at rest (rate and acceleration zero at t = 0)."""
    scaling: Annotated[Scaling, one_of(Scaling)] = "si"
    """Of the information matrix's columns, for criteria that depend on it."""
    parameters: Annotated[
        Annotated[tuple[ParameterName, ...], Distinct] | None,
        *word_for_none("all", at_least(1, "parameters")),
    ] = None
    """Those that the experiment shall identify; None (``all`` in the YAML): all."""
    smoothing: (
        Annotated[
            tuple[Annotated[Speed, Positive], ...], at_least(1, "widths"), AfterValidator(_falling)
        ]
        | None
    ) = None
    """Falling widths of the smoothed friction sign, m/s of the struts: the problem is solved with
    the first, then, from that solution, with the next. None until the run is resolved: then
    shares of the largest strut speed that is allowed."""
    max_iterations: Count = 80
    """Of each smoothing width, within one start."""
    max_seconds: Annotated[Duration, Positive] | None = None
    """Time for all starts, s."""
