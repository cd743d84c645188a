"""View of a design: limits, predicted precision, search, and the cost of each limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from constraints import limit_definitions
from expdesign.configuration import InputError
from expdesign.configuration.limits import held_in_words
from expdesign.experiment import DesignResult
from expdesign.experiment.judging import criterion_symbol, nuisances_in_words
from expdesign.experiment.motions import MotionsResult
from expdesign.experiment.result import ParameterPrecision
from expdesign.experiment.sensitivity import FREQUENCY, LimitSensitivity, sensitivity_at_design
from expdesign.experiment.setup import plan_search
from expdesign.information.criteria import OF_A_CHANGE, criteria
from expdesign.information.fisher import SingularInformationError
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.limit_check import REACHED, LimitCheck
from expdesign.robot.derived import NOISE
from expdesign.solver.feasibility import InfeasibleLimitsError
from results.figures.design import DESIGN_FIGURES
from results.notation import DisplayUnit, duration, handy_unit, percent, readable
from results.views.folder import RunFolder
from results.views.goals import design_goal_blocks
from results.views.parameter_blocks import combination_blocks, derived_blocks, symbols_blocks
from results.views.view import (
    Block,
    Fact,
    Facts,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    drawings,
)

_LEVELS = {
    "converged": Level.GOOD,
    "not converged": Level.CAUTION,
    "interrupted": Level.BAD,
    "limits broken": Level.BAD,
}
_FIGURE_NOTES = {
    "interrupted": "interrupted: the best found until then",
    "limits broken": "this design breaks a limit",
}
_SCALINGS = {"si": "SI units", "nominal": "nominal scaling"}


def design_view(folder: RunFolder) -> StageView:
    """Return the view of the design in a folder; that of a brief one has no costs of limits."""
    result = folder.result(DesignResult)
    sensitivity = None if folder.brief else design_sensitivity(result)
    cost = None if sensitivity is None else costliest_fact(sensitivity)
    reserves = {} if folder.brief else {one.key: one.reserve for one in result.robot.limits}
    reserve = reserve_in_words(sensitivity, reserves, result.criterion)
    figures = drawings(DESIGN_FIGURES, result)
    combinations = combination_blocks(
        "design_combinations", result.base_parameters, result.parameter_names
    )
    blocks: tuple[Block, ...] = (
        Facts(_details(result), screen=True),
        *([Facts((cost,))] if cost else []),
        *(
            [TextBlock(f"{OF_A_CHANGE}.", screen=True)]
            if result.configuration.run.design.is_change
            else []
        ),
        *design_goal_blocks(result),
        *derived_blocks(
            "design_derived", result.derived, "with the σ predicted for the experiment"
        ),
        limits_table(result),
        *([TextBlock(reserve)] if reserve else []),
        *_gains(sensitivity),
        *figures[:5],
        parameters_table(result),
        *symbols_blocks(result.parameter_names, screen=len(combinations) > 1),
        *combinations,
        *figures[5:7],
        _starts_table(result),
        *figures[7:],
    )
    note = _FIGURE_NOTES.get(result.status, "")
    return StageView(_verdict(result), blocks, _facts(result), result.warnings, figure_note=note)


def limits_table(result: DesignResult) -> ReportTable:
    """Return the table of limits with the worst moment of each."""

    def unit(check: LimitCheck) -> DisplayUnit:
        return handy_unit(check.unit, [check.value, check.bound])

    kept = any(check.reserve for check in result.checks)
    reserved = (
        TableColumn("stated", of=lambda check: unit(check).factor * check.stated),
        TableColumn("reserve", "%", digits=3, of="reserve", factor=100),
    )
    certified = all(check.certified for check in result.checks)
    columns = (
        TableColumn("limit", kind="text", of="title"),
        TableColumn("where", kind="text", of=lambda check: check.row or "–"),
        TableColumn("worst", of=lambda check: unit(check).factor * check.value),
        TableColumn("bound", of=lambda check: unit(check).factor * check.bound),
        *(reserved if kept else ()),
        TableColumn("unit", kind="text", of=lambda check: unit(check).symbol or "–"),
        TableColumn("used", "%", of="used", factor=100),
        TableColumn("left", "%", digits=3, of="left", factor=100, proof=True),
        TableColumn("time", "s", of="time", wide=True),
    )
    caption = (
        "Worst moment of every limit over the whole period, exact friction model; used: share of "
        "the bound, or of the distance from the middle to one of two bounds; left: what is free, "
        "proved for every instant"
    )
    if not certified:
        open_time = max(check.open_time for check in result.checks)
        caption += f"; negative where {open_time:.3g} s are not proved"
    if kept:
        caption += "; the bounds are the stated ones less the reserve"
    held = [
        f". {text[:1].upper()}{text[1:]}"
        for text in held_in_words(result.configuration.robot.limits)
    ]
    return ReportTable.of(
        "limits", f"{caption}{''.join(held)}", columns, result.checks, screen=True, latex=True
    )


def parameters_table(result: DesignResult | MotionsResult) -> ReportTable:
    """Return nominal parameters with their predicted standard deviations."""
    shared, prior = result.predicted_std.systematic, ""
    if isinstance(result, DesignResult) and result.configuration.run.design.prior is not None:
        prior = "; both with all of design.prior"
    columns = (
        TableColumn("parameter", kind="parameter", of="name"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("nominal", of="nominal"),
        TableColumn("σ, one period", digits=3, of="std_per_period"),
        TableColumn("σ, one period", "%", digits=3, of="rel_std_percent_per_period"),
        TableColumn("σ, experiment", digits=3, of="std_experiment"),
        TableColumn("σ, experiment", "%", digits=3, of="rel_std_percent_experiment"),
        *(_TOTAL if shared else ()),
    )
    experiment = result.predicted_std.experiment
    caption = (
        f"Nominal parameters and predicted standard deviations σ: over {result.samples} "
        f"samples of one period, and over {readable(experiment.periods)} periods with "
        f"{experiment.samples} samples{prior}; percent of the nominal value"
        f"{_TOLERANCES if shared else ''}"
    )
    return ReportTable.of("parameters", caption, columns, result.parameters, latex=True)


_TOTAL = (
    TableColumn("σ, tolerances", digits=3, of="std_systematic"),
    TableColumn("σ, total", digits=3, of="std_total"),
    TableColumn("σ, total", "%", digits=3, of="rel_std_percent"),
    TableColumn("largest source", kind="text", of="source"),
)
_TOLERANCES = (
    " for noise alone; total: of noise and the robot's tolerances in the experiment, by the run's "
    "estimator. More periods do not reduce the share of a tolerance that is the largest source"
)


def _starts_table(result: DesignResult) -> ReportTable:
    columns = (
        TableColumn("start", of="index"),
        TableColumn("kind", kind="text", of="kind"),
        TableColumn("criterion", digits=6, of="criterion_value"),
        TableColumn("finished", digits=6, of="finished_value"),
        TableColumn("iterations", of="iterations"),
        TableColumn("how it ended", kind="text", of="status"),
        TableColumn("best", kind="text", of="best"),
    )
    starts = result.solver.starts
    return ReportTable.of("starts", "All starts of the search", columns, starts, folded=True)


def _verdict(result: DesignResult) -> StageVerdict:
    level = _LEVELS.get(result.status, Level.NEUTRAL)
    held = [check.title for check in result.checks if check.used >= REACHED]
    sentence = (
        f"Trajectory of {result.harmonics} harmonics with a period of "
        f"{readable(2 * np.pi / result.omega)} s."
    )
    if result.status == "limits broken":
        broken = [check.key for check in result.checks if not check.kept]
        sentence += f" It breaks {', '.join(broken) or 'a limit'}."
    elif result.status == "interrupted":
        sentence += " The search was interrupted: this is the best found until then."
    else:
        left = [check.key for check in result.checks if not check.certified]
        how = "proved for every instant with the exact (unsmoothed) friction model"
        if left:
            how = f"but not proved for every instant: {', '.join(left)}"
        sentence += f" Every limit is kept over the whole period, {how}."
    if held:
        sentence += f" Active limits: {', '.join(held)}."
    if result.status == "not converged":
        sentence += f" Best start: {result.status_text}."
    return StageVerdict("Design", level, result.status, sentence, "design")


def _facts(result: DesignResult) -> tuple[Fact, ...]:
    criterion = criteria().get(result.criterion)
    information = criterion_symbol(result.configuration)
    meaning = nuisances_in_words(result.configuration)
    finite = np.isfinite(result.criterion_value)
    value = readable(result.criterion_value, 6) if finite else "singular"
    facts = [
        Fact(
            criterion.named(information) if criterion else result.criterion,
            value,
            f"one period, {result.samples} samples, {_SCALINGS.get(result.scaling, '')}"
            f"{'; ' * bool(meaning)}{meaning}",
        ),
        *precision_facts(result.parameters),
    ]
    if result.checks:
        tightest = max(result.checks, key=lambda check: check.used)
        used = percent(tightest.used, 4)
        facts.append(Fact("tightest limit", used, f"used of {tightest.title}"))
    return tuple(facts)


def precision_facts(parameters: Sequence[ParameterPrecision]) -> list[Fact]:
    """Return the number of identifiable parameters, and the tolerance that limits most of them."""
    percents = np.array([parameter.rel_std_percent for parameter in parameters])
    relative = percents[np.isfinite(percents)]
    if not relative.size:
        return []
    total = "total " if any(one.source for one in parameters) else ""
    median = readable(np.median(relative), 3)
    note = f"predicted {total}σ below half of the value; median {median} %"
    if zeros := int(np.sum(np.isnan(percents))):
        verb = "is" if zeros == 1 else "are"
        note += f"; {zeros} more {verb} zero in the robot file, which leaves no share of a value"
    known = int(np.sum(relative < 100 * IDENTIFIABLE))
    identifiable = Fact("parameters identifiable", f"{known} of {relative.size}", note)
    return [identifiable, *_tolerance_fact(parameters)]


def _tolerance_fact(parameters: Sequence[ParameterPrecision]) -> list[Fact]:
    """Return the tolerance that limits most parameters; nothing where noise limits all of them."""
    sources = [one.source for one in parameters if one.source not in ("", NOISE)]
    if not sources:
        return []
    most = max(dict.fromkeys(sources), key=sources.count)
    noisy = len(parameters) - len(sources)
    note = (
        f"the largest source of {sources.count(most)} of {len(parameters)} parameters; noise is "
        f"of {noisy}: more periods {'hardly help' if noisy < len(sources) else 'help these'}"
    )
    return [Fact("limiting tolerance", most, note)]


def _details(result: DesignResult) -> tuple[Fact, ...]:
    solver = result.solver
    facts = [
        Fact("base frequency", f"{readable(result.omega / (2 * np.pi))} Hz"),
        Fact(
            "period",
            f"{readable(2 * np.pi / result.omega)} s",
            f"{readable(result.samples_per_period, 6)} controller steps",
        ),
        Fact("harmonics", str(result.harmonics)),
    ]
    if result.criterion != "d" and np.isfinite(result.log_det_information):
        log_det = criteria()["d"].named(result.configuration.run.design.information)
        facts.append(Fact(log_det, readable(result.log_det_information, 6), "SI units"))
    starts = result.configuration.run.design.starts
    hop = solver.best_start - starts
    best = f"{solver.best_start} of {starts}" if hop <= 0 else f"{solver.best_start} (hop {hop})"
    facts += [
        Fact("search", duration(solver.seconds), f"{solver.iterations} iterations"),
        Fact("best start", best, solver.ended),
    ]
    return tuple(facts)


def _gains(sensitivity: LimitSensitivity | None) -> tuple[Block, ...]:
    if sensitivity is None:
        return ()
    if not sensitivity.explained:
        text = (
            f"The limits leave {percent(sensitivity.unexplained)} of the cost's gradient: the "
            "design is not near an optimum, and the costs of the limits are not shown."
        )
        return (TextBlock(text),)
    return (gains_table({"gain": sensitivity}, "the design itself"),)


_REST = "unexplained"

_NOTHING = 1e-4
"""Share of the criterion up to which a reserve costs nothing."""

_SAME = 1e-6
"""Relative difference up to which a number computed again is the same."""


def design_sensitivity(result: DesignResult) -> LimitSensitivity | None:
    """Return the approximate cost of every limit of a folder's design.

    None where `run.yaml` no longer belongs to this design: later stages write their own.
    """
    run = result.configuration.run
    if (result.criterion, result.scaling, result.harmonics, result.samples) != (
        run.design.criterion,
        run.design.scaling,
        run.trajectory.harmonics,
        run.trajectory.samples,
    ):
        return None
    try:
        plan = plan_search(result.configuration)
        if not (_same_limits(result) and _same_criterion(result, plan.evaluator)):
            return None
        return sensitivity_at_design(plan, result.trajectory)
    except (InputError, InfeasibleLimitsError, SingularInformationError):
        return None


def costliest_fact(sensitivity: LimitSensitivity, whose: str = "") -> Fact | None:
    """Return the cost of the costliest limit; None where no cost is known."""
    key = sensitivity.costliest
    if key is None:
        return None
    gain = f"+{readable(100 * sensitivity.gains[key], 2)} %"
    return Fact("costliest limit", gain, f"{whose}10 % more {limit_title(key)}")


def reserve_in_words(
    sensitivity: LimitSensitivity | None, reserves: Mapping[str, float], criterion: str
) -> str:
    """Return a sentence on the cost of reserves, by limit; empty without a reserve.

    The cost of a design by log det F is in D-efficiency, otherwise in the criterion's value.
    """
    kept = {key: share for key, share in reserves.items() if share}
    if not kept:
        return ""
    shares = sorted(set(kept.values()))
    span = " to ".join(dict.fromkeys(percent(share) for share in (shares[0], shares[-1])))
    which = "every limit" if len(kept) == len(reserves) else ", ".join(map(limit_title, kept))
    text = f"A reserve of {span} of the range of {which} is kept free."
    if sensitivity is None or not sensitivity.explained:
        return f"{text} Its cost is not known: the design is not near an optimum."
    text += (
        f" It costs about {percent(sensitivity.reserve, 2)} of "
        f"{'the D-efficiency' if criteria()[criterion].invariant else 'what the criterion has'} "
        "with the stated bounds, to first order from the limits' multipliers"
    )
    costly = sorted(sensitivity.reserved, key=lambda key: -sensitivity.reserved[key])
    parts = [
        f"{limit_title(key)} {percent(sensitivity.reserved[key], 2)}"
        for key in costly
        if sensitivity.reserved[key] > _NOTHING
    ]
    return f"{text}: {', '.join(parts)}." if parts else f"{text}."


def limit_title(key: str) -> str:
    """Return the title of a limit, of the bounds of the base frequency, or of the rest."""
    titles = {FREQUENCY: "base frequency", _REST: "unexplained by the limits"}
    return titles.get(key) or limit_definitions()[key].title


def gains_table(found: Mapping[str, LimitSensitivity], where: str) -> ReportTable:
    """Return the costs of the limits, one column per design.

    `where` names the origin of the multipliers.
    """
    keys = dict.fromkeys(key for sensitivity in found.values() for key in sensitivity.gains)
    columns = [TableColumn("limit", kind="text", of=limit_title)]
    for label, sensitivity in found.items():
        known = sensitivity.gains if sensitivity.explained else {}
        shares = {**known, _REST: sensitivity.unexplained}
        columns.append(TableColumn(label, "%", digits=3, of=shares.get, factor=100))
    caption = (
        "Gain from 10 % more of each limit alone, in percent of the D-efficiency (of the "
        f"criterion's value for other criteria), to first order from the multipliers of {where}"
    )
    return ReportTable.of("limit_gains", caption, columns, [*keys, _REST])


def _same_limits(result: DesignResult) -> bool:
    checked = {check.key: check.bound for check in result.checks}
    limits = {limit.key: (*limit.lower, *limit.upper) for limit in result.robot.limits}
    return checked.keys() == limits.keys() and all(
        bool(np.any(np.isclose(limits[key], bound, rtol=_SAME, atol=0)))
        for key, bound in checked.items()
    )


def _same_criterion(result: DesignResult, evaluator: Evaluator) -> bool:
    information = evaluator.information(result.trajectory, result.samples)
    value, known = evaluator.value(information), np.isfinite(result.log_det_information)
    return bool(known and np.isclose(value, result.criterion_value, rtol=_SAME, atol=0))
