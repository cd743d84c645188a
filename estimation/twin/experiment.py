"""The digital twin: a designed motion, executed and measured as the run file describes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.twin.disturbances import (
    Repeated,
    Shared,
    cogging_force,
    executed_motion,
    experiment_stream,
    final_drift,
    gross_errors,
    length_drift,
    noise_covariances,
    noise_draws,
    quantised,
    repetition_stream,
)
from estimation.twin.record import (
    DisturbanceKeys,
    ExecutedTableTruth,
    ExperimentKeys,
    SeedKeys,
    Truth,
)
from estimation.twin.sampling import SampleGrid
from estimation.twin.table_motion import TableMotion, refuse_short_window, window_error
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.sections.experiment import ExperimentSection
from expdesign.export.table_file import TableFile
from expdesign.recheck.judge import Motion
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory

_BLOCK = 4096
"""Samples whose regressors (144 values each) are in memory at once."""


@dataclass(frozen=True, eq=False)
class Twin:
    """An experiment that can be repeated as often as wanted.

    Motion and forces without noise are computed once, when it is built; a repetition costs its
    random draws. It can be pickled, and every process draws the same repetition k.
    """

    truth: Truth
    section: ExperimentSection
    grid: SampleGrid
    lengths: Array
    """(T, 6), what the length sensors would read without noise, outliers and quantisation, m: the
    executed motion's lengths and the drift."""
    forces: Array
    """(T, 6), the same of the forces, N: those of the model with the exact friction signs, and
    cogging."""

    @classmethod
    def of(
        cls,
        configuration: RunConfiguration,
        commanded: FourierTrajectory | TableFile,
        seed: int | None = None,
    ) -> Twin:
        """Build the twin of a run.

        Parameters
        ----------
        configuration : RunConfiguration
            Its robot's nominal parameters are the true ones.
        commanded : FourierTrajectory or TableFile
            The motion that is commanded: a designed one, or the measurement window of a
            controller table, interpolated as its controller does.
        seed : int, optional
            Of the repetitions; that of the experiment by default. What all repetitions share
            (tracking error, drift) always comes from the experiment's.

        Raises
        ------
        InputError
            The noise is not known, the number of samples is impossible, the robot cannot make
            this motion, or the table has fewer periods than the experiment.
        """
        section = configuration.run.experiment
        force_covariance, length_covariance = noise_covariances(configuration)
        design = commanded if isinstance(commanded, FourierTrajectory) else commanded.design
        grid = SampleGrid.of(design.period, section, configuration.file)
        robot = robot_from(configuration.robot)
        executed = executed_motion(
            design, section.tracking_error, experiment_stream(section.seed, Shared.TRACKING_ERROR)
        )
        table: ExecutedTableTruth | None = None
        if isinstance(commanded, FourierTrajectory):
            lengths, forces = map(grid.repeated, _undisturbed(robot, executed, grid.distinct_times))
        else:
            # Rows and rounding of a table differ from period to period.
            refuse_short_window(commanded, section.periods, configuration.file)
            table = ExecutedTableTruth(
                file=commanded.path.name,
                format=commanded.settings.section.format,
                sha256=commanded.digest,
                window=commanded.window,
                position_error=window_error(commanded, grid.times),
            )
            motion = TableMotion(commanded, design, executed)
            lengths, forces = _undisturbed(robot, motion, grid.times)
        if not (np.all(np.isfinite(lengths)) and np.all(np.isfinite(forces))):
            raise InputError(
                f"the robot {robot.name} cannot make the motion of the design: it passes "
                "through a singularity",
                file=configuration.file,
                key="robot",
                allowed="a design that was made for this robot",
            )
        if section.cogging is not None:
            forces = forces + cogging_force(lengths, section.cogging)
        drift: dict[str, Any] | None = None
        if section.drift > 0:
            final = final_drift(section.drift, experiment_stream(section.seed, Shared.DRIFT))
            lengths = lengths + length_drift(final, grid.times, grid.duration)
            drift = {"size": section.drift, "final": final}
        truth = Truth(
            name=configuration.run.name,
            robot=robot.name,
            parameters=dict(configuration.robot.parameters),
            experiment=ExperimentKeys(
                section.periods,
                section.sampling,
                grid.count,
                grid.per_period or grid.period * grid.sampling,
            ),
            design=design,
            executed=executed,
            force_covariance=force_covariance,
            length_covariance=length_covariance,
            table=table,
            disturbances=DisturbanceKeys(
                drift=drift,
                **section.model_dump(
                    include={"tracking_error", "cogging", "quantisation", "outliers"}
                ),
            ),
            seeds=SeedKeys(section.seed, section.seed if seed is None else seed),
        )
        return cls(truth, section, grid, lengths, forces)

    def measurement(self, repetition: int = 1) -> Measurement:
        """Return what repetition `repetition`, counted from 1, measures.

        It depends on the configuration, the design, the seed and the number alone.
        """
        section, count, truth = self.section, self.grid.count, self.truth

        def stream(purpose: Repeated) -> np.random.Generator:
            return repetition_stream(truth.seeds.repetitions, repetition, purpose)

        lengths = self.lengths + noise_draws(
            truth.length_covariance, count, stream(Repeated.LENGTH_NOISE)
        )
        forces = self.forces + noise_draws(
            truth.force_covariance, count, stream(Repeated.FORCE_NOISE)
        )
        if section.outliers is not None:
            length_errors, force_errors = gross_errors(
                section.outliers, count, stream(Repeated.OUTLIERS)
            )
            lengths += length_errors
            forces += force_errors
        if section.quantisation is not None:
            lengths = quantised(lengths, section.quantisation.length)
            forces = quantised(forces, section.quantisation.force)
        return self.recorded(
            lengths, forces, f"digital twin of {truth.name}, repetition {repetition}"
        )

    def recorded(self, lengths: Array, forces: Array, source: str = "") -> Measurement:
        """Return lengths (m) and forces (N) of all samples, (T, 6) each, as a measurement."""
        return Measurement(
            time=self.grid.times,
            lengths=lengths,
            forces=forces,
            step=1 / self.grid.sampling,
            period=self.grid.period_numbers,
            source=source,
        )


def _undisturbed(robot: Robot, motion: Motion, times: Array) -> tuple[Array, Array]:
    """Return strut lengths (m) and actuator forces (N) of a motion, (D, 6) each."""
    lengths, forces = [], []
    for start in range(0, len(times), _BLOCK):
        # A motion of absurd size ends in infinities, which the caller refuses.
        with np.errstate(all="ignore"):
            samples = motion.sample(times[start : start + _BLOCK])
            lengths.append(robot.inverse_kinematics(samples.pose))
            forces.append(robot.actuator_forces(*samples))
    return np.concatenate(lengths), np.concatenate(forces)
