"""`trajectory:`, `motion:`, `design:`, `sweep:`: motions, their optimisation, grids of designs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib import import_module
from itertools import pairwise
from math import prod
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag, model_validator
from pydantic.fields import FieldInfo

from constraints import limit_definitions
from expdesign.configuration.errors import nearest_name, quote, refusal, require
from expdesign.configuration.experiment import ExperimentSection, Motion, ValidationMotion
from expdesign.configuration.limits import CHARACTERISTIC_LENGTH, RESERVE
from expdesign.configuration.parameters import ParameterName
from expdesign.configuration.quantity import (
    NUMBER,
    Duration,
    Frequency,
    Jerk,
    Positive,
    Quantity,
    Speed,
)
from expdesign.configuration.robot import RobotSource
from expdesign.configuration.schema import (
    Ascending,
    Distinct,
    FilledText,
    Pair,
    Section,
    Seed,
    at_least,
    by_key,
    one_of,
    whole,
    word_for_none,
    word_or,
)
from expdesign.mechanism.terms import known_parameters, rigid_platform

_LARGEST_HARMONICS = 100
_MOST_SAMPLES = 20_000
_MOST_MOTIONS = 20
_MOST_SOLVES = 10_000
"""Largest number of starts, hops or iterations: days of work."""


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

    count: Annotated[int, whole(1, _MOST_MOTIONS)] = 1
    """Number of motions that share the measuring time; each has its own run folder."""

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
    phase: Literal["start", "best"] = "start"
    """Transition between ramps and designed motion: at its t = 0, or at the phase with the shortest
    ramps."""


def criterion_keys() -> tuple[str, ...]:
    """Return the keys of the criteria, also those of plug-ins.

    Examples
    --------
    >>> criterion_keys()
    ('a', 'condition', 'd', 'e')
    """
    return tuple(import_module("expdesign.information.criteria").criteria())


Scaling = Literal["si", "nominal"]
_Judged = Annotated[
    Annotated[Literal["base"], Tag("(name)")]
    | Annotated[Annotated[tuple[ParameterName, ...], Distinct], Tag("(inline)")],
    Discriminator(lambda value: "(name)" if isinstance(value, str) else "(inline)"),
]
DERIVED = ("mass", "centre", "inertia", "motor_inertia", "gravity")
"""Groups of derived quantities for `DesignSection.interest`."""


def _interest_names() -> tuple[str, ...]:
    return (*known_parameters(), *DERIVED)


def _read_task(value: object) -> object:
    if not isinstance(value, str):
        return value
    if value in get_args(Motion):
        return {"motion": value}
    return {"motion": "file", "file": value}


class TaskSection(Section):
    """A task of the machine, whose forces are to be predicted."""

    task: Annotated[ValidationMotion, BeforeValidator(_read_task)]
    """A motion as in `validate`; ``circle`` alone is the one by default, another text is the run
    folder or `design.json` with the motion."""


_Interest = Annotated[
    Annotated[
        tuple[Annotated[str, one_of(_interest_names, "quantity of interest")], ...],
        Distinct,
        Tag("(names)"),
    ]
    | Annotated[TaskSection, Tag("(inline)")],
    Discriminator(lambda value: "(names)" if isinstance(value, list | tuple) else "(inline)"),
]
_Priors = Annotated[
    Annotated[RobotSource, Tag("(inline)")]
    | Annotated[tuple[RobotSource, ...], at_least(1, "priors"), Tag("(names)")],
    Discriminator(lambda value: "(names)" if isinstance(value, list | tuple) else "(inline)"),
]
PAYLOAD = "payload"
_PLATFORM = [parameter.name for parameter in rigid_platform.GENERAL.parameters]


_FALLING = require(
    lambda widths: all(a > b for a, b in pairwise(widths)),
    "the widths do not fall",
    "a list from blunt to sharp, such as [0.4, 0.1]",
)


class Effort(NamedTuple):
    """Size of a search."""

    starts: int
    hops: int


EFFORTS = {
    "quick": Effort(starts=8, hops=0),
    "normal": Effort(starts=24, hops=80),
    "thorough": Effort(starts=384, hops=800),
}
"""Sizes of searches by the values of `design.effort`."""


class DesignSection(Section):
    """Settings of the optimal design."""

    criterion: Annotated[str, one_of(criterion_keys)] = "d"
    effort: Literal["quick", "normal", "thorough"] = "normal"
    """Size of the search: `EFFORTS` has the starts and hops that are not given themselves."""
    starts: Annotated[int, whole(1, _MOST_SOLVES)] = EFFORTS["normal"].starts
    """Number of random starts; the search continues from the best of them."""
    seed: Seed = 0
    """Seed of the random starts and hops."""
    search: Literal["restarts", "hopping"] = "hopping"
    """Random starts only, or followed by hops from the best motions."""
    hops: Annotated[int, whole(0, _MOST_SOLVES)] = EFFORTS["normal"].hops
    """Largest number of hops; without effect on restarts. Those of the normal effort end when they
    are expected to gain too little."""
    start: Literal["periodic", "rest"] = "periodic"
    """``rest``: rate and acceleration of the series are zero at t = 0."""
    scaling: Scaling = "si"
    """Scaling of the information matrix's columns, for criteria that depend on it."""
    parameters: Annotated[
        _Judged | None,
        *word_for_none("all", word_or("base", at_least(1, "parameters"))),
        BeforeValidator(lambda value: _PLATFORM if value == PAYLOAD else value),
    ] = None
    """Parameters for the experiment to identify; None (``all`` in the YAML): all; ``base``: the
    combinations that motions within the limits can excite; ``payload``: the ten of the platform."""
    known: Annotated[tuple[ParameterName, ...], Distinct] = ()
    """Parameters that are known; all others are unknown."""
    interest: Annotated[
        _Interest | None,
        *word_for_none("all", BeforeValidator(lambda value: value)),
    ] = None
    """Quantities that the criterion judges, while the other unknown parameters are nuisances:
    parameters, groups of derived quantities (``mass``, ``centre``, ``inertia``, ``motor_inertia``,
    ``gravity``), or the forces along a task, by their mean variance (criterion ``a``). None
    (``all`` in the YAML): all unknown parameters."""
    prior: _Priors | None = None
    """Earlier estimates of the machine: run folders, their identified-robot.yaml, or the machines
    themselves, of different recordings. The criterion then judges the recordings together. With
    `parameters` it is one machine before an unknown change of these: the criterion judges the
    change, with the covariance of all parameters as prior knowledge."""
    others: Annotated[tuple[FilledText, ...], Distinct] = ()
    """Other motions of the same experiment, run folders or files `design.json`: the criterion is
    that of all recordings together, each as long as this one."""
    counts: Literal["total", "noise"] = "total"
    """Errors in the criterion: ``total``, also those of the robot's tolerances, as the run's
    estimator treats them; or the noise alone. Without tolerances both are the same."""
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

    @model_validator(mode="before")
    @classmethod
    def _fill_size(cls, data: Any) -> Any:
        """Fill in the starts and hops that the effort implies; stated ones have precedence."""
        effort = data.get("effort", "normal") if isinstance(data, dict) else None
        if not (isinstance(effort, str) and effort in EFFORTS):
            return data
        return {**EFFORTS[effort]._asdict(), **data}

    @model_validator(mode="after")
    def _check_prior(self) -> DesignSection:
        if self.is_change and len(self.priors) != 1:
            raise refusal(
                f"{len(self.priors)} priors are given for the change of design.parameters since "
                "one of them",
                "one prior, or no parameters: the machine has not changed",
                key="prior",
            )
        return self

    @model_validator(mode="after")
    def _check_interest(self) -> DesignSection:
        if self.known and self.parameters is not None:
            raise refusal(
                "design.parameters holds all others as known: it excludes design.known",
                "one of the two",
                key="known",
            )
        if self.interest is None:
            return self
        if self.parameters is not None:
            raise refusal(
                "design.parameters states its own quantities of interest",
                "interest without parameters",
                key="interest",
            )
        if self.interest == ():
            raise refusal("nothing is of interest", "all, or at least one name", key="interest")
        if isinstance(self.interest, TaskSection) and self.criterion != "a":
            raise refusal(
                "the forces along a task are judged by their mean variance",
                "criterion: a",
                key="criterion",
            )
        return self

    @property
    def motion_files(self) -> tuple[str, ...]:
        """Files of the experiment's other motions, and of the motion of a task."""
        task = self.interest.task.file if isinstance(self.interest, TaskSection) else None
        return (*self.others, *([task] if task else ()))

    @property
    def information(self) -> str:
        """Symbol of the judged matrix: ``F``, or ``S`` with a prior."""
        return "F" if self.prior is None else "S"

    @property
    def priors(self) -> tuple[RobotSource, ...]:
        """Earlier estimates of the machine."""
        if self.prior is None:
            return ()
        return self.prior if isinstance(self.prior, tuple) else (self.prior,)

    @property
    def weighs_gain(self) -> bool:
        """Whether hops end when they are expected to gain too little; stated ones are all made."""
        return self.effort == "normal" and self.hops == EFFORTS["normal"].hops

    @property
    def is_change(self) -> bool:
        """Whether the criterion judges the change of `parameters` since a prior."""
        return self.prior is not None and self.named_parameters is not None

    @property
    def interesting_parameters(self) -> tuple[str, ...]:
        """Parameters among the quantities of interest, by their names."""
        named = self.interest if isinstance(self.interest, tuple) else ()
        return tuple(name for name in named if name not in DERIVED)

    @property
    def named_parameters(self) -> tuple[str, ...] | None:
        """Parameters with their names, None for all or the base parameters."""
        return self.parameters if isinstance(self.parameters, tuple) else None


MOST_DESIGNS = 200
"""Largest number of designs in one sweep: days of work."""
LIMITS = "limits"
SCALE = "scale"
"""Last part of a path with factors of a limit's bounds instead of bounds."""
EFFORT = "design.effort"
FREQUENCY = "trajectory.frequency"
"""Path for which one value means two equal bounds."""
_SECTIONS: dict[str, tuple[type[Section], tuple[str, ...]]] = {
    "trajectory": (
        TrajectorySection,
        tuple(key for key in TrajectorySection.model_fields if key != "count"),
    ),
    "design": (DesignSection, tuple(DesignSection.model_fields)),
    "experiment": (ExperimentSection, ("periods", "sampling")),
}
"""Sections and keys that a design depends on."""
_ALLOWED = (
    "trajectory.KEY, design.KEY, experiment.periods, experiment.sampling, limits.KEY, "
    f"limits.KEY.COMPONENT, limits.KEY.{SCALE}"
)
_values: Callable[..., Any] = at_least(1, "values", MOST_DESIGNS).func


@cache
def path_units() -> dict[str, str]:
    """Return the key paths for sweeps, with the unit of their plain numbers.

    The unit is ``"1"`` for pure numbers, and empty for texts.

    Examples
    --------
    >>> path_units()["trajectory.frequency"]
    'Hz'
    """
    found = {
        f"{name}.{key}": _unit(section.model_fields[key])
        for name, (section, keys) in _SECTIONS.items()
        for key in keys
    }
    for key, definition in limit_definitions().items():
        place = f"{LIMITS}.{key}"
        found[place] = definition.unit
        found |= {f"{place}.{component}": definition.unit for component in definition.components}
        found[f"{place}.{SCALE}"] = "1"
    return found | {f"{LIMITS}.{CHARACTERISTIC_LENGTH}": "m", f"{LIMITS}.{RESERVE}": "1"}


def _unit(info: FieldInfo) -> str:
    """Return the unit of a key's plain numbers."""
    parts = [*_parts(info.annotation), *info.metadata]
    units = [part.unit for part in parts if isinstance(part, Quantity)]
    return units[0] if units else "1" if any(part in (int, float) for part in parts) else ""


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the types and annotations inside a type."""
    for part in get_args(annotation):
        yield from _parts(part)
    yield annotation


def _read_values(path: str, value: object) -> tuple[Any, ...]:
    """Return the values of a path."""
    valid = path_units()
    if path not in valid:
        raise refusal(
            f"unknown key path {quote(path)}", _ALLOWED, partial(nearest_name, path, valid)
        )
    values = tuple(_values(value))
    texts = [json.dumps(one, sort_keys=True, default=repr) for one in values]
    for number, text in enumerate(texts):
        if text in texts[:number]:
            raise refusal(f"{quote(values[number])} is listed twice", "each one once")
    if is_scale(path):
        for one in values:
            if NUMBER.parse(one) <= 0:
                raise refusal(f"the factor {quote(one)} is not positive", "factors above 0")
    return values


def is_scale(path: str) -> bool:
    """Return True for a path with factors of a limit's bounds."""
    return path.startswith(f"{LIMITS}.") and path.endswith(f".{SCALE}")


def _check_grid(paths: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    """Refuse overlapping paths and a grid that is too large."""
    if not paths:
        raise refusal("the sweep names no key", f"key paths with lists of values: {_ALLOWED}")
    for path in paths:
        for other in paths:
            # A scale changes all of its limit, as does the limit itself.
            whole, part = (one.removesuffix(f".{SCALE}") for one in (path, other))
            if other != path and (part == whole or part.startswith(f"{whole}.")):
                raise refusal(f"it overlaps with {path}", "one of the two", key=other)
    count = prod(len(values) for values in paths.values())
    if count > MOST_DESIGNS:
        sizes = " · ".join(str(len(values)) for values in paths.values())
        message = f"{sizes} = {count} designs" if len(paths) > 1 else f"{count} designs"
        raise refusal(f"the grid has {message}", f"{MOST_DESIGNS} designs at most")
    return paths


def _read_goal(_name: str, value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise refusal(f"{quote(value)} is no standard deviation", "1 %, or 5 mm")
    return value


Goals = Annotated[
    dict[str, Any], by_key(_read_goal, "quantities with standard deviations, such as mass: 1 %")
]
"""Wanted standard deviations, in the user's notation."""

Sweep = Annotated[
    dict[str, tuple[Any, ...]],
    by_key(_read_values, "key paths with lists of values"),
    AfterValidator(_check_grid),
]
"""Key paths with their values, in the user's notation."""
