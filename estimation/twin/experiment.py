"""Digital twin: a designed motion or a controller table, executed and measured by the run file."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from estimation.data.measurement import Measurement
from estimation.twin import disturbances
from estimation.twin.machine import Machine, with_motors
from estimation.twin.truth import (
    ExecutedTableTruth,
    ExperimentKeys,
    MachineKeys,
    SeedKeys,
    Truth,
    disturbance_keys,
)
from expdesign.configuration import InputError, ResolvedRobot, RunConfiguration
from expdesign.configuration.bodies import payload_parameters
from expdesign.configuration.experiment import ExperimentSection, Lost
from expdesign.configuration.schema import MOST_SAMPLES, require_at_most
from expdesign.export.definition import ON_THE_EDGE
from expdesign.export.execution import blocks
from expdesign.export.table_file import TableFile
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.recheck.followed_lengths import FollowedLengths
from expdesign.recheck.limit_check import Motion
from expdesign.robot import ForwardKinematicsError, Robot, robot_from
from expdesign.trajectory import FourierTrajectory, PoseSamples


@dataclass(frozen=True, eq=False)
class Twin:
    """A simulated experiment with any number of repetitions.

    Motion and forces without noise are computed once, when it is built; a repetition costs its
    random draws. It can be pickled, and every process draws the same repetition k.
    """

    truth: Truth
    section: ExperimentSection
    grid: SampleGrid
    lengths: Array
    """(T, 6), readings of the length sensors without noise, outliers and quantisation, m: lengths
    of the executed motion at the motors, with the errors of their zeros and the drift."""
    forces: Array
    """(T, 6), the same for the forces, without hum, N: forces of the model with the exact friction
    signs, with cogging, multiplied by the errors of the force constants."""
    length_noise: disturbances.NoiseSource
    force_noise: disturbances.NoiseSource
    back_emf: tuple[float, ...] | None = None
    """(6,), N s/m: the forces are those of voltages, with this damping by the robot's motors."""

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
            The true parameters are the nominal ones of `experiment.truth` or of the robot.
        commanded : FourierTrajectory or TableFile
            The commanded motion: a designed one, or the measurement window of a controller table,
            interpolated as by its controller.
        seed : int, optional
            Seed of the repetitions, by default that of the experiment, which also determines
            tracking error and drift of all repetitions.

        Raises
        ------
        InputError
            The noise is unknown, the number of samples is impossible, the robot cannot execute
            the motion, or the table has fewer periods than the experiment.
        """
        section = configuration.run.experiment
        design = commanded if isinstance(commanded, FourierTrajectory) else commanded.design
        grid = SampleGrid.of(design.period, section, configuration.file)
        force_noise, length_noise = disturbances.noise_sources(
            configuration, grid.count, grid.sampling
        )
        _refuse_lost_rows(section.lost, grid.count, configuration.file)
        robot = robot_from(configuration.robot)
        true = robot if configuration.truth is None else Robot(configuration.truth)
        voltages = configuration.records_voltages
        driven, per_volt = with_motors(true, robot) if voltages else (true, None)
        machine = Machine(driven, np.asarray(section.compliance))
        executed = disturbances.execute_design(
            design,
            section.tracking_error,
            disturbances.experiment_stream(section.seed, disturbances.Shared.TRACKING_ERROR),
        )
        table: ExecutedTableTruth | None = None
        motion: Motion = executed
        if not isinstance(commanded, FourierTrajectory):
            refuse_short_window(commanded, section.periods, configuration.file)
            table = ExecutedTableTruth(
                file=commanded.path.name,
                format=commanded.settings.section.format,
                sha256=commanded.digest,
                window=commanded.window,
                position_error=window_error(commanded, grid.times),
            )
            motion = TableMotion(commanded, design, executed)
        zeros = np.asarray(section.strut_length)
        same = not zeros.any() and np.array_equal(true.geometry_vector, robot.geometry_vector)
        if section.follows == "lengths" and not same:
            motion = FollowedLengths(motion, robot, true, zeros)
        # With a table or a wrong clock the periods differ.
        alike = table is None and section.clock == 0
        stamps = grid.distinct_times if alike else grid.times
        found = _measure(machine, motion, stamps / (1 + section.clock), section, configuration)
        lengths, forces, positions = map(grid.repeat, found) if alike else found
        if section.cogging is not None:
            forces = forces + disturbances.cogging_force(positions, section.cogging)
        if per_volt is not None:
            forces = forces * per_volt
        if section.force_constant is not None:
            forces = forces * disturbances.force_gains(
                section.force_constant, grid.times, grid.duration
            )
        lengths = lengths + zeros
        drift: dict[str, Any] | None = None
        if section.drift > 0:
            stream = disturbances.experiment_stream(section.seed, disturbances.Shared.DRIFT)
            final = section.drift * stream.choice((-1.0, 1.0), ACTUATORS)
            lengths = lengths + disturbances.length_drift(final, grid.times, grid.duration)
            drift = {"size": section.drift, "final": final}
        truth = Truth(
            name=configuration.run.name,
            robot=robot.name,
            machine=None if configuration.truth is None else MachineKeys.of(true),
            parameters=dict(driven.description.parameters),
            payload=payload_parameters(section.payload) if section.payload else None,
            experiment=ExperimentKeys(
                section.periods,
                section.sampling,
                grid.count,
                grid.per_period or grid.period * grid.sampling,
                section.follows,
            ),
            design=design,
            executed=executed,
            force_covariance=force_noise.covariance,
            length_covariance=length_noise.covariance,
            force_spectrum=_spectrum(true.description, "force"),
            length_spectrum=_spectrum(true.description, "length"),
            table=table,
            disturbances=disturbance_keys(section, drift),
            seeds=SeedKeys(section.seed, section.seed if seed is None else seed),
        )
        damping = robot.description.drive.back_emf if voltages else None
        return cls(truth, section, grid, lengths, forces, length_noise, force_noise, damping)

    def measurement(self, repetition: int = 1) -> Measurement:
        """Return the measurement of a repetition, counted from 1.

        It depends on the configuration, the design, the seed and the number alone.
        """
        section, count, truth = self.section, self.grid.count, self.truth

        def stream(purpose: disturbances.Repeated) -> np.random.Generator:
            return disturbances.repetition_stream(truth.seeds.repetitions, repetition, purpose)

        lengths = self.lengths + self.length_noise.draw(stream(disturbances.Repeated.LENGTH_NOISE))
        forces = self.forces + self.force_noise.draw(stream(disturbances.Repeated.FORCE_NOISE))
        if section.hum is not None:
            forces += disturbances.hum_force(
                section.hum, self.grid.times, stream(disturbances.Repeated.HUM)
            )
        if section.outliers is not None:
            length_errors, force_errors = disturbances.draw_gross_errors(
                section.outliers, count, stream(disturbances.Repeated.OUTLIERS)
            )
            lengths += length_errors
            forces += force_errors
        if section.quantisation is not None:
            lengths = disturbances.quantise(lengths, section.quantisation.length)
            forces = disturbances.quantise(forces, section.quantisation.force)
        found = self.as_measurement(
            lengths, forces, f"digital twin of {truth.name}, repetition {repetition}"
        )
        if section.lost is None:
            return found
        return drop_samples(
            found,
            disturbances.draw_kept_samples(section.lost, count, stream(disturbances.Repeated.LOST)),
        )

    def as_measurement(self, lengths: Array, forces: Array, source: str = "") -> Measurement:
        """Return lengths (m) and forces (N) of all samples, (T, 6) each, as a measurement."""
        return Measurement(
            time=self.grid.times,
            lengths=lengths,
            forces=forces,
            step=1 / self.grid.sampling,
            period=self.grid.period_numbers,
            back_emf=self.back_emf,
            source=source,
        )


def _spectrum(machine: ResolvedRobot, kind: str) -> dict[str, Any] | None:
    """Return the spectrum of the noise as in the robot file; None: white."""
    if getattr(machine.noise, f"{kind}_spectrum", None) is None:
        return None
    found = getattr(machine.description.noise, f"{kind}_spectrum")
    return dict(found.model_dump(exclude_none=True))


def _measure(
    machine: Machine,
    motion: Motion,
    times: Array,
    section: ExperimentSection,
    configuration: RunConfiguration,
) -> tuple[Array, Array, Array]:
    """Return the readings of the sensors; refuse a motion through a singularity."""
    found = None
    with suppress(ForwardKinematicsError):
        lags = section.delay, section.channel_delay, section.low_pass
        found = machine.measure(motion, times, *lags)
    if found is None or not all(np.all(np.isfinite(values)) for values in found):
        named = "robot" if configuration.truth is None else "experiment.truth"
        raise InputError(
            f"the robot {machine.robot.name} cannot make the motion of the design: it passes "
            "through a singularity",
            file=configuration.file,
            key=named,
            allowed="a design that was made for this robot",
        )
    return found


def _refuse_lost_rows(lost: Lost | None, count: int, file: Path | None) -> None:
    rows = () if lost is None or lost.rows is None else lost.rows
    if rows and (max(rows) > count or len(rows) == count):
        which = f"sample {max(rows)} of {count}" if max(rows) > count else f"all {count} samples"
        raise InputError(
            f"{which} cannot be lost",
            file=file,
            key="experiment.lost.rows",
            allowed=f"numbers of samples from 1 to {count}, not of all",
        )


def drop_samples(measurement: Measurement, kept: Mask) -> Measurement:
    """Return the measurement with the kept samples, (T,), only."""
    if np.all(kept):
        return measurement
    period = measurement.period
    places = np.flatnonzero(kept)
    return replace(
        measurement,
        time=measurement.time[kept],
        lengths=measurement.lengths[kept],
        forces=measurement.forces[kept],
        period=None if period is None else period[kept],
        lost=int(places[-1] - places[0] + 1 - len(places)),
    )


_ROUNDING = 1e-12


@dataclass(frozen=True)
class SampleGrid:
    """Samples i / sampling, i = 0 … T − 1, within all periods; Hz and s.

    `count` is T; `per_period` is the number of samples in a period if it is whole, so that every
    period has the same phases, otherwise None.
    """

    sampling: float
    period: float
    periods: int
    count: int
    per_period: int | None

    @classmethod
    def of(
        cls, period: float, experiment: ExperimentSection, file: Path | None = None
    ) -> SampleGrid:
        """Return the samples of an experiment; `file` appears in messages.

        Raises
        ------
        InputError
            There is no sample, or there are too many for the memory.
        """
        steps = experiment.samples_per_period(period)
        exact = experiment.periods * steps
        made = f"{experiment.periods} periods of {period:.6g} s at {experiment.sampling:g} Hz"
        if exact * (1 + _ROUNDING) < 1:
            message = f"{made} are {exact:.4g} samples"
            raise InputError(message, file, key="experiment.sampling", allowed="1 sample or more")
        most = experiment.count_samples(period)
        require_at_most(most, MOST_SAMPLES, made, file, "experiment.periods")
        # All samples from the beginning to the end of the last period, without the end.
        count = int(np.ceil(exact * (1 - _ROUNDING)))
        return cls(
            experiment.sampling,
            period,
            experiment.periods,
            count,
            steps if isinstance(steps, int) else None,
        )

    @property
    def duration(self) -> float:
        """Duration of all periods, s."""
        return self.periods * self.period

    @property
    def times(self) -> Array:
        """(T,) s."""
        return np.arange(self.count) / self.sampling

    @property
    def distinct_times(self) -> Array:
        """(D,) times of the different samples, s: those of one period if all agree."""
        return np.arange(self.per_period or self.count) / self.sampling

    def repeat(self, values: Array) -> Array:
        """Repeat values of the distinct samples, (D, …), for all samples, (T, …)."""
        if self.per_period is None:
            return values
        return np.tile(values, (self.periods, *(1,) * (values.ndim - 1)))

    @property
    def period_numbers(self) -> NDArray[np.int64]:
        """(T,) number of each sample's period, from 1."""
        samples = np.arange(self.count)
        if self.per_period is not None:
            return samples // self.per_period + 1
        steps = self.period * self.sampling
        return np.floor(samples / steps * (1 + _ROUNDING)).astype(np.int64) + 1


_TOLERANCE_SLACK = 1.01
"""Factor on the tolerance of the table, for rounding."""


@dataclass(frozen=True, eq=False)
class TableMotion:
    """Motion of controller and machine for a table; t = 0 is the beginning of the window.

    The controller interpolates the rows; the machine follows with the tracking error of the design:
    `executed` is the design with that error.
    """

    file: TableFile
    design: FourierTrajectory
    executed: FourierTrajectory

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times in the window, s."""
        states = self.file.smoothed(np.asarray(times, dtype=float)).states
        if self.executed is self.design:
            return states
        parts = zip(states, self.executed.sample(times), self.design.sample(times), strict=True)
        return PoseSamples(*(part + made - wanted for part, made, wanted in parts))


def refuse_short_window(table: TableFile, periods: int, configuration_file: Path | None) -> None:
    """Refuse an experiment with more periods than the table, or a table that ends in its window."""
    if periods > table.periods:
        raise InputError(
            f"{periods} periods are to be measured, and the table has {table.periods}",
            file=configuration_file,
            key="experiment.periods",
            allowed=f"at most {table.periods}, or a table with more",
        )
    end = table.executed.rows.duration
    if end < table.window[1] - ON_THE_EDGE:
        raise InputError(
            f"the table ends at {end:.6f} s, inside the measurement window that lasts until "
            f"{table.window[1]:.6f} s",
            file=table.path,
            allowed="the whole table as `expdesign export` wrote it",
        )


def window_error(table: TableFile, times: Array) -> float:
    """Return the largest deviation of a strut from the design, m, at times in the window, s.

    Raises
    ------
    InputError
        The table belongs to another design: a strut deviates by more than the table's tolerance.
    """
    robot, design = table.executed.robot, table.design
    parts = []
    for part in blocks(times):
        wanted = robot.inverse_kinematics(design.sample(part).pose)
        off = table.lengths(part) - wanted
        parts.append(np.abs(off).max(axis=1))
    off = np.concatenate(parts)
    worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
    # Written so that NaN is refused.
    if not off[worst] <= table.settings.tolerance * _TOLERANCE_SLACK:
        since = "; it was changed after it was exported" if table.changed else ""
        raise InputError(
            "the table does not hold the design that is to be executed: a strut is "
            f"{1e6 * off[worst]:.4g} µm from it {times[worst]:.4f} s after the beginning of "
            "the measurement window, and the table was written to within "
            f"{1e6 * table.settings.tolerance:.4g} µm{since}",
            file=table.path,
            allowed="a table that `expdesign export` made of this design for this robot",
        )
    return float(off[worst])
