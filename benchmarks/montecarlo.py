"""PaLiDA, the design of n = 5, 10 periods at 1 kHz: bias, RMSE and coverage of the estimators.

Every study keeps its repetitions in `runs/benchmark-…`: one that is stopped goes on from there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmarks.studies import (
    CLEAR_BIAS,
    ROOT,
    Row,
    all_there,
    claim_row,
    coverage_text,
    identified_in,
    palida_design,
    palida_study,
    pooled_over,
    ratio_text,
    sampled_experiment,
    study_folder,
    summary,
    unbiased,
)
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.montecarlo import run_study
from estimation.montecarlo.result import MonteCarloResult, StatisticsRow
from estimation.twin import Twin
from expdesign.configuration import load_run
from expdesign.robot import robot_from
from results.figures.drawing import save_figures
from results.figures.studies import bias_figure

__all__ = ["SECTIONS", "TITLE", "rows", "summary"]

TITLE = "Monte-Carlo study"

MANY = 10.0
"""Standard errors that are "many"."""

OUTLIER = 6.0
"""Largest error of a study without outlier runs, in units of the RMSE."""


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` instead of what the claim is about."""
    measure, wanted = SECTIONS[section]
    return measure(repetitions or wanted)


# --- sections -------------------------------------------------------------------------------------


def nominal(repetitions: int) -> Iterator[Row]:
    """Fourier differentiation, noise of the robot file, all three estimators."""
    study = palida_study("nominal", repetitions, ("ls", "gm", "ml"))
    yield from all_there(study)
    for name in ("gm", "ml"):
        pooled = pooled_over(study, name)
        yield unbiased(study, name)
        yield claim_row(
            f"{name}: RMSE / bound in 0.93 … 1.07",
            ratio_text(pooled),
            0.93 <= pooled.rmse_over_bound <= 1.07,  # noqa: PLR2004 - the claim's
        )
        yield claim_row(
            f"{name}: 95 % intervals cover 93 … 97 %, pooled",
            coverage_text(pooled),
            0.93 <= pooled.coverage <= 0.97,  # noqa: PLR2004 - the claim's
        )
        covers = {k: s.coverage for k, s in identified_in(study, name).items()}
        least, most = min(covers, key=covers.__getitem__), max(covers, key=covers.__getitem__)
        yield claim_row(
            f"{name}: they cover 90 … 99 % for each parameter",
            f"{100 * covers[least]:.1f} ({least}) … {100 * covers[most]:.1f} ({most}) %",
            covers[least] >= 0.90 and covers[most] <= 0.99,  # noqa: PLR2004 - the claim's
        )
    ls = pooled_over(study, "ls")
    yield claim_row("ls, to compare: RMSE / bound", ratio_text(ls))
    yield claim_row("ls, to compare: 95 % intervals cover", coverage_text(ls))


def central(repetitions: int) -> Iterator[Row]:
    """Pointwise differentiation beside ML on the same data."""
    pointwise = palida_study(
        "central", repetitions, ("ls", "gm"), estimate={"differentiation": "central"}
    )
    fourier = palida_study("central-ml", repetitions, ("ml",))
    yield from all_there(pointwise)
    yield from all_there(fourier)
    for name in ("ls", "gm"):
        found = identified_in(pointwise, name)
        worst = max(found, key=lambda parameter: abs(found[parameter].bias_t))
        clear = sum(abs(one.bias_t) > CLEAR_BIAS for one in found.values())
        yield claim_row(
            f"{name}, central: biased by more than {MANY:g} standard errors",
            f"{abs(found[worst].bias_t):.0f} ({worst}); {clear} of {len(found)} parameters "
            f"by more than {CLEAR_BIAS:g}",
            abs(found[worst].bias_t) > MANY,
        )
        pooled = pooled_over(pointwise, name)
        yield claim_row(f"{name}, central: RMSE / bound", ratio_text(pooled))
        yield claim_row(f"{name}, central: 95 % intervals cover", coverage_text(pooled))
    yield unbiased(fourier, "ml")
    yield claim_row("ml beside it: RMSE / bound", ratio_text(pooled_over(fourier, "ml")))
    labels = {"LS": "LS, central", "GM": "GM, central", "ML": "ML, Fourier"}

    def labelled(figure: Figure, statistics: Sequence[StatisticsRow]) -> None:
        bias_figure.fill(figure, statistics)
        legend = figure.axes[0].get_legend()
        for text in () if legend is None else legend.texts:
            name, _, count = text.get_text().partition(" ")
            text.set_text(f"{labels[name]} {count}")

    studies = (MonteCarloResult.read(study_folder(name)) for name in ("central", "central-ml"))
    statistics = [row for study in studies for row in study.rows]
    figure = replace(bias_figure, key="montecarlo_central", fill=labelled)
    for path in save_figures([figure], statistics, ROOT / "docs" / "figures"):
        if path.suffix != ".png":
            path.unlink()


def length_noise_2mm(repetitions: int) -> Iterator[Row]:
    """Lengths twenty times noisier than the robot's."""
    return _length_noise("2 mm", 1.15, repetitions)


def length_noise_5mm(repetitions: int) -> Iterator[Row]:
    """Lengths fifty times noisier than the robot's."""
    return _length_noise("5 mm", 1.5, repetitions)


def _length_noise(size: str, allowed: float, repetitions: int) -> Iterator[Row]:
    study = palida_study(
        f"length-{size.replace(' ', '')}",
        repetitions,
        ("gm", "ml"),
        noise={"length_std": [size] * 6},
    )
    yield from all_there(study)
    gm, ml = pooled_over(study, "gm"), pooled_over(study, "ml")
    yield claim_row(
        f"ml, {size}: RMSE / bound at most {allowed:g}",
        ratio_text(ml),
        ml.rmse_over_bound <= allowed,
    )
    largest = max(one.largest_error for one in identified_in(study, "ml").values())
    yield claim_row(
        f"ml, {size}: no outlier runs (no error above {OUTLIER:g} RMSE)",
        f"largest error {largest:.1f} RMSE",
        largest < OUTLIER,
    )
    yield claim_row(
        f"gm, {size}: worse than ml", ratio_text(gm), gm.rmse_over_bound > ml.rmse_over_bound
    )
    yield claim_row(f"ml, {size}: 95 % intervals cover", coverage_text(ml))
    worst = f"{ml.largest_bias_t:.1f} standard errors"
    yield claim_row(f"ml, {size}: largest bias", worst)


def tracking(repetitions: int) -> Iterator[Row]:
    """Tracking error of 1 mm and 0.1° in the harmonics 6 … 15."""
    study = palida_study(
        "tracking",
        repetitions,
        ("ml",),
        experiment={"tracking_error": {"position": "1 mm", "angle": "0.1 deg"}},
    )
    yield from all_there(study)
    yield unbiased(study, "ml")
    counts = pd.Series([r.harmonics for r in study.repetitions]).value_counts().sort_index()
    chosen = ", ".join(f"{k} ({n} times)" for k, n in counts.items())
    yield claim_row("ml: harmonics chosen, of 15", chosen)
    yield claim_row("ml: RMSE / bound", ratio_text(pooled_over(study, "ml")))
    yield claim_row("ml: 95 % intervals cover", coverage_text(pooled_over(study, "ml")))


def speed(repetitions: int) -> Iterator[Row]:
    """How long it takes."""
    design = palida_design()
    run = load_run({"name": "speed", "robot": "palida", "experiment": sampled_experiment(400)})
    robot = robot_from(run.robot)
    knowledge = parameter_priors(run, robot)
    twin = Twin.of(run, design)
    times = []
    for number in range(1, 22):
        experiment = prepare_experiment(run, robot, twin.measurement(number), design)
        found = run_estimators(robot, [experiment], knowledge, ("ml",))["ml"]
        times.append(1000 * found.seconds)
    # The first one builds the functions: that is the set-up.
    low, middle, high = np.percentile(times[1:], [10, 50, 90])
    yield claim_row(
        "ml alone, 400 averaged samples: under 400 ms after set-up",
        f"{middle:.0f} ms ({low:.0f} … {high:.0f})",
        middle < 400,  # noqa: PLR2004 - the claim's
    )
    run = load_run(
        {
            "name": "speed",
            "robot": "palida",
            "experiment": sampled_experiment(2000),
            "montecarlo": {"repetitions": repetitions},
            "workers": 2,
        }
    )
    began = time.perf_counter()
    study = run_study(run, design)
    seconds = time.perf_counter() - began
    done = len(study.repetitions)
    yield claim_row(
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
