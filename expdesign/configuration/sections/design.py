"""`trajectory:`, `design:`, `motion:`: what is optimised and how, and the way in and out."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from expdesign.configuration.errors import refusal, require
from expdesign.configuration.fields import (
    Ascending,
    Distinct,
    Pair,
    Seed,
    at_least,
    one_of,
    whole,
    word_for_none,
    word_or,
)
from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.quantity import Duration, Frequency, Jerk, Positive, Speed
from expdesign.configuration.robot import RobotSource
from expdesign.configuration.section import LATER, Section
from expdesign.mechanism.terms import rigid_platform

_LARGEST_HARMONICS = 100

_MOST_SOLVES = 10_000
"""Starts, hops, iterations: days of work, whose history is kept."""

Phase = Literal["start", "best"]


class TrajectorySection(Section):
    """The family of finite Fourier series among which the design chooses."""

    harmonics: Annotated[int, whole(1, _LARGEST_HARMONICS)] = 5
    """Number n of harmonics in each of the coordinates."""
    frequency: Annotated[
        tuple[Annotated[Frequency, Positive], Annotated[Frequency, Positive]], Pair, Ascending
    ] = (0.1, 0.6)
    """Smallest and largest fundamental frequency, Hz; equal values fix it."""
    samples: Annotated[int, whole(None, None)] = 200
    """Samples per period that the information is counted over; at least 4 n + 2."""
    controller_period: Annotated[Duration, Positive] | None = None
    """Step of the machine's controller, s, of which the period becomes a whole number.
    None until the run is resolved: then one over the experiment's sampling."""

    @model_validator(mode="after")
    def _harmonics_are_resolved(self) -> TrajectorySection:
        needed = 4 * self.harmonics + 2
        if self.samples < needed:
            raise refusal(
                f"{self.samples} samples are too few for {self.harmonics} harmonics",
                f"samples ≥ 4 · harmonics + 2 = {needed}",
                key="samples",
            )
        shortest = 1 / self.frequency[1]
        if self.controller_period is not None and self.controller_period > shortest / 2:
            raise refusal(
                f"a controller period of {self.controller_period:g} s is too long for motions "
                f"of {shortest:g} s",
                f"controller_period ≤ {shortest / 2:g} s",
                key="controller_period",
            )
        return self


class MotionSection(Section):
    """How the machine gets from rest at home into the periods, and back."""

    jerk: Annotated[Jerk, Positive] | None = None
    """Largest jerk of a strut, m/s³. None: it follows from the limit of the struts' acceleration
    and from the designed motion (`expdesign.motion.ramp_problem`)."""
    phase: Annotated[Phase, one_of(Phase)] = "start"
    """Where on its orbit the designed motion is entered and left: at its t = 0, or where the
    ramps are shortest."""


CRITERIA = ("a", "condition", "d", "e")
"""The keys of `expdesign.information.criteria`, which is above this floor."""

Search = Literal["restarts", "hopping"]
Start = Literal["periodic", "rest"]
Scaling = Literal["si", "nominal"]
Base = Literal["base"]

_Judged = Annotated[
    Annotated[Base, Tag("(name)")]
    | Annotated[Annotated[tuple[ParameterName, ...], Distinct], Tag("(inline)")],
    Discriminator(lambda value: "(name)" if isinstance(value, str) else "(inline)"),
]


PAYLOAD = "payload"


def _payload(value: object) -> object:
    return [one.name for one in rigid_platform.GENERAL.parameters] if value == PAYLOAD else value


_FALLING = require(
    lambda widths: all(a > b for a, b in pairwise(widths)),
    "the widths do not fall",
    "a list from blunt to sharp, such as [0.4, 0.1]",
)


class DesignSection(Section):
    """Settings of the optimal design."""

    criterion: Annotated[str, one_of(CRITERIA)] = "d"
    starts: Annotated[int, whole(1, _MOST_SOLVES)] = 384
    """Number of random starts; the best of their rough searches go on."""
    seed: Seed = 0
    """Of the random starts and of the hops."""
    search: Annotated[Search, one_of(Search)] = "hopping"
    """Only restarts, or then hops from the best motions."""
    hops: Annotated[int, whole(0, _MOST_SOLVES)] = 800
    """Number of hops at most; without effect on restarts."""
    start: Annotated[Start, one_of(Start)] = "periodic"
    """Whether the series starts at rest (rate and acceleration zero at t = 0)."""
    scaling: Annotated[Scaling, one_of(Scaling)] = "si"
    """Of the information matrix's columns, for criteria that depend on it."""
    parameters: Annotated[
        _Judged | None,
        *word_for_none("all", word_or("base", at_least(1, "parameters"))),
        BeforeValidator(_payload),
    ] = None
    """Those that the experiment shall identify; None (``all`` in the YAML): all; ``base``: those
    that some motion within the limits shows, one for each combination; ``payload``: the ten of the
    platform."""
    prior: Annotated[RobotSource | None, LATER] = None
    """The machine as it was identified, of which `parameters` have changed since by what is
    unknown: a run folder, its identified-robot.yaml, or the machine itself. The criterion then
    judges the change, with all parameters known as far as their covariance says."""
    smoothing: (
        Annotated[tuple[Annotated[Speed, Positive], ...], at_least(1, "widths"), _FALLING] | None
    ) = None
    """Falling widths of the smoothed friction sign, m/s of the struts: the problem is solved with
    the first, then, from that solution, with the next. None until the run is resolved: then
    shares of the largest strut speed that is allowed."""
    max_iterations: Annotated[int, whole(1, _MOST_SOLVES)] = 160
    """Of each stage of a start; those of hops and of the finish have shares of it."""
    max_seconds: Annotated[Duration, Positive] | None = None
    """Time for all starts and hops, s; the finish comes on top."""

    @model_validator(mode="after")
    def _prior_of_a_change(self) -> DesignSection:
        if self.prior is not None and self.named_parameters is None:
            raise refusal(
                "a prior, and nothing that is said to have changed since",
                f"{PAYLOAD}, or the names of those that have changed",
                key="parameters",
            )
        return self

    @property
    def information(self) -> str:
        """Symbol of the matrix that is judged: ``F``, or with a prior ``S``, that of the change."""
        return "F" if self.prior is None else "S"

    @property
    def named_parameters(self) -> tuple[str, ...] | None:
        """The parameters that are named one by one, None where they are not."""
        return self.parameters if isinstance(self.parameters, tuple) else None
