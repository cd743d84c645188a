"""Views of plans: measuring times for wanted precisions with their obstacles, next motions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from estimation.processing.noise import FEWEST_PERIODS
from expdesign.experiment.next_motion import NextResult, QuantityGain
from expdesign.experiment.plan import LONGEST_DAYS, PlannedGoal, PlanResult
from expdesign.information.identifiable import listed
from expdesign.robot.derived import NOISE
from results.figures.studies import plan_figure
from results.notation import DisplayUnit, duration, handy_unit, readable
from results.views.design import limit_title
from results.views.folder import RunFolder
from results.views.goals import floor_in_words, goals_table
from results.views.parameter_blocks import symbols_blocks
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)


def plan_view(folder: RunFolder) -> StageView:
    """Return the view of the plan in a folder."""
    result = folder.result(PlanResult)
    obstacles = [_obstacle(one) for one in result.goals if not one.reachable]
    caption = (
        f"Periods of {readable(result.period)} s that reach each goal (standard deviations, "
        f"{result.estimator}), the largest source of σ, run file; floor: share of the tolerances "
        f"after {LONGEST_DAYS} days"
    )
    blocks: tuple[Block, ...] = (
        goals_table("plan", result.goals, caption),
        *symbols_blocks((one.quantity for one in result.goals), screen=True),
        *(TextBlock(text, Level.CAUTION, screen=True) for text in obstacles),
        *(TextBlock(text, screen=True) for text in _meanings(result)),
        Drawing(plan_figure, result),
    )
    return StageView(_verdict(result), blocks, _facts(result), heading="Measuring time")


def _meanings(result: PlanResult) -> Iterator[str]:
    """Yield remarks on quantities that are not what their names suggest."""
    names = {name for one in result.goals for name in one.quantities.split(", ")}
    if any(one.goal == "centre" and one.quantities == "centre_z" for one in result.goals):
        yield (
            "centre is centre_z alone: with platform: symmetric the centre is on the z axis by "
            "assumption, and platform: general has all three components."
        )
    if any(name.startswith(("mass", "centre", "inertia")) for name in names):
        yield (
            "Mass, centre and inertia are those of the platform with the sliders' masses; "
            "platform_mass, platform_centre and platform_inertia are without them, if the robot "
            "file states the sliders as bodies."
        )
    yield (
        "Not counted: effects that the model lacks and the tests may miss; with a size under "
        "`tolerances.terms` they are. An estimate states theirs as σ undetected."
    )


def _obstacle(goal: PlannedGoal) -> str:
    unit = handy_unit(goal.unit, [goal.wanted])
    possible = unit.quantity(math.sqrt(2) * goal.floor, 3)  # half for the noise
    if goal.obstacle == NOISE:
        return (
            f"{goal.goal}: after {LONGEST_DAYS} days the noise alone leaves more than the wanted "
            f"{unit.quantity(goal.wanted, 3)}. What to do: state a larger goal, allow more "
            "harmonics or widen a limit."
        )
    text = (
        f"{floor_in_words(goal, f'after {LONGEST_DAYS} days')} What to do: state a goal of "
        f"{possible} or more"
    )
    if np.isfinite(goal.tolerance_percent):
        size = handy_unit(goal.tolerance_unit, [goal.tolerance])
        if goal.tolerance_unit == "1":
            size = DisplayUnit("%", 100)
        least = goal.tolerance * goal.tolerance_percent / 100
        text += (
            f", or reduce {goal.obstacle}, the largest source, to {size.quantity(least, 2)} "
            f"({size.quantity(goal.tolerance)} is stated)"
        )
    elif np.isfinite(goal.all_tolerances_percent):
        text += (
            f", or reduce all tolerances to {readable(goal.all_tolerances_percent, 2)} % of their "
            "stated sizes"
        )
    return f"{text}."


def _verdict(result: PlanResult) -> StageVerdict:
    if result.periods == 0:
        sentence = "The earlier recordings are sufficient for every goal: nothing to measure."
        return StageVerdict("Plan", Level.GOOD, "reached", sentence, "plan")
    if result.reachable:
        sentence = (
            f"{readable(result.periods, 6)} {'period' if result.periods == 1 else 'periods'}, "
            f"{duration(60 * result.minutes)} of measuring, enough for every goal."
        )
        if result.periods < FEWEST_PERIODS:
            sentence += (
                f" Measure {FEWEST_PERIODS} periods or more: the noise is estimated from their "
                "scatter, and an outlier differs from their median."
            )
        return StageVerdict("Plan", Level.GOOD, "reachable", sentence, "plan")
    missed = [one.goal for one in result.goals if not one.reachable]
    sentence = f"{LONGEST_DAYS} days of measuring do not reach {listed(missed)}."
    return StageVerdict("Plan", Level.BAD, "not reachable", sentence, "plan")


def _facts(result: PlanResult) -> tuple[Fact, ...]:
    if not result.limit:
        return ()
    change = f"σ −{readable(result.limit_std_percent, 2)} %"
    if not np.isfinite(result.limit_std_percent):
        change = f"criterion +{readable(result.limit_gain_percent, 2)} %"
    note = f"{change} if it is 10 % wider (first order)"
    return (Fact("limit that helps most", limit_title(result.limit), note),)


def next_view(folder: RunFolder) -> StageView:
    """Return the view of the next motion in a folder."""
    result = folder.result(NextResult)
    derived = [one for one in result.gains if not one.parameter]
    blocks: tuple[Block, ...] = (
        _gains_table("next", "Derived quantities", derived),
        _gains_table(
            "next_parameters", "Parameters", [one for one in result.gains if one.parameter]
        ),
    )
    sentence = (
        f"{readable(result.periods)} periods of the next motion reduce the standard deviations "
        f"of the parameters to {readable(result.next_percent, 3)} %, the last motion repeated for "
        f"the same time to {readable(result.repeated_percent, 3)} % (geometric means)."
    )
    level, word = Level.GOOD, "better than repeating"
    if result.next_percent > result.repeated_percent:
        level, word = Level.CAUTION, "no better than repeating"
        sentence += " Another criterion than the mean may be behind it, or too short a search."
    verdict = StageVerdict("Next motion", level, word, sentence, "next")
    fact = Fact("measuring", duration(60 * result.minutes), "of the next motion")
    return StageView(verdict, blocks, (fact,), heading="Next motion")


def _gains_table(key: str, whose: str, gains: Sequence[QuantityGain]) -> ReportTable:
    def column(label: str, of: str) -> TableColumn:
        return TableColumn(
            label,
            digits=3,
            of=lambda row: handy_unit(row.unit, [row.std_measured]).factor * getattr(row, of),
        )

    columns = (
        TableColumn("quantity", kind="parameter", of="quantity"),
        TableColumn(
            "unit", kind="text", of=lambda row: handy_unit(row.unit, [row.std_measured]).symbol
        ),
        column("σ so far", "std_measured"),
        column("σ, last motion again", "std_repeated"),
        column("σ, next motion", "std_next"),
        TableColumn("again / so far", "%", digits=3, of="share_repeated", factor=100),
        TableColumn("next / so far", "%", digits=3, of="share_next", factor=100),
    )
    caption = (
        f"{whose}: predicted standard deviations by the recordings so far, with the last motion "
        "measured again for the same time, and with the next motion"
    )
    main = key == "next"
    return ReportTable.of(key, caption, columns, gains, folded=not main, screen=main, latex=main)
