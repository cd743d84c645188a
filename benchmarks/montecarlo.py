"""PaLiDA, the design of n = 5, 10 periods at 1 kHz: bias, RMSE and coverage of the estimators.

Every study keeps its repetitions in `runs/benchmark-…`: one that is stopped goes on from there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from estimation.identification.estimate import parameter_knowledge, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.montecarlo import Study, run_study
from estimation.montecarlo.journal import NAME as JOURNAL
from estimation.montecarlo.record import MonteCarloRecord, StatisticsRow
from estimation.montecarlo.statistics import ParameterStatistics, PooledStatistics
from estimation.twin import Twin
from expdesign.configuration import load_run
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from results import record_figures
from results.figures.drawing import save_figures
from results.figures.montecarlo import bias_figure

TITLE = "Monte-Carlo study"

CLEAR_BIAS = 3.5
"""Standard errors from which on a bias is no chance."""

MANY = 10.0
"""Standard errors that are "many"."""

OUTLIER = 6.0
"""Largest error of a study without outlier runs, in units of the RMSE."""

_ROOT = Path(__file__).resolve().parents[1]

Row = dict[str, Any]


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` instead of what the claim is about."""
    measure, wanted = SECTIONS[section]
    return measure(repetitions or wanted)


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    judged = table[table["holds"] != ""]
    broken = judged[judged["holds"] == "no"]
    if not len(judged):
        return "no claims"
    text = f"{len(judged) - len(broken)} of {len(judged)} claims hold"
    return text if not len(broken) else f"{text}; not: " + "; ".join(broken["claim"])


# --- sections -------------------------------------------------------------------------------------


def nominal(repetitions: int) -> Iterator[Row]:
    """Fourier differentiation, noise of the robot file, all three estimators."""
    study = _study("nominal", repetitions, ("ls", "gm", "ml"))
    yield from _all_there(study)
    for name in ("gm", "ml"):
        pooled = _pooled(study, name)
        yield _unbiased(study, name)
        yield _row(
            f"{name}: RMSE / bound in 0.93 … 1.07",
            _ratio(pooled),
            0.93 <= pooled.rmse_over_bound <= 1.07,  # noqa: PLR2004 - the claim's
        )
        yield _row(
            f"{name}: 95 % intervals cover 93 … 97 %, pooled",
            _coverage(pooled),
            0.93 <= pooled.coverage <= 0.97,  # noqa: PLR2004 - the claim's
        )
        covers = {k: s.coverage for k, s in _identified(study, name).items()}
        least, most = min(covers, key=covers.__getitem__), max(covers, key=covers.__getitem__)
        yield _row(
            f"{name}: they cover 90 … 99 % for each parameter",
            f"{100 * covers[least]:.1f} ({least}) … {100 * covers[most]:.1f} ({most}) %",
            covers[least] >= 0.90 and covers[most] <= 0.99,  # noqa: PLR2004 - the claim's
        )
    ls = _pooled(study, "ls")
    yield _row("ls, to compare: RMSE / bound", _ratio(ls))
    yield _row("ls, to compare: 95 % intervals cover", _coverage(ls))


def central(repetitions: int) -> Iterator[Row]:
    """Pointwise differentiation beside ML on the same data."""
    pointwise = _study(
        "central", repetitions, ("ls", "gm"), estimate={"differentiation": "central"}
    )
    fourier = _study("central-ml", repetitions, ("ml",))
    yield from _all_there(pointwise)
    yield from _all_there(fourier)
    for name in ("ls", "gm"):
        found = _identified(pointwise, name)
        worst = max(found, key=lambda parameter: abs(found[parameter].bias_t))
        clear = sum(abs(one.bias_t) > CLEAR_BIAS for one in found.values())
        yield _row(
            f"{name}, central: biased by more than {MANY:g} standard errors",
            f"{abs(found[worst].bias_t):.0f} ({worst}); {clear} of {len(found)} parameters "
            f"by more than {CLEAR_BIAS:g}",
            abs(found[worst].bias_t) > MANY,
        )
        pooled = _pooled(pointwise, name)
        yield _row(f"{name}, central: RMSE / bound", _ratio(pooled))
        yield _row(f"{name}, central: 95 % intervals cover", _coverage(pooled))
    yield _unbiased(fourier, "ml")
    yield _row("ml beside it: RMSE / bound", _ratio(_pooled(fourier, "ml")))
    labels = {"LS": "LS, central", "GM": "GM, central", "ML": "ML, Fourier"}

    def labelled(figure: Figure, statistics: Sequence[StatisticsRow]) -> None:
        bias_figure.fill(figure, statistics)
        for text in figure.axes[0].get_legend().texts:
            name, _, count = text.get_text().partition(" ")
            text.set_text(f"{labels[name]} {count}")

    studies = (MonteCarloRecord.read(_folder(name)) for name in ("central", "central-ml"))
    statistics = [row for study in studies for row in study.rows]
    figure = replace(bias_figure, key="montecarlo_central", fill=labelled)
    for path in save_figures([figure], statistics, _ROOT / "docs" / "figures"):
        if path.suffix != ".png":
            path.unlink()


def length_noise_2mm(repetitions: int) -> Iterator[Row]:
    """Lengths twenty times noisier than the robot's."""
    return _length_noise("2 mm", 1.15, repetitions)


def length_noise_5mm(repetitions: int) -> Iterator[Row]:
    """Lengths fifty times noisier than the robot's."""
    return _length_noise("5 mm", 1.5, repetitions)


def _length_noise(size: str, allowed: float, repetitions: int) -> Iterator[Row]:
    study = _study(
        f"length-{size.replace(' ', '')}",
        repetitions,
        ("gm", "ml"),
        noise={"length_std": [size] * 6},
    )
    yield from _all_there(study)
    gm, ml = _pooled(study, "gm"), _pooled(study, "ml")
    yield _row(
        f"ml, {size}: RMSE / bound at most {allowed:g}", _ratio(ml), ml.rmse_over_bound <= allowed
    )
    largest = max(one.largest_error for one in _identified(study, "ml").values())
    yield _row(
        f"ml, {size}: no outlier runs (no error above {OUTLIER:g} RMSE)",
        f"largest error {largest:.1f} RMSE",
        largest < OUTLIER,
    )
    yield _row(f"gm, {size}: worse than ml", _ratio(gm), gm.rmse_over_bound > ml.rmse_over_bound)
    yield _row(f"ml, {size}: 95 % intervals cover", _coverage(ml))
    worst = f"{ml.largest_bias_t:.1f} standard errors"
    yield _row(f"ml, {size}: largest bias", worst)


def tracking(repetitions: int) -> Iterator[Row]:
    """Tracking error of 1 mm and 0.1° in the harmonics 6 … 15."""
    study = _study(
        "tracking",
        repetitions,
        ("ml",),
        experiment={"tracking_error": {"position": "1 mm", "angle": "0.1 deg"}},
    )
    yield from _all_there(study)
    yield _unbiased(study, "ml")
    counts = pd.Series([r.harmonics for r in study.repetitions]).value_counts().sort_index()
    chosen = ", ".join(f"{k} ({n} times)" for k, n in counts.items())
    yield _row("ml: harmonics chosen, of 15", chosen)
    yield _row("ml: RMSE / bound", _ratio(_pooled(study, "ml")))
    yield _row("ml: 95 % intervals cover", _coverage(_pooled(study, "ml")))


def speed(repetitions: int) -> Iterator[Row]:
    """How long it takes."""
    design = _design()
    run = load_run({"name": "speed", "robot": "palida", "experiment": _sampled(400)})
    robot = robot_from(run.robot)
    knowledge = parameter_knowledge(run, robot)
    twin = Twin.of(run, design)
    times = []
    for number in range(1, 22):
        experiment = prepare_experiment(run, robot, twin.measurement(number), design)
        found = run_estimators(robot, [experiment], knowledge, ("ml",))["ml"]
        times.append(1000 * found.seconds)
    # The first one builds the functions: that is the set-up.
    low, middle, high = np.percentile(times[1:], [10, 50, 90])
    yield _row(
        "ml alone, 400 averaged samples: under 400 ms after set-up",
        f"{middle:.0f} ms ({low:.0f} … {high:.0f})",
        middle < 400,  # noqa: PLR2004 - the claim's
    )
    run = load_run(
        {
            "name": "speed",
            "robot": "palida",
            "experiment": _sampled(2000),
            "montecarlo": {"repetitions": repetitions},
            "workers": 2,
        }
    )
    began = time.perf_counter()
    study = run_study(run, design)
    seconds = time.perf_counter() - began
    done = len(study.repetitions)
    yield _row(
        f"{done} repetitions × 3 estimators on 10 × 2000 samples, 2 workers: under 150 s for 100",
        f"{seconds:.0f} s",
        seconds * 100 / done < 150,  # noqa: PLR2004 - the claim's
    )


SECTIONS: dict[str, tuple[Callable[[int], Iterator[Row]], int]] = {
    "nominal": (nominal, 400),
    "central": (central, 100),
    "length-2mm": (length_noise_2mm, 200),
    "length-5mm": (length_noise_5mm, 200),
    "tracking": (tracking, 200),
    "speed": (speed, 100),
}
"""How each section is measured, and with how many repetitions."""


# --- studies and rows -----------------------------------------------------------------------------


@cache
def _design() -> FourierTrajectory:
    return TrajectoryFile.read(Path(__file__).parent / "designs" / "palida.json").trajectory


def _folder(name: str) -> Path:
    return _ROOT / "runs" / f"benchmark-{name}"


def _sampled(samples: int) -> dict[str, Any]:
    """Return an experiment of ten periods with so many samples each."""
    return {"periods": 10, "sampling": samples / _design().period}


def _study(
    name: str, repetitions: int, estimators: tuple[str, ...], **sections: dict[str, Any]
) -> Study:
    run = load_run(
        {
            "name": f"benchmark-{name}",
            "robot": "palida",
            "montecarlo": {"repetitions": repetitions, "estimators": list(estimators)},
            "workers": 2,
        }
        | sections
    )
    folder = _folder(name)
    study = run_study(run, _design(), folder / JOURNAL)
    record = MonteCarloRecord.of(study)
    record.write(folder)
    record_figures(record, folder)
    return study


def _identified(study: Study, estimator: str) -> dict[str, ParameterStatistics]:
    names = {study.knowledge.names[k] for k in study.identified}
    return {k: one for k, one in study.statistics(estimator).items() if k in names}


def _pooled(study: Study, estimator: str) -> PooledStatistics:
    pooled = study.pooled(estimator)
    if pooled is None:
        raise RuntimeError(f"{estimator} came to no estimate")
    return pooled


def _all_there(study: Study) -> Iterator[Row]:
    for name in study.estimators:
        stuck = sum(not outcome.converged for _, outcome in study.estimated(name))
        failed = len(study.failures(name))
        yield _row(
            f"{name}: every repetition has an estimate that converged",
            f"{len(study.repetitions)} repetitions, {failed} failed, {stuck} not converged",
            failed == stuck == 0,
        )


def _unbiased(study: Study, estimator: str) -> Row:
    found = _identified(study, estimator)
    worst = max(found, key=lambda parameter: abs(found[parameter].bias_t))
    return _row(
        f"{estimator}: bias of all {len(found)} parameters within {CLEAR_BIAS:g} standard errors",
        f"{abs(found[worst].bias_t):.2f} ({worst})",
        abs(found[worst].bias_t) <= CLEAR_BIAS,
    )


def _ratio(pooled: PooledStatistics) -> str:
    return (
        f"{pooled.rmse_over_bound:.3f} ± {pooled.rmse_over_bound_std_error:.3f} "
        f"[{pooled.rmse_over_bound_low:.3f}, {pooled.rmse_over_bound_high:.3f}]"
    )


def _coverage(pooled: PooledStatistics) -> str:
    return (
        f"{100 * pooled.coverage:.2f} ± {100 * pooled.coverage_std_error:.2f} % "
        f"[{100 * pooled.coverage_low:.2f}, {100 * pooled.coverage_high:.2f}]"
    )


def _row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
