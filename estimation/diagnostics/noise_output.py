"""The files of a noise analysis in its run folder. Values are SI."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from estimation.diagnostics.json_form import plain
from estimation.diagnostics.noise_analysis import NoiseAnalysis
from estimation.processing.noise import NoiseEstimate
from expdesign.configuration import RunConfiguration, resolved_yaml
from expdesign.runfolder.atomic import write_csv, write_json, write_text
from expdesign.runfolder.columns import add_columns
from expdesign.runfolder.described import Column

NOISE_COVARIANCE = (
    Column("quantity", "", "force or length"),
    Column("row", "1", "strut"),
    Column("column", "1", "strut"),
    Column("covariance", "N^2 or m^2", "of one sample"),
    Column("std_error", "N^2 or m^2", "standard error of the covariance"),
    Column("correlation", "1", "of one sample"),
)
"""Columns of `tables/noise_covariance.csv`."""


def write_noise(
    analysis: NoiseAnalysis, source: str, configuration: RunConfiguration, folder: Path
) -> list[Path]:
    """Write `noise.json`, its table, `columns.json` and `run.yaml`; return the files of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "tables" / "noise_covariance.csv"
    write_csv(table, covariance_table(analysis))
    record = folder / "noise.json"
    write_json(record, noise_record(analysis, source))
    write_text(folder / "run.yaml", resolved_yaml(configuration))
    return [table, add_columns(folder, {f"tables/{table.name}": NOISE_COVARIANCE}), record]


def noise_record(analysis: NoiseAnalysis, source: str) -> dict[str, Any]:
    """Return what `noise.json` states; its covariances can be copied into a robot or run file."""
    record = analysis.record
    return {
        "units": "SI and radians",
        "recording": source,
        "rows": record.rows,
        "periods": record.periods,
        "period": record.period,
        "averaged": record.averaged,
        "force_std": plain(np.sqrt(np.diag(analysis.noise.force_covariance))),
        "length_std": plain(np.sqrt(np.diag(analysis.noise.length_covariance))),
        **analysis.as_dict(),
    }


def covariance_table(analysis: NoiseAnalysis) -> pd.DataFrame:
    """Return Σ and Δ element by element."""
    noise = analysis.noise
    rows = []
    for quantity, estimate in (
        ("force", NoiseEstimate(noise.force_covariance, noise.force_freedom)),
        ("length", NoiseEstimate(noise.length_covariance, noise.length_freedom)),
    ):
        std, errors = np.sqrt(np.diag(estimate.covariance)), estimate.std_error()
        rows += [
            {
                "quantity": quantity,
                "row": i + 1,
                "column": j + 1,
                "covariance": estimate.covariance[i, j],
                "std_error": errors[i, j],
                "correlation": estimate.covariance[i, j] / (std[i] * std[j]),
            }
            for i, j in np.ndindex(6, 6)
        ]
    return pd.DataFrame(rows, columns=[column.name for column in NOISE_COVARIANCE])
