"""How well 95 % intervals cover when the noise has a memory, and the level of GM against ML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from benchmarks.studies import (
    Row,
    all_there,
    claim_row,
    coverage_text,
    equivalent_run,
    palida_design,
    palida_study,
    pooled_over,
    ratio_text,
)
from estimation.estimators import covariance_ml_less_gm
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.montecarlo.result import PooledStatistics
from estimation.twin import Twin
from estimation.uncertainty.intervals import difference_test
from expdesign.robot import robot_from

_COVERS = (0.93, 0.97)
_NEXT_TO_THE_BOUND = 1.05
_LEVEL, _OFF_LEVEL = 0.05, 0.015
_SAMPLES = 250
"""Of a period, where many recordings are needed."""


def _band(share: float) -> dict[str, Any]:
    return {"band": {"frequency": "3 Hz", "width": "0.5 Hz", "share": share}}


NOISES: dict[str, dict[str, Any]] = {
    "white": {},
    "AR(1), 0.5": {"force_spectrum": {"ar": 0.5}, "length_spectrum": {"ar": 0.5}},
    "AR(1), 0.9": {"force_spectrum": {"ar": 0.9}, "length_spectrum": {"ar": 0.9}},
    "1 % of the variance at 3 Hz": {"force_spectrum": _band(0.01)},
    "2 % of the variance at 3 Hz": {"force_spectrum": _band(0.02)},
    "hum, 5 N at 50 Hz": {"force_spectrum": {"hum": {"frequency": "50 Hz", "amplitude": "5 N"}}},
}


def _key(name: str) -> str:
    """Return the name of a study, without signs that a folder's name does not have."""
    return "noise-" + re.sub(r"[^a-z0-9.]+", "-", name.lower())


def noise(repetitions: int) -> Iterator[Row]:
    """Yield every kind of noise, 10 periods at 1 kHz."""
    for name, spectrum in NOISES.items():
        study = palida_study(_key(name), repetitions, ("gm", "ml"), noise=spectrum)
        yield from all_there(study)
        for estimator in ("gm", "ml"):
            pooled = pooled_over(study, estimator)
            yield _covers(f"{name}: {estimator}", pooled)
            yield claim_row(
                f"{name}: {estimator}: RMSE / bound at most 1.05",
                ratio_text(pooled),
                pooled.rmse_over_bound <= _NEXT_TO_THE_BOUND,
            )


def few_periods(repetitions: int) -> Iterator[Row]:
    """Yield what 3 and 5 periods show of the noise."""
    for periods in (3, 5):
        for name in ("white", "AR(1), 0.9"):
            study = palida_study(
                f"{_key(name)}-{periods}-periods",
                repetitions,
                ("gm", "ml"),
                noise=NOISES[name],
                experiment={"periods": periods},
            )
            for estimator in ("gm", "ml"):
                pooled = pooled_over(study, estimator)
                yield _covers(f"{periods} periods, {name}: {estimator}", pooled)
                claim = f"{periods} periods, {name}: {estimator}: RMSE / bound"
                yield claim_row(claim, ratio_text(pooled))


def tracking(repetitions: int) -> Iterator[Row]:
    """Yield 50 µm of tracking error in the harmonics 6 to 30, hidden in 1 mm of length noise."""
    study = palida_study(
        "tracking-50um",
        repetitions,
        ("ml",),
        noise={"length_std": ["1 mm"] * 6},
        experiment={"tracking_error": {"position": "50 um", "angle": 0, "harmonics": [6, 30]}},
    )
    yield _covers("tracking error of 50 µm: ml", pooled_over(study, "ml"))


def difference(length_noise: float, repetitions: int) -> Iterator[Row]:
    """Yield how often GM and ML are said to differ where nothing is wrong.

    Ten periods of fewer samples than at 1 kHz, with as much less noise. `length_noise` is that of
    the lengths at 1 kHz, mm.
    """
    count = max(1, repetitions // 40)
    found = Parallel(n_jobs=2)(
        delayed(_differences)(length_noise, range(first, min(first + count, repetitions + 1)))
        for first in range(1, repetitions + 1, count)
    )
    tests = np.array([test for part in found for test in part])
    statistic, freedom, p = tests[:, 0], tests[:, 1], tests[:, 2]
    tested = freedom > 0
    share = float(np.mean(p[tested] < _LEVEL)) if np.any(tested) else np.nan
    error = float(np.sqrt(_LEVEL * (1 - _LEVEL) / max(int(np.count_nonzero(tested)), 1)))
    yield claim_row(
        f"{length_noise:g} mm: GM and ML differ at 5 % in 3.5 … 6.5 %",
        f"{100 * share:.1f} ± {100 * error:.1f} % of {np.count_nonzero(tested)} that were tested",
        abs(share - _LEVEL) <= _OFF_LEVEL,
    )
    ratio = float(np.sum(statistic)) / max(1.0, float(np.sum(freedom)))
    yield claim_row(
        f"{length_noise:g} mm: statistic / freedom", f"{ratio:.3f}, freedom {np.mean(freedom):.1f}"
    )


def _differences(length_noise: float, numbers: range) -> list[tuple[float, float, float]]:
    design, run = palida_design(), equivalent_run("difference", _SAMPLES, length_noise)
    robot, twin = robot_from(run.robot), Twin.of(run, design, seed=5)
    knowledge = parameter_priors(run, robot)
    found: list[tuple[float, float, float]] = []
    with threadpool_limits(limits=1):
        for number in numbers:
            experiment = prepare_experiment(run, robot, twin.measurement(number), design)
            if experiment.harmonics_left_out:  # ML of more motion than GM is not compared with it
                found.append((0.0, 0.0, np.nan))
                continue
            estimates = run_estimators(robot, [experiment], knowledge, ("gm", "ml"))
            covariance = covariance_ml_less_gm(estimates)
            if covariance is None:
                raise RuntimeError("there are both")
            gm, ml = estimates["gm"], estimates["ml"]
            test = difference_test(gm.values, ml.values, covariance, ml.covariance)
            found.append((test.statistic, test.freedom, test.p_joint))
    return found


def _covers(what: str, pooled: PooledStatistics) -> Row:
    low, high = _COVERS
    return claim_row(
        f"{what}: 95 % intervals cover 93 … 97 %",
        coverage_text(pooled),
        low <= pooled.coverage <= high,
    )


SECTIONS: dict[str, tuple[Callable[[int], Iterator[Row]], int]] = {
    "noise": (noise, 200),
    "few-periods": (few_periods, 200),
    "tracking": (tracking, 200),
    "difference-1mm": (partial(difference, 1.0), 2000),
    "difference-3mm": (partial(difference, 3.0), 2000),
}
"""How each section is measured, and with how many repetitions."""
