"""Two criteria of design compared: what their designs achieve when LS and GM evaluate them.

The paper's Section IV-C: the statistical design (log det F) against the deterministic one
(condition number), both evaluated with LS, and here with GM too. Initial parameters are the start
of the search: one random motion each, the same for both criteria.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array, Mask
from estimation.studies.design_trials import (
    ESTIMATORS,
    Trial,
    refuse_unfit_design_study,
    run_trials,
)
from estimation.studies.records import (
    AGREEMENT,
    DESIGNS,
    DETERMINANTS,
    MEANS,
    PRECISION,
    Claim,
    DesignRow,
    DeterminantRow,
    MeanRow,
    PrecisionRow,
)
from estimation.studies.statistics import compare_determinants, mean_difference
from estimation.studies.study import Study, all_estimated
from estimation.twin.record import true_values
from estimation.uncertainty.differences import FAMILY_LEVEL
from expdesign.configuration import RunConfiguration
from expdesign.experiment import DesignRecord
from expdesign.experiment.several import FOLDER, design_folder
from expdesign.mechanism.catalogue import TERMS, parameter_unit
from expdesign.robot import robot_from
from expdesign.runfolder import RowTable
from expdesign.workers import Monitor

_CLEAR = 4.0
"""Standard errors by which determinants must differ, and within which predictions must agree."""

_GRID = 2000
_WITH = {
    "exact": "without noise of the lengths",
    "fourier": "with noise of the lengths, Fourier differentiation",
    "central": "with noise of the lengths, central differences",
}
_FORMULAS = {"ls": "(ΨᵀΨ)⁻¹ΨᵀΣΨ(ΨᵀΨ)⁻¹", "gm": "F⁻¹"}

_BODIES = ("struts", "rigid_platform")


@dataclass(frozen=True, eq=False)
class DesignStudy(Study):
    """All trials, set by set, in the order of the criteria."""

    trials: tuple[Trial, ...]

    @classmethod
    def run(cls, configuration: RunConfiguration, monitor: Monitor | None = None) -> DesignStudy:
        """Design with both criteria from every set, and execute each design many times.

        Raises
        ------
        InputError
            The run cannot be designed or simulated.
        NoDesignError, InfeasibleLimitsError, SingularInformationError
            A design failed.
        TooFewEstimatesError
            Too many repetitions could not be estimated.
        StoppedError
            A stop was requested.
        """
        robot = robot_from(configuration.robot)
        refuse_unfit_design_study(configuration, robot)
        return cls(configuration, robot, run_trials(configuration, robot, monitor))

    @property
    def sets(self) -> tuple[tuple[Trial, Trial], ...]:
        """Trials of each set: first and second criterion."""
        return tuple(zip(self.trials[::2], self.trials[1::2], strict=True))

    def write_designs(self, folder: Path) -> list[Path]:
        """Write every design as a run folder of its own; return the files."""
        return [
            path
            for trial in self.trials
            for path in DesignRecord.of(trial.design).write(design_folder(folder, trial.name))
        ]

    def claims(self) -> Iterator[Claim]:
        """Yield what the study was to show, LS as in the paper."""
        first, second = self.section.criteria
        yield from self._determinant_claims()
        yield from self._precision_claims()
        if "exact" in self.section.kinematics:
            yield from self._agreement_claims()
        for kinematics in self.section.kinematics:
            yield self._means_claim(kinematics)
        kept = sum(trial.design.passed for trial in self.trials)
        failed = sum(sum(trial.failed.values()) for trial in self.trials)
        total = len(self.trials) * len(self.section.kinematics) * self.section.repetitions
        yield all_estimated("experiment", total, failed)
        yield Claim(
            f"every design ({first} and {second}) keeps every limit",
            f"{kept} of {len(self.trials)}",
            holds=kept == len(self.trials),
        )

    def rows(self) -> dict[RowTable[Any], Iterable[Any]]:
        """Return the rows of every table."""
        return {
            DESIGNS: self._designs(),
            PRECISION: self._precision(),
            DETERMINANTS: self._determinants(),
            AGREEMENT: [
                trial.agreement("exact", estimator)
                for trial, estimator in product(self.trials, ESTIMATORS)
                if "exact" in self.section.kinematics
            ],
            MEANS: self._means(),
        }

    def _determinant_claims(self) -> Iterator[Claim]:
        first, second = self.section.criteria
        for kinematics in self.section.kinematics:
            found = self._of_ls(kinematics)
            smaller = sum(row.difference > 0 for row in found)
            ratio, least = min(
                ((row.difference / row.std_error, row) for row in found), key=itemgetter(0)
            )
            yield Claim(
                f"{_WITH[kinematics]}: the covariance of LS has the smaller determinant with "
                f"'{first}' than with '{second}' in every set, by more than {_CLEAR:g} standard "
                "errors",
                f"{smaller} of {len(found)} sets; log det smaller by {least.difference:.1f} ± "
                f"{least.std_error:.1f} or more ({ratio:.0f} standard errors)",
                "the statistical design's is smaller",
                None if kinematics == "central" else bool(ratio > _CLEAR),
            )

    def _of_ls(self, kinematics: str) -> list[DeterminantRow]:
        rows = self.tables[DETERMINANTS]
        return [row for row in rows if (row.kinematics, row.estimator) == (kinematics, "ls")]

    def _precision_claims(self) -> Iterator[Claim]:
        first, second = self.section.criteria
        rigid = rigid_body(self.robot.parameter_names)
        kinematics = shown_kinematics(self.section.kinematics)
        predicted = [one.predicted_std("ls") < two.predicted_std("ls") for one, two in self.sets]
        for title, column, which, paper in (
            ("rigid-body", "rigid_body_smaller", rigid, "8 of 10"),
            ("friction", "friction_smaller", ~rigid, "7 of 14"),
        ):
            counts = ", ".join(str(getattr(row, column)) for row in self._of_ls(kinematics))
            expected = ", ".join(str(np.count_nonzero(one & which)) for one in predicted)
            yield Claim(
                f"{title} parameters that LS knows better with '{first}' than with '{second}', by "
                f"set; {_WITH[kinematics]}",
                f"{counts} of {np.count_nonzero(which)}; predicted: {expected}",
                paper,
            )
        motions = np.reshape(
            [(row.strut_speed, row.strut_acceleration) for row in self.tables[DESIGNS]], (-1, 2, 2)
        )
        value = "; ".join(
            f"'{name}': {speed:.2f} m/s, {acceleration:.1f} m/s²"
            for name, (speed, acceleration) in zip(
                (first, second), motions.mean(axis=0), strict=True
            )
        )
        if second == "condition" and np.all(motions[:, 1] < motions[:, 0]):
            value += (
                f". In every set '{second}' moves the struts less: it asks for equally much "
                "information about all parameters, not for much of it"
            )
        yield Claim("why: how the struts move, rms, mean over the sets", value)

    def _agreement_claims(self) -> Iterator[Claim]:
        for estimator in ESTIMATORS:
            found = [row for row in self.tables[AGREEMENT] if row.estimator == estimator]
            worst = max(found, key=lambda one: abs(one.z))
            mean = float(np.mean([one.variance_ratio for one in found]))
            yield Claim(
                f"achieved variances of {estimator.upper()} agree with {_FORMULAS[estimator]} "
                f"within {_CLEAR:g} standard errors for every design",
                f"achieved / predicted {mean:.3f} on average, {worst.variance_ratio:.3f} ± "
                f"{worst.std_error:.3f} at worst",
                holds=bool(abs(worst.z) < _CLEAR),
            )
        gaps = [
            float(np.sqrt(np.mean((trial.predicted_std("ls") / trial.predicted_std("gm")) ** 2)))
            for trial in self.trials
        ]
        yield Claim(
            "what weighting with Σ is worth: predicted standard deviations of LS over those of GM, "
            "rms",
            f"{min(gaps):.2f} … {max(gaps):.2f}",
        )

    def _means_claim(self, kinematics: str) -> Claim:
        rows = [row for row in self.tables[MEANS] if row.kinematics == kinematics]
        by_set = {row.set: row.p_joint for row in rows}
        level = FAMILY_LEVEL / len(by_set)
        joint = sum(p < level for p in by_set.values())
        names = self.robot.parameter_names
        apart = {row.parameter for row in rows if row.p_value < level}
        listed = ", ".join(name for name in names if name in apart) or "none"
        if len(apart) == len(names):
            listed = "all"
        expected = {"exact": joint == 0, "fourier": None, "central": joint == len(by_set)}
        return Claim(
            f"{_WITH[kinematics]}: the mean LS estimates of both designs "
            + {"exact": "are the same", "fourier": "compared", "central": "differ"}[kinematics],
            f"they differ in {joint} of {len(by_set)} sets; parameters that differ: {listed}",
            "" if kinematics == "exact" else "they agree but for r_α and r_β",
            expected[kinematics],
        )

    def _designs(self) -> Iterator[DesignRow]:
        nominal = np.multiply.outer(self.robot.scales, self.robot.scales)
        for trial in self.trials:
            design, period = trial.design, trial.design.trajectory.period
            states = design.trajectory.sample(np.arange(_GRID) * period / _GRID)
            motion = self.robot.strut_motion(*states)
            yield DesignRow(
                trial.number,
                trial.criterion,
                f"{FOLDER}/{trial.name}",
                design.status,
                design.passed,
                design.log_det_information,
                float(np.linalg.cond(design.information)),
                float(np.linalg.cond(design.information * nominal)),
                period,
                float(np.sqrt(np.mean(motion.length_rate**2))),
                float(np.sqrt(np.mean(motion.length_acceleration**2))),
                sum(trial.failed.values()),
            )

    @property
    def truth(self) -> Array:
        """(m,) true values of the robot's parameters, SI."""
        machine = self.configuration.truth or self.configuration.robot
        return true_values(machine.parameters, self.robot.parameter_names)

    def _precision(self) -> Iterator[PrecisionRow]:
        truth = self.truth
        for trial in self.trials:
            for kinematics, estimator in product(self.section.kinematics, ESTIMATORS):
                values = trial.values[kinematics][estimator]
                predicted = trial.predicted_std(estimator)
                for k, name in enumerate(self.robot.parameter_names):
                    yield PrecisionRow(
                        trial.number,
                        trial.criterion,
                        kinematics,
                        estimator,
                        name,
                        parameter_unit(name),
                        truth=truth[k],
                        mean=values[:, k].mean(),
                        std=values[:, k].std(ddof=1),
                        predicted_std=predicted[k],
                    )

    def _determinants(self) -> Iterator[DeterminantRow]:
        rigid = rigid_body(self.robot.parameter_names)
        for pair, kinematics, estimator in product(self.sets, self.section.kinematics, ESTIMATORS):
            first, second = (trial.values[kinematics][estimator] for trial in pair)
            found = compare_determinants(first, second, self.robot.scales)
            better = first.std(axis=0, ddof=1) < second.std(axis=0, ddof=1)
            yield DeterminantRow(
                pair[0].number,
                kinematics,
                estimator,
                *found,
                int(np.count_nonzero(better & rigid)),
                int(np.count_nonzero(better & ~rigid)),
            )

    def _means(self) -> Iterator[MeanRow]:
        for pair, kinematics in product(self.sets, self.section.kinematics):
            test = mean_difference(*(trial.values[kinematics]["ls"] for trial in pair))
            numbers = zip(test.difference, test.std, test.z, test.p_values, strict=True)
            for name, own in zip(self.robot.parameter_names, numbers, strict=True):
                unit = parameter_unit(name)
                yield MeanRow(pair[0].number, kinematics, name, unit, *own, test.p_joint)


def rigid_body(names: Sequence[str]) -> Mask:
    """Return which parameters are the rigid bodies', the others being friction, (m,)."""
    bodies = {parameter.name for term in _BODIES for parameter in TERMS[term].parameters}
    return np.array([name in bodies for name in names])


def shown_kinematics(kinds: Iterable[str]) -> str:
    """Return the kinematics of which one figure or claim alone is made: Fourier where it is."""
    kinds = tuple(kinds)
    return "fourier" if "fourier" in kinds else kinds[0]
