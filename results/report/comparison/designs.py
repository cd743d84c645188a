"""Designs side by side: criteria in a common scaling, precision, limits, effort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints import limit_definitions
from expdesign.experiment.scaling import parameter_scaling
from expdesign.experiment.sensitivity import FREQUENCY, LimitSensitivity
from expdesign.information.fisher import (
    SingularInformationError,
    log_det,
    parameter_covariance,
)
from results.errors import RunFolderError
from results.figures.comparison.series import ParameterSeries, Series
from results.reading.table import Table
from results.record import DesignRecord
from results.report.folder import RunFolder
from results.report.stages.design import used_shares
from results.report.table import Column, ReportTable, Value

Array = NDArray[np.float64]

EXPLAINED = 0.1
"""Largest share of the cost's gradient that the limits may leave for multipliers to be shown."""


@dataclass(frozen=True, eq=False)
class ComparedDesign:
    """One design.

    Attributes
    ----------
    label : str
    record : DesignRecord
    names : tuple of str
        Parameters that it judges.
    information : (m, m)
        F of one sample on average, SI.
    seconds : float or None
        What the search took.
    """

    label: str
    record: DesignRecord
    names: tuple[str, ...]
    information: Array
    seconds: float | None

    @classmethod
    def read(cls, label: str, folder: RunFolder) -> ComparedDesign:
        """Read the design of a folder.

        Raises
        ------
        RunFolderError
            A file is missing or does not hold what it should.
        """
        record = DesignRecord.load(folder.path)
        names = folder.document("design").texts("parameters")
        path = folder.table_file("information")
        table = Table.read(path, ["parameter", *names])
        if table.columns["parameter"] != names:
            raise RunFolderError(path, "its rows are not the parameters of design.json")
        seconds = folder.document("design").section("solver").optional("seconds")
        return cls(
            label,
            record,
            names,
            table.block(names) / record.summary.samples,
            float(seconds) if isinstance(seconds, int | float) else None,
        )

    @property
    def period(self) -> float:
        """Period, s."""
        return float(2 * np.pi / self.record.summary.omega)

    def covariance(self, samples: float) -> Array | None:
        """Return the covariance for so many samples, SI; None when F is singular."""
        try:
            return parameter_covariance(self.information * samples, self.names)
        except SingularInformationError:
            return None

    def log_det(self, samples: float) -> float | None:
        """Return log det F for so many samples, SI; None when F is singular."""
        try:
            return log_det(self.information * samples, self.names)
        except SingularInformationError:
            return None


@dataclass(frozen=True, eq=False)
class DesignComparison:
    """Designs that judge the same parameters, on a common basis.

    Attributes
    ----------
    designs : tuple of ComparedDesign
        At least one; the first sets the basis.
    precision : float
        Relative standard deviation that is wanted.
    """

    designs: tuple[ComparedDesign, ...]
    precision: float

    @property
    def comparable(self) -> bool:
        """True when all designs judge the same parameters."""
        return all(design.names == self.designs[0].names for design in self.designs)

    @property
    def samples(self) -> int:
        """Samples that the criteria are stated for: those of the first design's period."""
        return self.designs[0].record.summary.samples

    @property
    def sampling(self) -> float:
        """Sampling rate of the common experiment, Hz."""
        return float(self.designs[0].record.configuration.run.experiment.sampling)

    @property
    def experiment_samples(self) -> int:
        """Samples of the common experiment: the first design's."""
        return self.designs[0].record.summary.experiment_samples

    @property
    def nominal(self) -> Array:
        """Nominal values of the first design's parameters, (m,)."""
        found = self.designs[0].record.precision
        values = dict(zip(found.names, found.nominal.tolist(), strict=True))
        return np.array([values[name] for name in self.designs[0].names])

    def differences(self) -> tuple[str, ...]:
        """Return what else differs between the designs and bears on the comparison."""
        first, found = self.designs[0], []
        if not self.comparable:
            found.append(
                "The designs judge different parameters: their criteria cannot be compared, and "
                "are left out."
            )
        noise = first.record.configuration.robot.noise
        for design in self.designs[1:]:
            other = design.record.configuration.robot.noise
            if noise is not None and other is not None:
                one, two = noise.force_covariance, other.force_covariance
                if one is not None and two is not None and not np.array_equal(one, two):
                    found.append(
                        f"{design.label} was designed for another force noise than {first.label}: "
                        "criteria and precision hold for each one's own."
                    )
            if design.record.robot.name != first.record.robot.name:
                found.append(
                    f"{design.label} was designed for {design.record.robot.name}, {first.label} "
                    f"for {first.record.robot.name}."
                )
        return tuple(found)

    def efficiencies(self) -> dict[str, float | None]:
        """Return the D-efficiency of each design relative to the best."""
        values = {design.label: design.log_det(self.samples) for design in self.designs}
        best = max((value for value in values.values() if value is not None), default=None)
        count = len(self.designs[0].names)
        return {
            label: None if value is None or best is None else float(np.exp((value - best) / count))
            for label, value in values.items()
        }

    def criteria_table(self) -> ReportTable:
        """Return all criteria in both scalings, one row per design."""
        efficiencies = self.efficiencies()
        robot = self.designs[0].record.robot
        every = parameter_scaling(robot, "nominal")
        places = [robot.parameter_names.index(name) for name in self.designs[0].names]
        scale = every[places]
        rows: list[tuple[Value, ...]] = []
        for design in self.designs:
            covariance = design.covariance(self.samples)
            cells: list[Value] = []
            for scaling in (np.ones_like(scale), scale):
                cells += _spectrum(design.information * self.samples, covariance, scaling)
            efficiency = efficiencies[design.label]
            rows.append(
                (
                    design.label,
                    design.log_det(self.samples),
                    None if efficiency is None else 100 * efficiency,
                    *cells,
                )
            )
        columns = [Column("design", kind="text"), Column("log det F", digits=6)]
        columns.append(Column("D-efficiency", "%"))
        for scaling_name in ("SI", "nominal"):
            columns += [
                Column(f"trace F⁻¹, {scaling_name}"),
                Column(f"smallest eigenvalue, {scaling_name}"),
                Column(f"condition, {scaling_name}"),
            ]
        caption = (
            f"Criteria of every design for {self.samples} samples, in SI units and in units of the "
            f"nominal values of {self.designs[0].label}; D-efficiency relative to the best"
        )
        return ReportTable.of("criteria", caption, columns, rows)

    def relative_std(self, samples: float) -> dict[str, Array]:
        """Return σ relative to the nominal values, (m,), by design; NaN where there is none."""
        nominal = np.where(self.nominal == 0, np.nan, np.abs(self.nominal))
        found = {}
        for design in self.designs:
            covariance = design.covariance(samples)
            found[design.label] = (
                np.full(nominal.size, np.nan)
                if covariance is None
                else np.sqrt(np.diag(covariance)) / nominal
            )
        return found

    def periods(self) -> dict[str, Array]:
        """Return the periods that each parameter needs for the precision wanted, by design."""
        found = {}
        for design in self.designs:
            one = self.relative_std(design.period * self.sampling)[design.label]
            found[design.label] = np.maximum(np.ceil((one / self.precision) ** 2 - 1e-9), 1.0)
        return found

    def precision_table(self) -> ReportTable:
        """Return predicted standard deviations and the periods needed, one row per parameter."""
        relative, periods = self.relative_std(self.experiment_samples), self.periods()
        columns = [Column("parameter", kind="parameter"), Column("nominal")]
        columns += [Column(f"σ, {design.label}", "%", digits=3) for design in self.designs]
        columns += [Column(f"periods, {design.label}") for design in self.designs]
        rows: list[tuple[Value, ...]] = [
            (
                name,
                float(self.nominal[k]),
                *(100 * float(relative[design.label][k]) for design in self.designs),
                *(float(periods[design.label][k]) for design in self.designs),
            )
            for k, name in enumerate(self.designs[0].names)
        ]
        caption = (
            f"Predicted standard deviations for {self.experiment_samples} samples at "
            f"{self.sampling:g} Hz whatever the period, in percent of the nominal value, and the "
            f"periods that each design needs for {100 * self.precision:g} %"
        )
        return ReportTable.of("compared_parameters", caption, columns, rows)

    def precision_series(self) -> ParameterSeries:
        """Return what the figure of the precision is drawn from."""
        relative = self.relative_std(self.experiment_samples)
        return ParameterSeries(
            self.designs[0].names,
            tuple(Series(label, 100 * values) for label, values in relative.items()),
        )

    def effort_table(self) -> ReportTable:
        """Return the measuring time that each design needs, one row per design."""
        periods = self.periods()
        rows: list[tuple[Value, ...]] = []
        for design in self.designs:
            needed = periods[design.label]
            known = bool(np.any(np.isfinite(needed)))
            worst = int(np.nanargmax(needed)) if known else 0
            summary = design.record.summary
            rows.append(
                (
                    design.label,
                    summary.status,
                    summary.criterion,
                    summary.harmonics,
                    design.period,
                    float(np.nanmedian(needed)) if known else None,
                    float(needed[worst]) if known else None,
                    design.names[worst] if known else "–",
                    float(needed[worst]) * design.period if known else None,
                )
            )
        columns = (
            Column("design", kind="text"),
            Column("status", kind="outcome"),
            Column("criterion", kind="text"),
            Column("harmonics"),
            Column("period", "s"),
            Column("periods, median parameter"),
            Column("periods, all parameters"),
            Column("decided by", kind="parameter"),
            Column("measuring time", "s"),
        )
        caption = (
            f"Periods and time that each design needs for σ = {100 * self.precision:g} % of the "
            f"nominal value, measured at {self.sampling:g} Hz"
        )
        return ReportTable.of("effort", caption, columns, rows)


def limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    """Return the used share of every limit, one column per design."""
    shares = {design.label: used_shares(design.record) for design in designs}
    keys = dict.fromkeys(key for share in shares.values() for key in share)
    columns = [Column("limit", kind="text")]
    columns += [Column(label, "%") for label in shares]
    rows: list[tuple[Value, ...]] = [
        (
            limit_definitions()[key].title,
            *(100 * share[key] if key in share else None for share in shares.values()),
        )
        for key in keys
    ]
    return ReportTable.of("compared_limits", "Used share of every limit", columns, rows)


def gains_table(found: Mapping[str, LimitSensitivity]) -> ReportTable:
    """Return what every limit costs, one column per design."""
    keys = dict.fromkeys(key for sensitivity in found.values() for key in sensitivity.gains)
    columns = [Column("limit", kind="text")]
    columns += [Column(label, "%", digits=3) for label in found]
    rows: list[tuple[Value, ...]] = []
    for key in keys:
        title = "base frequency" if key == FREQUENCY else limit_definitions()[key].title
        cells = [
            100 * sensitivity.gains[key]
            if key in sensitivity.gains and sensitivity.unexplained <= EXPLAINED
            else None
            for sensitivity in found.values()
        ]
        rows.append((title, *cells))
    rows.append(("unexplained by the limits", *(100 * each.unexplained for each in found.values())))
    caption = (
        "What 10 % more of each limit alone would buy, in percent of the D-efficiency (of the "
        "criterion's value for other criteria), to first order from the multipliers of the "
        "optimum beside the design"
    )
    return ReportTable.of("limit_gains", caption, columns, rows)


def _spectrum(information: Array, covariance: Array | None, scale: Array) -> list[Value]:
    """Return trace of F⁻¹, smallest eigenvalue and condition number in a scaling."""
    if covariance is None:
        return [None, None, None]
    scaled = information * np.multiply.outer(scale, scale)
    inverse = covariance / np.multiply.outer(scale, scale)
    # The small eigenvalues come from the inverse, where they keep their digits.
    smallest = 1 / float(np.linalg.eigvalsh(inverse)[-1])
    largest = float(np.linalg.eigvalsh(scaled)[-1])
    return [float(np.trace(inverse)), smallest, largest / smallest]
