"""The stages of one start: friction and criterion continued from blunt to sharp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from expdesign.information.criteria import CRITERIA
from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.interior_point import RENEWED, Standstill
from expdesign.solver.stage import Stage

MOST_BLUNT_HARMONICS = 5
"""Harmonics of the first stage at most: with many it was seen to get stuck far from the best."""

_EVERYTHING = 10.0
_NEAR = 0.15
_RADIUS = 0.6
_THROWN = 0.03
"""First barrier of a hop: the larger, the farther from where it was thrown it may end."""
_SETTLED = 1e-3
"""At the beginning of a stage near its optimum: from 0.01 it goes far away and comes back."""
_ROUGH = Standstill(1e-3, 3)
"""A third of the iterations less, and refinements end where they did (47 starts)."""
_FINISH_NEAR = 0.1
_FINISH_RADIUS = 0.2
_LAST_NEAR, _LAST_RADIUS = 0.03, 0.05
"""Of Ipopt's round. In a larger box it wanders off, to where rows that were left out are broken;
with three times the rows its linear algebra takes three times as long (measured). For five
harmonics; with more a step of the same size changes accelerations more, and more rows are near."""
_FINISHED = 1e-4
"""First barrier of the finish, which sets out from an optimum: as `_SETTLED`."""


def coarse_points(harmonics: int) -> int:
    """Points per period that resolve the limited quantities well enough for a blunt stage."""
    return 8 * harmonics + 8


def fine_points(harmonics: int) -> int:
    """Points per period for the sharp stages and the finish."""
    return 16 * harmonics + 20


def continuation_stages(
    problem: DesignProblem, widths: Sequence[float], iterations: int
) -> list[Stage]:
    """Return the stages of one start.

    The first one holds every limit on a coarse grid with blunt friction: it finds the basin. The
    others start from its result, so that only rows near their bounds need to be in the NLP.
    With many harmonics the first stage has only some of them; the others start from zero, and the
    next stage holds every limit too: the others move far before any of them is near its bound.
    The first stage of a criterion that is flat where a parameter is hardly excited maximises
    log det F instead; from there the condition number's optimum is out of reach (measured). A
    criterion with a surrogate is sharpened over the others; its last levels follow at the last
    width. `widths` of the smoothing of dry friction, m/s, decrease.
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    few = min(n, MOST_BLUNT_HARMONICS)
    levels = problem.criterion.levels
    coarse, fine = coarse_points(n), fine_points(n)
    flat = problem.criterion.flat
    # Criteria that depend on the scaling have a long way to go: one more stage on the first level.
    levels = levels if problem.criterion.invariant else (levels[0], *levels)
    # With few harmonics first, the next stage is on the coarse grid: one more on the fine one.
    count = max(len(widths), len(levels), 3 if few < n else 2)
    stages = [
        Stage(
            name="blunt",
            width=widths[0],
            level=levels[0],
            samples=min(samples, coarse_points(few)),
            points=coarse_points(few),
            near=_EVERYTHING,
            radius=None,
            iterations=iterations,
            renewed=RENEWED,
            standstill=_ROUGH,
            criterion=CRITERIA["d"] if flat else None,
            harmonics=few if few < n else None,
        )
    ]
    for k in range(1, count):
        # The grid goes from coarse to fine, the rows from many to those near their bounds.
        share = min(k, len(widths) - 1) / (len(widths) - 1) if len(widths) > 1 else 1.0
        points = round(coarse + share * (fine - coarse))
        near = _NEAR * (2 - share)
        if k == 1 and few < n:
            points, near = coarse, _EVERYTHING
        stages.append(
            Stage(
                name="sharp",
                width=widths[min(k, len(widths) - 1)],
                level=levels[min(k, len(levels) - 1)],
                samples=min(samples, points),
                points=points,
                near=near,
                radius=_RADIUS,
                iterations=iterations,
                barrier=_SETTLED,
            )
        )
    return stages


def hop_stages(problem: DesignProblem, widths: Sequence[float], iterations: int) -> list[Stage]:
    """Return the stages of one hop: those of a start, with fewer iterations.

    The first one holds every limit: thrown into its limits, a motion has none near its bound, and
    with few rows the solver runs out of all the others at once (measured).
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    first, *others = continuation_stages(problem, widths, max(10, iterations // 2))
    coarse = coarse_points(n)
    thrown = replace(
        first,
        points=coarse,
        samples=min(samples, coarse),
        barrier=_THROWN,
        harmonics=None,
    )
    return [thrown, *others]


def finish_stage(problem: DesignProblem, widths: Sequence[float], iterations: int) -> Stage:
    """Return the settings of each round of the finish: a small box, the sharpest smoothing.

    Twice as many samples in the cost as in the stage before: they say better which of several
    motions will be the best (measured).
    """
    n = problem.variables.harmonics
    points = fine_points(n)
    return Stage(
        name="finish",
        width=widths[-1],
        level=problem.criterion.levels[-1],
        samples=min(problem.cost.samples, 2 * points),
        points=points,
        near=_FINISH_NEAR,
        radius=_FINISH_RADIUS,
        iterations=max(10, iterations // 4),
        barrier=_FINISHED,
    )


def last_stage(stage: Stage, harmonics: int) -> Stage:
    """Return the settings of Ipopt's round, which sets out from what the rounds before found."""
    share = min(1.0, 5 / harmonics)
    return replace(stage, solver="ipopt", near=share * _LAST_NEAR, radius=share * _LAST_RADIUS)
