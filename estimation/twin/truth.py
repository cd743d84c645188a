"""What is true of a simulated experiment, against which an estimate is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ExperimentSection
from expdesign.runfolder import described
from expdesign.trajectory import FourierTrajectory


@dataclass(frozen=True)
class ExecutedTableTruth:
    """A controller table that the machine executed instead of the series itself."""

    file: Annotated[str, described("", "name of the file")]
    format: Annotated[str, described("", "name of its format")]
    sha256: Annotated[str, described("", "of the file")]
    window: Annotated[
        tuple[float, float],
        described("s", "measurement window: beginning and end, from the start of the table"),
    ]
    position_error: Annotated[
        float, described("m", "by which the struts are off `executed` at most")
    ]


@dataclass(frozen=True, eq=False)
class Truth:
    """The true values behind simulated measurements.

    Attributes
    ----------
    parameters : mapping
        By name in the order of the regressor's columns, SI.
    design : FourierTrajectory
        The motion that was commanded, t = 0 at the first sample.
    executed : FourierTrajectory
        The motion that was made; that of the design without tracking error.
    force_covariance : (6, 6)
        Σ of one sample, N².
    length_covariance : (6, 6)
        Δ of one sample, m².
    experiment : ExperimentSection
        Periods, sampling, seed and disturbances.
    samples : int
        Rows of a measurement.
    samples_per_period : float
        Whole or not.
    final_drift : (6,)
        Drift of the measured lengths at the end, m.
    seed : int
        Of the repetitions' streams; that of the experiment unless another was asked for.
    table : ExecutedTableTruth or None
        The controller table that the machine executed; None when it executed the design itself.
    """

    name: str
    robot: str
    parameters: Mapping[str, float]
    design: FourierTrajectory
    executed: FourierTrajectory
    force_covariance: Array
    length_covariance: Array
    experiment: ExperimentSection
    samples: int
    samples_per_period: float
    final_drift: Array
    seed: int
    table: ExecutedTableTruth | None = None

    @property
    def parameter_vector(self) -> Array:
        """(m,) the parameters in their order, SI."""
        return np.array(list(self.parameters.values()))
