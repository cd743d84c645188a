"""The Cramér–Rao bound of a simulated experiment, at its truth."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, cramer_rao_covariance
from estimation.kinematics.fourier_fit import MotionFit
from estimation.measurement_model import HarmonicMotion
from estimation.montecarlo.repetition import Workbench
from estimation.processing import NoiseModel, PeriodSource, make_record
from expdesign.mechanism.hexapod import ACTUATORS


def bound_at_truth(bench: Workbench) -> Array:
    """Return the bound as a covariance, (m, m), SI; zero for fixed parameters.

    At the true parameters along the executed motion, whose harmonics are the kinematic unknowns,
    with the true Σ and Δ, the exact signs of dry friction, and all samples of the experiment. A
    prior counts as data.

    Raises
    ------
    UnidentifiableError
        The experiment does not determine every free parameter.
    """
    twin, truth = bench.twin, bench.twin.truth
    free_frequency = bench.configuration.run.estimate.frequency == "estimated"
    measured = Measurement(
        time=twin.grid.times,
        lengths=twin.lengths,
        forces=twin.forces,
        step=1 / twin.grid.sampling,
        period=twin.grid.period_numbers,
        source="",
    )
    record = make_record(
        measured, truth.executed.omega, PeriodSource.DESIGN, average=not free_frequency
    )
    motion = HarmonicMotion.of(truth.executed)
    unknowns = motion.table.size + int(free_frequency)
    # The motion is known here: nothing of the fit but the motion itself is used.
    known = MotionFit(
        motion=motion,
        covariance=np.zeros((unknowns, unknowns)),
        residuals=np.zeros((record.samples, ACTUATORS)),
        free_frequency=free_frequency,
    )
    noise = NoiseModel.given(truth.force_covariance, truth.length_covariance)
    spread = np.zeros((record.samples, bench.robot.graph.signs.numel()))
    experiment = Experiment.along(bench.robot, record, noise, known, spread)
    return cramer_rao_covariance(
        bench.robot, [experiment], [motion], bench.knowledge, truth.parameter_vector
    )
