"""What the whiteness of residuals says."""

from __future__ import annotations

import numpy as np

from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.whiteness import Whiteness
from estimation.diagnostics.wording import struts as strut_list


def whiteness_finding(
    name: str, test: Whiteness, kind: str, holds: str, fails: str, advice: str
) -> Finding:
    """Tell whether residuals are white: texts for both cases and what to do."""
    if not np.any(test.failed):
        worst = float(np.max(np.abs(test.autocorrelation)))
        return Finding(name, Outcome.HOLDS, f"{holds} (largest autocorrelation {worst:.3f})")
    struts = np.flatnonzero(test.failed)
    return Finding(name, Outcome.FAILS, f"{fails} in {strut_list(kind, struts)}", advice)
