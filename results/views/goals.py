"""Goals on screen and in a report: their table, and their obstacles in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from expdesign.configuration import InputError
from expdesign.experiment import DesignResult
from expdesign.experiment.plan import PlannedGoal, goals_of_design
from expdesign.robot.derived import NOISE
from results.notation import duration, handy_unit, readable
from results.views.parameter_blocks import symbols_blocks
from results.views.view import Block, Level, ReportTable, TableColumn, TextBlock

_DIGITS = range(3, 7)


def goals_table(key: str, goals: Sequence[PlannedGoal], caption: str) -> ReportTable:
    """Return a table with the precision of each goal, and the measuring time that reaches it."""
    digits = next((n for n in _DIGITS if _shows_misses(goals, n)), _DIGITS[0])

    def column(label: str, of: str) -> TableColumn:
        return TableColumn(
            label,
            digits=digits,
            of=lambda row: handy_unit(row.unit, [row.wanted]).factor * getattr(row, of),
        )

    columns = (
        TableColumn("goal", kind="text", of="goal"),
        TableColumn("decided by", kind="text", of="quantity", wide=True),
        TableColumn("unit", kind="text", of=lambda row: handy_unit(row.unit, [row.wanted]).symbol),
        column("σ wanted", "wanted"),
        column("σ, run file", "std"),
        TableColumn("largest source", kind="text", of=lambda row: row.source.replace(".", ": ")),
        column("σ, floor", "floor"),
        TableColumn("periods", of="periods"),
        TableColumn("measuring", kind="text", of=_measuring),
    )
    return ReportTable.of(key, caption, columns, goals, screen=True, latex=True)


def _shows_misses(goals: Sequence[PlannedGoal], digits: int) -> bool:
    """Return whether the floors of missed goals differ from the wanted values in so many digits."""
    missed = [one for one in goals if not one.reachable]
    return all(f"{one.floor:.{digits}g}" != f"{one.wanted:.{digits}g}" for one in missed)


def _measuring(goal: PlannedGoal) -> str:
    if goal.periods == 0:
        return "reached before"
    return duration(60 * goal.minutes) if goal.reachable else "–"


def floor_in_words(goal: PlannedGoal, when: str) -> str:
    """Return that the tolerances alone leave more of a goal than is wanted."""
    unit = handy_unit(goal.unit, [goal.wanted])
    floor, wanted = (unit.quantity(value, 3) for value in (goal.floor, goal.wanted))
    return (
        f"{goal.goal}: {when} the tolerances alone leave σ = {floor}; wanted, with the noise, is "
        f"{wanted}."
    )


def design_goal_blocks(result: DesignResult) -> Iterator[Block]:
    """Yield whether a design's own periods reach the goals of its run, or how many would."""
    run = result.configuration.run
    if not run.goals or run.design.is_change or run.design.others:
        return
    if run.design.prior is not None:
        text = "`expdesign plan` has the periods that reach the goals with the earlier recordings."
        yield TextBlock(text, screen=True)
        return
    try:
        goals = goals_of_design(result)
    except InputError as error:
        yield TextBlock(f"Goals: {error}.", Level.CAUTION, screen=True)
        return
    periods = run.experiment.periods
    seconds = duration(periods * result.trajectory.period)
    caption = (
        f"Goals: σ in the experiment of the run file, {readable(periods)} periods or {seconds} of "
        "measuring, with its largest source; floor: share of the tolerances in it; the periods "
        "that reach the goal with this share, not fewer than in the run file"
    )
    if result.systematic and run.estimate.estimates_tolerances:
        caption += "; as the tolerances are estimated, fewer may be enough"
    yield goals_table("design_goals", goals, caption)
    yield from symbols_blocks((one.quantity for one in goals), screen=True)
    for goal in goals:
        if not goal.reachable:
            most = f"The largest is {goal.obstacle.replace('.', ': ')}. "
            text = (
                f"{floor_in_words(goal, f'with {readable(periods)} periods')} "
                f"{most if goal.obstacle != NOISE else ''}What to do: `expdesign plan` states "
                "whether a longer time is enough, and else the size of the tolerance that is."
            )
            yield TextBlock(text, Level.CAUTION, screen=True)
