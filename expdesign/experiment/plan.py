"""The measuring time for wanted precisions: periods, minutes, and the obstacles.

The standard deviation of a quantity falls with the number of periods to a floor that the tolerances
of the machine make. A goal below its floor needs smaller tolerances.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic_core import PydanticCustomError
from scipy.optimize import bisect

from constraints.arrays import Array
from expdesign.configuration import ComputationError, InputError, RunConfiguration
from expdesign.configuration.design import DERIVED
from expdesign.configuration.errors import nearest_name, quote
from expdesign.configuration.quantity import quantity_in
from expdesign.experiment.judging import earlier_recordings, noise_evaluator
from expdesign.experiment.precision import (
    ToleranceEffects,
    derived_precisions,
    experiment_information,
    experiment_tolerance_effects,
)
from expdesign.experiment.result import DesignResult, ParameterPrecision
from expdesign.experiment.sensitivity import sensitivity_at_design
from expdesign.experiment.setup import plan_search
from expdesign.information import fisher
from expdesign.mechanism.terms import parameter_unit
from expdesign.recheck.evaluator import Evaluator
from expdesign.robot.derived import (
    ALONE,
    NOISE,
    ErrorShares,
    KnownQuantity,
    belongs_to,
    derived_quantities,
)
from expdesign.robot.deviation import toleranced_deviations
from expdesign.runfolder import OpenNumber, StageResult, Table, described
from expdesign.trajectory import FourierTrajectory

LONGEST_DAYS = 30
"""Longest planned measuring time. Estimated tolerances have no other floor: years of data show even
the least combination of them."""
_DAY = 24 * 3600
_CURVE = 25
"""Number of points of a curve."""
_HALF = math.sqrt(0.5)
"""Share of a goal that the floor may take, so that half of the variance is left to noise."""
_OF_VARIANCES = ("d", "a", "e")
"""Criteria that are a mean of variances or the largest one."""


@dataclass(frozen=True)
class PlannedGoal:
    """One goal and the measuring time that reaches it."""

    goal: Annotated[str, described("", "name in `goals` or --want")]
    quantities: Annotated[str, described("", "quantities of the goal, with commas between them")]
    quantity: Annotated[str, described("", "the one of them that decides")]
    unit: Annotated[str, described("", "SI unit of the standard deviations")]
    wanted: Annotated[float, described("see unit", "wanted standard deviation")]
    std: Annotated[float, described("see unit", "predicted for the experiment of the run file")]
    floor: Annotated[
        float,
        described(
            "see unit", f"predicted for {LONGEST_DAYS} days of measuring, by the tolerances alone"
        ),
    ]
    reachable: Annotated[bool, described("", f"{LONGEST_DAYS} days of measuring reach it")]
    periods: Annotated[
        OpenNumber,
        described(
            "1", "periods that reach it; 0: earlier recordings are sufficient; empty if none does"
        ),
    ]
    minutes: Annotated[OpenNumber, described("min", "measuring time of these periods")]
    source: Annotated[
        str, described("", "largest source of error of `std`: noise or a tolerance's key")
    ]
    obstacle: Annotated[
        str,
        described(
            "",
            "largest source of error of the floor of a missed goal: noise or a tolerance's key; "
            "empty: reachable",
        ),
    ]
    tolerance: Annotated[
        OpenNumber,
        described(
            "see tolerance_unit", "tolerance `obstacle` in the robot file, the largest of several"
        ),
    ] = np.nan
    tolerance_unit: Annotated[str, described("", "its SI unit; empty: none, or noise")] = ""
    tolerance_percent: Annotated[
        OpenNumber,
        described(
            "%",
            "size of that tolerance alone, relative to the robot file, at which the floor leaves "
            "half of the wanted variance to noise; empty if the goal is reachable, no size is "
            "enough, or noise is the largest source",
        ),
    ] = np.nan
    all_tolerances_percent: Annotated[
        OpenNumber, described("%", "the same for all tolerances together")
    ] = np.nan


@dataclass(frozen=True)
class PrecisionPoint:
    """Predicted precision of a goal's deciding quantity at some measuring time."""

    goal: Annotated[str, described("", "name of the goal")]
    periods: Annotated[float, described("1", "number of periods")]
    minutes: Annotated[float, described("min", "measuring time")]
    std: Annotated[float, described("see tables/plan.csv", "predicted standard deviation")]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanResult(StageResult):
    """Measuring times of a design for the goals of a run."""

    FILE: ClassVar[str] = "plan.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign plan`"

    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]
    period: Annotated[float, described("s", "of the motion")]
    estimator: Annotated[
        str, described("", "estimator of the prediction: tolerances estimated, or budget")
    ]
    limit: Annotated[
        str, described("", "limit whose widening helps most, by its key; empty: not known")
    ]
    limit_gain_percent: Annotated[
        OpenNumber,
        described("%", "gain of the criterion if that limit were 10 % wider; empty: not known"),
    ]
    limit_std_percent: Annotated[
        OpenNumber,
        described(
            "%",
            "the same as a reduction of the judged standard deviations: of their geometric mean "
            "(criterion d), their rms (a) or the largest (e); empty for other criteria",
        ),
    ]
    goals: Annotated[tuple[PlannedGoal, ...], Table("tables/plan.csv", some=True)]
    curves: Annotated[tuple[PrecisionPoint, ...], Table("tables/plan_precision.csv", some=True)]

    @property
    def reachable(self) -> Annotated[bool, described("", "every goal is reached in some time")]:
        """Whether every goal is reached in some time."""
        return all(one.reachable for one in self.goals)

    @property
    def periods(
        self,
    ) -> Annotated[OpenNumber, described("1", "periods that reach all goals; null if none does")]:
        """Number of periods that reach all goals; NaN where one is not reachable."""
        return max(one.periods for one in self.goals) if self.reachable else np.nan

    @property
    def minutes(self) -> Annotated[OpenNumber, described("min", "measuring time of these periods")]:
        """Measuring time of these periods, min."""
        return self.periods * self.period / 60


def plan_measurement(configuration: RunConfiguration, trajectory: FourierTrajectory) -> PlanResult:
    """Return the measuring times of a motion for the goals of a run.

    Raises
    ------
    InputError
        A goal is unknown, not determined by the design, or has a wrong unit.
    """
    _refuse_unplanned(configuration)
    prediction = Prediction.of(configuration, trajectory)
    wanted = _wishes(configuration.run.goals, prediction, configuration.file)
    if not wanted:
        raise InputError(
            "there is no goal", key="--want", allowed="for example --want mass=1% --want centre=5mm"
        )
    goals = [_planned(wish, prediction) for wish in wanted]
    limit, gain = _helpful_limit(configuration, trajectory)
    of_variances = configuration.run.design.criterion in _OF_VARIANCES
    return PlanResult(
        name=configuration.run.name,
        robot=configuration.robot.name,
        period=trajectory.period,
        estimator="tolerances estimated" if prediction.estimated else "budget",
        limit=limit,
        limit_gain_percent=gain,
        limit_std_percent=100 * (1 - (1 + gain / 100) ** -0.5) if of_variances else np.nan,
        goals=tuple(goals),
        curves=tuple(_curves(goals, prediction)),
    )


def goals_of_design(result: DesignResult) -> tuple[PlannedGoal, ...]:
    """Return the goals of a run by the stored precision of its design, without a prior.

    The floor is the share of the tolerances in the design's own experiment. With estimated
    tolerances it falls with further periods, of which fewer are then sufficient.
    """
    run, derived, own = result.configuration.run, result.derived, result.parameters
    every: list[KnownQuantity | ParameterPrecision] = [*derived, *own]
    names = (*(one.quantity for one in derived), *(one.name for one in own))
    groups = [*DERIVED, *(ALONE + name for name in DERIVED)]
    known = _Quantities(
        names=names,
        groups=tuple(next((g for g in groups if belongs_to(name, g)), name) for name in names),
        units=tuple(one.unit for one in every),
        values=np.array([*(one.value for one in derived), *(one.nominal for one in own)]),
    )
    random = np.array([*(d.std_random for d in derived), *(p.std_experiment for p in own)])
    floor = np.nan_to_num([one.std_systematic for one in every])
    std, sources = np.hypot(random, floor), [one.source or NOISE for one in every]
    stated, period, goals = run.experiment.periods, result.trajectory.period, list[PlannedGoal]()
    for wish in _wishes(run.goals, known, result.configuration.file):
        places, wanted = np.array([*wish.wanted]), np.array([*wish.wanted.values()])
        missed = bool(np.any(floor[places] >= wanted))
        most = int(np.argmax((floor if missed else std)[places] / wanted))
        periods = np.nan
        if not missed:
            share = float(np.max(random[places] ** 2 / (wanted**2 - floor[places] ** 2)))
            periods = float(np.ceil(stated * max(share, 1.0)))
        place = int(places[most])
        goals.append(
            PlannedGoal(
                goal=wish.name,
                quantities=", ".join(names[one] for one in places),
                quantity=names[place],
                unit=known.units[place],
                wanted=float(wanted[most]),
                std=float(std[place]),
                floor=float(floor[place]),
                reachable=not missed,
                periods=periods,
                minutes=periods * period / 60,
                source=sources[place],
                obstacle=sources[place] if missed else "",
            )
        )
    return tuple(goals)


def minutes_to_goals(configuration: RunConfiguration, prediction: Prediction) -> dict[str, float]:
    """Return the measuring time that reaches each goal of a run, min; NaN where none does."""
    wishes = _wishes(configuration.run.goals, prediction, configuration.file)
    periods = {wish.name: prediction.fewest_periods(wish.ratio) for wish in wishes}
    return {name: number * prediction.period / 60 for name, number in periods.items()}


def check_goals(configuration: RunConfiguration, wanted: Mapping[str, Any] | None = None) -> None:
    """Check names, units and signs of goals, which needs no motion.

    By default the goals are those of the run file, otherwise those of ``--want``.
    """
    if not (goals := configuration.run.goals if wanted is None else wanted):
        return
    _refuse_unplanned(configuration)
    evaluator = noise_evaluator(configuration)
    robot, own = evaluator.robot, evaluator.names
    derived = derived_quantities(robot)
    known = _Quantities(
        names=(*derived.names, *own),
        groups=(*(one.group for one in derived.quantities), *own),
        units=(*(one.unit for one in derived.quantities), *map(parameter_unit, own)),
        values=np.concatenate([derived.values, robot.parameters[evaluator.columns]]),
    )
    _wishes(goals, known, configuration.file if wanted is None else None)


def _refuse_unplanned(configuration: RunConfiguration) -> None:
    if configuration.run.design.is_change:
        raise InputError(
            "goals are not planned for the change since a prior",
            file=configuration.file,
            key="goals",
            allowed="goals of a design without design.prior",
        )
    if configuration.run.trajectory.count > 1:
        raise InputError(
            "goals are planned for a single motion",
            file=configuration.file,
            key="goals",
            allowed="trajectory.count: 1",
        )


@dataclass(frozen=True, eq=False)
class _Quantities:
    """Quantities that a goal may name."""

    names: tuple[str, ...]
    groups: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    """(n,), nominal, SI."""


@dataclass(frozen=True, eq=False)
class Prediction(_Quantities):
    """Predicted errors of n quantities for any number of periods."""

    evaluator: Evaluator
    """By the noise alone, of the k judged parameters."""
    rows: Array
    """(n, k), their derivatives to the judged parameters."""
    random: Callable[[float], Array]
    """(k, k), covariance due to noise with exact tolerances for a number of periods."""
    samples: float
    """Number of samples of one period."""
    effects: ToleranceEffects
    estimated: bool
    stated: float
    """Number of periods in the run file."""
    period: float
    """Of the motion, s."""

    @classmethod
    def of(cls, configuration: RunConfiguration, trajectory: FourierTrajectory) -> Prediction:
        """Return the prediction of derived quantities and parameters."""
        evaluator = noise_evaluator(configuration)
        robot, periods = evaluator.robot, configuration.run.experiment.periods
        alone = replace(evaluator, marginal=None)
        information, total = experiment_information(alone, trajectory, configuration)
        earlier = earlier_recordings(configuration, evaluator.names, ())

        def random(count: float) -> Array:
            if earlier is None:
                covariance = fisher.parameter_covariance(information, evaluator.names)
                return covariance * periods / count
            both = information * (count / periods) + earlier
            return fisher.parameter_covariance(both, evaluator.names)

        size = len(evaluator.names)
        errors = ErrorShares(random(periods), np.zeros((size, 0)), ())
        known = [one.quantity for one in derived_precisions(configuration, evaluator, errors)]
        derived, own = derived_quantities(robot), evaluator.columns
        at = [derived.names.index(name) for name in known]
        chosen = [derived.quantities[place] for place in at]
        return cls(
            names=(*known, *evaluator.names),
            groups=(*(one.group for one in chosen), *evaluator.names),
            units=(*(one.unit for one in chosen), *map(parameter_unit, evaluator.names)),
            values=np.concatenate([derived.values[at], robot.parameters[own]]),
            evaluator=evaluator,
            rows=np.concatenate([derived.jacobian[at][:, own], np.eye(size)]),
            random=random,
            samples=total / periods,
            effects=experiment_tolerance_effects(configuration, evaluator, trajectory),
            estimated=configuration.run.estimate.estimates_tolerances,
            stated=periods,
            period=trajectory.period,
        )

    def errors(self, periods: float) -> ErrorShares:
        """Return the errors of all quantities for a number of periods."""
        shares = self.effects.shares(
            self.random(periods), self.samples * periods, estimated=self.estimated
        )
        return shares.of(self.rows)

    def median_std_percent(self, seconds: float) -> float:
        """Return the median of the parameters' relative standard deviations after a time, %."""
        own = slice(-len(self.evaluator.names), None)
        values, std = np.abs(self.values[own]), self.errors(seconds / self.period).std[own]
        known = values > 0
        return float(np.median(100 * std[known] / values[known])) if np.any(known) else np.nan

    def longest(self) -> int:
        """Return the number of periods of the longest planned measuring time."""
        return max(1, int(LONGEST_DAYS * _DAY / self.period))

    def fewest_periods(self, excess: Callable[[ErrorShares], float]) -> float:
        """Return the smallest sufficient number of periods; NaN if the longest time is not enough.

        It is sufficient where `excess`, the ratio of a predicted to a wanted standard deviation, is
        at most 1; the errors fall with it. It is 0 if earlier recordings are sufficient.
        """

        def suffice(periods: int) -> bool:
            return excess(self.errors(periods)) <= 1

        if not suffice(self.longest()):
            return np.nan
        fewest = 0 if self.effects.earlier is not None else 1
        return float(fewest + bisect_left(range(fewest, self.longest()), True, key=suffice))

    def noise(self) -> ErrorShares:
        """Return the errors with exact tolerances after the longest planned measuring time."""
        random = self.rows @ self.random(self.longest()) @ self.rows.T
        return ErrorShares(random, np.zeros((len(random), 0)), ())

    def floor(self) -> ErrorShares:
        """Return the errors on top of `noise`: exact tolerances would take them away.

        With estimated tolerances they contain the noise of these estimates.
        """
        errors = self.errors(self.longest())
        return replace(errors, random=errors.random - self.noise().random)

    def with_tolerances(self, sources: tuple[str, ...], factor: float) -> Prediction:
        """Return the prediction for a machine with some tolerances multiplied by a factor."""
        return replace(self, effects=self.effects.scaled(sources, factor))


def _wishes(goals: Mapping[str, Any], known: _Quantities, file: Path | None) -> list[_Wish]:
    """Read goals in the user's notation; those without a file are of the command line."""
    return [
        _Wish.of(name, value, known, file, f"goals.{name}" if file else f"--want {name}")
        for name, value in goals.items()
    ]


@dataclass(frozen=True)
class _Wish:
    """A goal: quantities, by their places, and wanted standard deviations, SI."""

    name: str
    wanted: dict[int, float]

    @classmethod
    def of(
        cls, name: str, value: Any, prediction: _Quantities, file: Path | None, key: str
    ) -> _Wish:
        """Read a goal in the user's notation: a share of the value, or a number with its unit."""
        valid = dict.fromkeys((*prediction.groups, *prediction.names))
        places = [
            place
            for place, own in enumerate(zip(prediction.groups, prediction.names, strict=True))
            if name in own
        ]
        if not places:
            near = nearest_name(name, valid)
            hint = f"; did you mean {quote(near)}?" if near else ""
            raise InputError(
                f"{quote(name)} is no quantity that the design determines{hint}",
                file=file,
                key=key,
                allowed=", ".join(valid),
            )
        found = {}
        for place in places:
            size, unit = abs(float(prediction.values[place])), prediction.units[place]
            try:
                if str(value).strip().endswith("%"):
                    limit = quantity_in("1").parse(str(value).strip()[:-1]) / 100 * size
                else:
                    limit = quantity_in(unit).parse(value)
            except PydanticCustomError as error:
                allowed = f"a standard deviation in {unit}, or a share of the value such as 1%"
                raise InputError(error.message(), file=file, key=key, allowed=allowed) from error
            if not limit > 0:
                raise InputError(
                    f"the wanted standard deviation {quote(value)} of "
                    f"{prediction.names[place]} is not above zero",
                    file=file,
                    key=key,
                    allowed=f"a standard deviation in {unit} above 0",
                )
            found[place] = limit
        return cls(name, found)

    def ratio(self, errors: ErrorShares) -> float:
        """Return the largest ratio of predicted to wanted standard deviation."""
        return self.excess(errors)[0]

    def excess(self, errors: ErrorShares) -> tuple[float, int]:
        """Return the largest ratio of predicted to wanted standard deviation, and its place."""
        ratios = {place: float(errors.std[place]) / limit for place, limit in self.wanted.items()}
        most = max(ratios, key=lambda place: ratios[place])
        return ratios[most], most


def _planned(wish: _Wish, prediction: Prediction) -> PlannedGoal:
    periods = prediction.fewest_periods(wish.ratio)
    reachable, alone, together = bool(np.isfinite(periods)), np.nan, np.nan
    errors = prediction.errors(periods if reachable else prediction.longest())
    place = wish.excess(errors)[1]
    stated, obstacle = prediction.errors(prediction.stated), ""
    if not reachable and wish.excess(prediction.noise())[0] > 1:
        obstacle = NOISE
    elif not reachable:
        by_source = errors.by_source
        obstacle = max(by_source, key=lambda key: float(by_source[key][place]))
        alone = 100 * _largest_factor(wish, prediction, (obstacle,))
        together = 100 * _largest_factor(wish, prediction, errors.sources)
    deviations = toleranced_deviations(prediction.evaluator.robot)
    sizes = [(one.tolerance, one.unit) for one in deviations if one.group == obstacle]
    size, unit = max(sizes, default=(np.nan, ""))
    return PlannedGoal(
        goal=wish.name,
        quantities=", ".join(prediction.names[one] for one in wish.wanted),
        quantity=prediction.names[place],
        unit=prediction.units[place],
        wanted=wish.wanted[place],
        std=float(stated.std[place]),
        floor=float(prediction.floor().std[place]),
        reachable=reachable,
        periods=periods,
        minutes=periods * prediction.period / 60,
        source=stated.largest_source[place],
        obstacle=obstacle,
        tolerance=size,
        tolerance_unit=unit,
        tolerance_percent=alone,
        all_tolerances_percent=together,
    )


def _largest_factor(wish: _Wish, prediction: Prediction, sources: tuple[str, ...]) -> float:
    """Return the largest factor of tolerances with a floor that leaves half to noise; NaN: none."""

    def excess(factor: float) -> float:
        changed = prediction.with_tolerances(sources, factor)
        whole = changed.errors(prediction.longest())
        return max(wish.excess(changed.floor())[0] / _HALF, wish.excess(whole)[0])

    if excess(0.0) > 1:
        return np.nan
    # A σ that is not known excludes no factor.
    return float(bisect(lambda one: excess(one) - 1, 0.0, 1.0)) if excess(1.0) > 1 else 1.0


def _curves(goals: list[PlannedGoal], prediction: Prediction) -> Iterator[PrecisionPoint]:
    longest = max([10 * prediction.stated, *(3 * g.periods for g in goals if g.reachable)])
    for periods in np.geomspace(1, longest, _CURVE).tolist():
        std = dict(zip(prediction.names, prediction.errors(periods).std.tolist(), strict=True))
        for goal in goals:
            minutes = periods * prediction.period / 60
            yield PrecisionPoint(goal.goal, periods, minutes, std[goal.quantity])


def _helpful_limit(
    configuration: RunConfiguration, trajectory: FourierTrajectory
) -> tuple[str, float]:
    """Return the limit whose widening helps most and its gain, %; nothing where it is not known."""
    if trajectory.sine.shape[1] != configuration.run.trajectory.harmonics:
        return "", np.nan  # the motion of another run
    try:
        found = sensitivity_at_design(plan_search(configuration), trajectory)
    except (ComputationError, InputError):
        return "", np.nan
    key = found.costliest
    return ("", np.nan) if key is None else (key, 100 * found.gains[key])
