"""Which parameters an experiment is too weak to identify."""

from __future__ import annotations

import numpy as np

from expdesign.experiment.result import PredictedPrecision
from expdesign.experiment.scaling import parameter_scaling
from expdesign.robot import Robot

IDENTIFIABLE = 0.5
"""A parameter counts as identified below this standard deviation, as a share of its scale."""

_LARGE = 100.0


def imprecise(robot: Robot, precision: PredictedPrecision) -> tuple[str, ...]:
    """Return a warning that names the parameters that the experiment does not identify.

    Parameters
    ----------
    robot : Robot
    precision : PredictedPrecision
        Of the whole experiment. The scale of a parameter is its nominal value; where that is zero,
        its physical size (`parameter_scaling`).

    Returns
    -------
    tuple of str
        Empty when every parameter that is judged is identified.
    """
    scales = dict(zip(robot.parameter_names, parameter_scaling(robot, "nominal"), strict=True))
    share = {name: std / float(scales[name]) for name, std in precision.std.items()}
    weak = [f"{name} ({_percent(value)})" for name, value in share.items() if _weak(value)]
    if not weak:
        return ()
    return (
        "not identifiable with this experiment (predicted standard deviation above "
        f"{100 * IDENTIFIABLE:g} % of the parameter): {', '.join(weak)}",
    )


def _weak(share: float) -> bool:
    return not share <= IDENTIFIABLE


def _percent(share: float) -> str:
    if not np.isfinite(share):
        return "without bound"
    return f"{100 * share:.2g} %" if share > _LARGE else f"{100 * share:.0f} %"
