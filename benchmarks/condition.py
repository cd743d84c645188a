"""The deterministic design (condition number) against the D-optimal one, PaLiDA, n = 5."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

import expdesign

TITLE = "Condition number against log det"

_SEARCH = {"search": "restarts"}


def rows(starts: int = 4) -> Iterator[dict[str, Any]]:
    """Yield a row for the D-optimal design, then one for each scaling of the condition number."""
    for criterion, scaling in (("d", "si"), ("condition", "si"), ("condition", "nominal")):
        began = time.perf_counter()
        result = expdesign.design(
            {
                "name": f"{criterion}-{scaling}",
                "robot": "palida",
                "design": {"criterion": criterion, "scaling": scaling, "starts": starts} | _SEARCH,
            }
        )
        nominal = np.abs(result.robot.parameters)
        by_nominal = result.information * np.multiply.outer(nominal, nominal)
        yield {
            "criterion": criterion,
            "scaling": scaling,
            "cond F, SI": f"{np.linalg.cond(result.information):.3g}",
            "cond F, nominal": f"{np.linalg.cond(by_nominal):.3g}",
            "log det F": round(result.log_det_information, 2),
            "status": result.status,
            "seconds": round(time.perf_counter() - began),
        }


def summary(table: pd.DataFrame) -> str:
    """Return how many times smaller the condition numbers are than the D-optimal design's."""
    si, nominal = table["cond F, SI"].astype(float), table["cond F, nominal"].astype(float)
    return (
        f"condition smaller than the D-optimal design's: {si[0] / si[1]:.0f} times (SI), "
        f"{nominal[0] / nominal[2]:.1f} times (nominal)"
    )
