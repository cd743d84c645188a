"""What benchmarks of simulated experiments share: their studies, and the rows of their tables."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimation.montecarlo import MonteCarloResult, run_study
from estimation.montecarlo.result import PooledStatistics, StatisticsRow
from estimation.montecarlo.study import NAME as JOURNAL
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration, load_run
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from results import draw_figures
from results.views.experiment import montecarlo_view
from results.views.folder import RunFolder

CLEAR_BIAS = 3.5
"""Standard errors from which on a bias is no chance."""

ROOT = Path(__file__).resolve().parents[1]

Row = dict[str, Any]


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    judged = table[table["holds"] != ""]
    broken = judged[judged["holds"] == "no"]
    if not len(judged):
        return "no claims"
    text = f"{len(judged) - len(broken)} of {len(judged)} claims hold"
    return text if not len(broken) else f"{text}; not: " + "; ".join(broken["claim"])


@cache
def palida_design() -> FourierTrajectory:
    """Return the design of n = 5 for PaLiDA."""
    return TrajectoryFile.read(Path(__file__).parent / "designs" / "palida.json").trajectory


def study_folder(name: str) -> Path:
    """Return the run folder of a study."""
    return ROOT / "runs" / f"benchmark-{name}"


def sampled_experiment(samples: int) -> dict[str, Any]:
    """Return an experiment of ten periods with so many samples each."""
    return {"periods": 10, "sampling": samples / palida_design().period}


def equivalent_run(
    name: str, samples: int, length_noise: float = 0.1, **sections: dict[str, Any]
) -> RunConfiguration:
    """Return ten periods of few samples that tell as much as those at 1 kHz.

    They have as much less noise. `length_noise` is that of the lengths at 1 kHz, mm.
    """
    less = samples / (1e3 * palida_design().period)
    known = Twin.of(load_run({"name": name, "robot": "palida"}), palida_design(), seed=0).truth
    noise = {
        "length_std": [f"{np.sqrt(less) * length_noise} mm"] * 6,
        "force_covariance": (less * known.force_covariance).tolist(),
    }
    return load_run(
        {
            "name": name,
            "robot": "palida",
            "experiment": sampled_experiment(samples),
            "noise": noise,
        }
        | sections
    )


def palida_study(
    name: str, repetitions: int, estimators: tuple[str, ...], **sections: dict[str, Any]
) -> MonteCarloResult:
    """Run a study of PaLiDA, or go on with one that was stopped."""
    run = load_run(
        {
            "name": f"benchmark-{name}",
            "robot": "palida",
            "montecarlo": {"repetitions": repetitions, "estimators": list(estimators)},
            "workers": 2,
        }
        | sections
    )
    folder = study_folder(name)
    study = run_study(run, palida_design(), folder / JOURNAL)
    study.write(folder)
    view = montecarlo_view(RunFolder(folder, {}, run, results={MonteCarloResult: study}))
    draw_figures(view, folder)
    return study


def identified_in(study: MonteCarloResult, estimator: str) -> dict[str, StatisticsRow]:
    """Return the statistics of the parameters that are identified."""
    return {k: one for k, one in study.statistics(estimator).items() if one.identified}


def pooled_over(study: MonteCarloResult, estimator: str) -> PooledStatistics:
    """Return the statistics of all parameters together."""
    pooled = study.estimators[estimator].pooled
    if pooled is None:
        raise RuntimeError(f"{estimator} came to no estimate")
    return pooled


def all_there(study: MonteCarloResult) -> Iterator[Row]:
    """Yield whether every repetition has an estimate."""
    for name, found in study.estimators.items():
        stuck, failed = len(found.not_converged), len(found.failures)
        yield claim_row(
            f"{name}: every repetition has an estimate that converged",
            f"{len(study.repetitions)} repetitions, {failed} failed, {stuck} not converged",
            failed == stuck == 0,
        )


def unbiased(study: MonteCarloResult, estimator: str) -> Row:
    """Return whether no parameter has a clear bias."""
    found = identified_in(study, estimator)
    worst = max(found, key=lambda parameter: abs(found[parameter].bias_t))
    return claim_row(
        f"{estimator}: bias of all {len(found)} parameters within {CLEAR_BIAS:g} standard errors",
        f"{abs(found[worst].bias_t):.2f} ({worst})",
        abs(found[worst].bias_t) <= CLEAR_BIAS,
    )


def ratio_text(pooled: PooledStatistics) -> str:
    """Return RMSE over bound in words."""
    return (
        f"{pooled.rmse_over_bound:.3f} ± {pooled.rmse_over_bound_std_error:.3f} "
        f"[{pooled.rmse_over_bound_low:.3f}, {pooled.rmse_over_bound_high:.3f}]"
    )


def coverage_text(pooled: PooledStatistics) -> str:
    """Return the coverage in words."""
    return (
        f"{100 * pooled.coverage:.2f} ± {100 * pooled.coverage_std_error:.2f} % "
        f"[{100 * pooled.coverage_low:.2f}, {100 * pooled.coverage_high:.2f}]"
    )


def claim_row(claim: str, value: str, holds: bool | None = None) -> Row:
    """Return one row; a value that nothing is claimed of has no verdict."""
    return {"claim": claim, "value": value, "holds": {None: "", True: "yes", False: "no"}[holds]}
