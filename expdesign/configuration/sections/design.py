"""`trajectory:`, `design:` and `motion:`: family of motions, optimisation, lead-in and lead-out."""

from __future__ import annotations

from importlib import import_module
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
from expdesign.configuration.section import Section
from expdesign.mechanism.terms import rigid_platform

_LARGEST_HARMONICS = 100
_MOST_SAMPLES = 20_000

_MOST_SOLVES = 10_000
"""Largest number of starts, hops or iterations: days of work."""

Phase = Literal["start", "best"]


class TrajectorySection(Section):
    """The family of finite Fourier series for the design."""

    harmonics: Annotated[int, whole(1, _LARGEST_HARMONICS)] = 5
    """Number n of harmonics in each coordinate."""
    frequency: Annotated[
        tuple[Annotated[Frequency, Positive], Annotated[Frequency, Positive]], Pair, Ascending
    ] = (0.1, 0.6)
    """Smallest and largest fundamental frequency, Hz; equal values fix it."""
    samples: Annotated[int, whole(1, _MOST_SAMPLES)] = 200
    """Samples per period for the information matrix; at least 4 n + 2."""
    controller_period: Annotated[Duration, Positive] | None = None
    """Step of the machine's controller, s; the period becomes a multiple of it. None until the run
    is resolved: then one over the experiment's sampling."""

    @model_validator(mode="after")
    def _check_resolution(self) -> TrajectorySection:
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
    """Lead-in from rest at home into the periods, and lead-out back to rest."""

    jerk: Annotated[Jerk, Positive] | None = None
    """Largest jerk of a strut, m/s³, by default from the limit of the struts' acceleration and the
    designed motion."""
    phase: Annotated[Phase, one_of(Phase)] = "start"
    """Transition between ramps and designed motion: at its t = 0, or where the ramps are
    shortest."""


def criterion_keys() -> tuple[str, ...]:
    """Return the keys of the criteria, also those of plug-ins.

    Examples
    --------
    >>> criterion_keys()
    ('a', 'condition', 'd', 'e')
    """
    return tuple(import_module("expdesign.information.criteria").criteria())


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


def _read_payload(value: object) -> object:
    return [one.name for one in rigid_platform.GENERAL.parameters] if value == PAYLOAD else value


_FALLING = require(
    lambda widths: all(a > b for a, b in pairwise(widths)),
    "the widths do not fall",
    "a list from blunt to sharp, such as [0.4, 0.1]",
)


class DesignSection(Section):
    """Settings of the optimal design."""

    criterion: Annotated[str, one_of(criterion_keys)] = "d"
    starts: Annotated[int, whole(1, _MOST_SOLVES)] = 384
    """Number of random starts; the search continues from the best of them."""
    seed: Seed = 0
    """Seed of the random starts and hops."""
    search: Annotated[Search, one_of(Search)] = "hopping"
    """Random starts only, or followed by hops from the best motions."""
    hops: Annotated[int, whole(0, _MOST_SOLVES)] = 800
    """Largest number of hops; without effect on restarts."""
    start: Annotated[Start, one_of(Start)] = "periodic"
    """``rest``: rate and acceleration of the series are zero at t = 0."""
    scaling: Annotated[Scaling, one_of(Scaling)] = "si"
    """Scaling of the information matrix's columns, for criteria that depend on it."""
    parameters: Annotated[
        _Judged | None,
        *word_for_none("all", word_or("base", at_least(1, "parameters"))),
        BeforeValidator(_read_payload),
    ] = None
    """Parameters for the experiment to identify; None (``all`` in the YAML): all; ``base``: the
    combinations that motions within the limits can excite; ``payload``: the ten of the platform."""
    prior: RobotSource | None = None
    """Identified machine before an unknown change of `parameters`: a run folder, its
    identified-robot.yaml, or the machine itself. The criterion then judges the change, with the
    covariance of all parameters as prior knowledge."""
    smoothing: (
        Annotated[tuple[Annotated[Speed, Positive], ...], at_least(1, "widths"), _FALLING] | None
    ) = None
    """Falling widths of the smoothed friction sign, m/s of the struts: each solution is the start
    of the next problem. None until the run is resolved: then shares of the largest allowed strut
    speed."""
    max_iterations: Annotated[int, whole(1, _MOST_SOLVES)] = 160
    """Iterations in each phase of a start; hops and finish have shares of them."""
    max_seconds: Annotated[Duration, Positive] | None = None
    """Time for all starts and hops, s, without the finish."""

    @model_validator(mode="after")
    def _check_prior(self) -> DesignSection:
        if self.prior is not None and self.named_parameters is None:
            raise refusal(
                "a prior is given without the parameters that have changed since",
                f"{PAYLOAD}, or the names of the changed parameters",
                key="parameters",
            )
        return self

    @property
    def information(self) -> str:
        """Symbol of the judged matrix: ``F``, or ``S`` for the change since a prior."""
        return "F" if self.prior is None else "S"

    @property
    def named_parameters(self) -> tuple[str, ...] | None:
        """Parameters with their names, None for all or the base parameters."""
        return self.parameters if isinstance(self.parameters, tuple) else None
