"""What every limit costs a design, as reports tell it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from constraints import limit_definitions
from expdesign.configuration import InputError
from expdesign.experiment import DesignResult
from expdesign.experiment.sensitivity import FREQUENCY, LimitSensitivity, sensitivity_at_design
from expdesign.experiment.setup import plan_search
from expdesign.information.criteria import CRITERIA
from expdesign.information.fisher import SingularInformationError
from expdesign.recheck.information import Evaluator
from expdesign.solver.feasibility import InfeasibleLimitsError
from results.notation import percent, readable
from results.views.view import Fact, ReportTable, TableColumn

EXPLAINED = 0.1
"""Largest share of the cost's gradient that the limits may leave for multipliers to be shown."""

_REST = "unexplained"

_NOTHING = 1e-4
"""Share of the criterion up to which a reserve costs nothing."""

_SAME = 1e-6
"""Relative difference up to which a number computed again is the same."""


def design_sensitivity(record: DesignResult) -> LimitSensitivity | None:
    """Return about what every limit costs the design of a folder.

    None where `run.yaml` is no longer of this design: stages that came later leave their own.
    """
    summary, run = record, record.configuration.run
    if (summary.criterion, summary.scaling, summary.harmonics, summary.samples) != (
        run.design.criterion,
        run.design.scaling,
        run.trajectory.harmonics,
        run.trajectory.samples,
    ):
        return None
    try:
        plan = plan_search(record.configuration)
        if not (_same_limits(record) and _same_criterion(record, plan.evaluator)):
            return None
        return sensitivity_at_design(plan, summary.trajectory)
    except (InputError, InfeasibleLimitsError, SingularInformationError):
        return None


def costliest(sensitivity: LimitSensitivity) -> str | None:
    """Return the key of the limit that costs most, None where none is known to cost anything."""
    if sensitivity.unexplained > EXPLAINED or not sensitivity.gains:
        return None
    key = max(sensitivity.gains, key=lambda name: sensitivity.gains[name])
    return key if sensitivity.gains[key] > 0 else None


def costliest_fact(sensitivity: LimitSensitivity, whose: str = "") -> Fact | None:
    """Return what the costliest limit costs; None where none is known to cost anything."""
    key = costliest(sensitivity)
    if key is None:
        return None
    gain = f"+{readable(100 * sensitivity.gains[key], 2)} %"
    return Fact("costliest limit", gain, f"{whose}10 % more {limit_title(key)}")


def reserve_in_words(
    sensitivity: LimitSensitivity | None, reserves: Mapping[str, float], criterion: str
) -> str:
    """Say what keeping reserves of limits, by key, costs; empty where none is kept.

    Of a design by log det F it is told in D-efficiency, otherwise in the criterion's value.
    """
    kept = {key: share for key, share in reserves.items() if share}
    if not kept:
        return ""
    shares = sorted(set(kept.values()))
    span = " to ".join(dict.fromkeys(percent(share) for share in (shares[0], shares[-1])))
    which = "every limit" if len(kept) == len(reserves) else ", ".join(map(limit_title, kept))
    text = f"A reserve of {span} of the range of {which} is kept free."
    if sensitivity is None or sensitivity.unexplained > EXPLAINED:
        return f"{text} What it costs is not known: the design is not near an optimum."
    text += (
        f" It costs about {percent(sensitivity.reserve, 2)} of "
        f"{'the D-efficiency' if CRITERIA[criterion].invariant else 'what the criterion has'} "
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
    """Return what a limit, the bounds of the base frequency, or the rest are called."""
    titles = {FREQUENCY: "base frequency", _REST: "unexplained by the limits"}
    return titles.get(key) or limit_definitions()[key].title


def gains_table(found: Mapping[str, LimitSensitivity], where: str) -> ReportTable:
    """Return what every limit costs, one column per design; `where` the multipliers are from."""
    keys = dict.fromkeys(key for sensitivity in found.values() for key in sensitivity.gains)
    columns = [TableColumn("limit", kind="text", of=limit_title)]
    for label, sensitivity in found.items():
        known = sensitivity.gains if sensitivity.unexplained <= EXPLAINED else {}
        shares = {**known, _REST: sensitivity.unexplained}
        columns.append(TableColumn(label, "%", digits=3, of=shares.get, factor=100))
    caption = (
        "What 10 % more of each limit alone would buy, in percent of the D-efficiency (of the "
        f"criterion's value for other criteria), to first order from the multipliers of {where}"
    )
    return ReportTable.of("limit_gains", caption, columns, [*keys, _REST])


def _same_limits(record: DesignResult) -> bool:
    checked = {check.key: check.bound for check in record.checks}
    limits = {limit.key: (*limit.lower, *limit.upper) for limit in record.robot.limits}
    return checked.keys() == limits.keys() and all(
        bool(np.any(np.isclose(limits[key], bound, rtol=_SAME, atol=0)))
        for key, bound in checked.items()
    )


def _same_criterion(record: DesignResult, evaluator: Evaluator) -> bool:
    summary = record
    information = evaluator.information(summary.trajectory, summary.samples)
    return bool(
        np.isclose(evaluator.log_det(information), summary.log_det_information, rtol=_SAME, atol=0)
        and np.isclose(evaluator.value(information), summary.criterion_value, rtol=_SAME, atol=0)
    )
