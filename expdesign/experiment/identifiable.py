"""Which parameters an experiment is too weak to identify."""

from __future__ import annotations

import numpy as np

from expdesign.experiment.result import PredictedPrecision
from expdesign.robot import Robot

IDENTIFIABLE = 0.5
"""A parameter counts as identified below this standard deviation, as a share of its scale."""

_LARGE = 100.0


def imprecise(robot: Robot, precision: PredictedPrecision) -> tuple[str, ...]:
    """Return a warning that names what the whole experiment does not identify, or nothing."""
    scales = dict(zip(robot.parameter_names, robot.scales, strict=True))
    share = {name: std / float(scales[name]) for name, std in precision.std.items()}
    weak = [f"{n} ({_percent(value)})" for n, value in share.items() if not value <= IDENTIFIABLE]
    if not weak:
        return ()
    return (
        "not identifiable with this experiment (predicted standard deviation above "
        f"{100 * IDENTIFIABLE:g} % of the parameter): {', '.join(weak)}",
    )


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "without bound"
    return f"{100 * share:.2g} %" if share > _LARGE else f"{100 * share:.0f} %"
