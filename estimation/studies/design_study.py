"""Two criteria of design compared: what their designs achieve when LS and GM evaluate them.

The paper's Section IV-C: the statistical design (log det F) against the deterministic one
(condition number), both evaluated with LS, and here with GM too. Initial parameters are the start
of the search: one random motion each, the same for both criteria.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Mask
from estimation.montecarlo import StudyMonitor
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
    AgreementRow,
    Claim,
    DesignRow,
    DeterminantRow,
    MeanRow,
    PrecisionRow,
)
from estimation.studies.statistics import (
    DeterminantComparison,
    compare_determinants,
    mean_difference,
)
from estimation.studies.study import Study
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences
from expdesign.configuration import RunConfiguration
from expdesign.experiment import DesignRecord
from expdesign.mechanism.catalogue import TERMS, parameter_unit
from expdesign.robot import robot_from
from expdesign.runfolder import RowTable

FOLDER = "designs"

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

Pair = tuple[Trial, Trial]


@dataclass(frozen=True, eq=False)
class DesignStudy(Study):
    """All trials, set by set, in the order of the criteria."""

    trials: tuple[Trial, ...]

    @classmethod
    def run(
        cls, configuration: RunConfiguration, monitor: StudyMonitor | None = None
    ) -> DesignStudy:
        """Design with both criteria from every set, and execute each design many times.

        Raises
        ------
        InputError
            The run cannot be designed or simulated.
        NoDesignError, InfeasibleLimitsError, SingularInformationError
            A design failed.
        TooFewEstimatesError
            Too many repetitions could not be estimated.
        StudyInterruptedError
            A stop was requested.
        """
        robot = robot_from(configuration.robot)
        refuse_unfit_design_study(configuration, robot)
        return cls(configuration, robot, run_trials(configuration, robot, monitor))

    @property
    def sets(self) -> tuple[Pair, ...]:
        """Trials of each set: first and second criterion."""
        return tuple(zip(self.trials[::2], self.trials[1::2], strict=True))

    def determinant(self, pair: Pair, kinematics: str, estimator: str) -> DeterminantComparison:
        """Compare the determinants of what both designs achieved."""
        first, second = (trial.values[kinematics][estimator] for trial in pair)
        return compare_determinants(first, second, self.robot.scales)

    def means(self, pair: Pair, kinematics: str) -> Differences:
        """Test whether both designs lead to the same mean LS estimate."""
        first, second = (trial.values[kinematics]["ls"] for trial in pair)
        return mean_difference(first, second)

    def more_precise(self, pair: Pair, kinematics: str, estimator: str) -> Mask:
        """Return for which parameters the first criterion has the smaller spread, (m,)."""
        first, second = (trial.values[kinematics][estimator].std(axis=0, ddof=1) for trial in pair)
        return np.asarray(first < second)

    @cached_property
    def rms_motion(self) -> dict[str, tuple[float, float]]:
        """The struts' rms speed, m/s, and acceleration, m/s², by the trial's name."""
        found = {}
        for trial in self.trials:
            trajectory = trial.design.trajectory
            states = trajectory.sample(np.arange(_GRID) * trajectory.period / _GRID)
            motion = self.robot.strut_motion(states.pose, states.rate, states.acceleration)
            speed, acceleration = (
                float(np.sqrt(np.mean(part**2)))
                for part in (motion.length_rate, motion.length_acceleration)
            )
            found[trial.name] = speed, acceleration
        return found

    def write_designs(self, folder: Path) -> list[Path]:
        """Write every design as a run folder of its own; return the files."""
        return [
            path
            for trial in self.trials
            for path in DesignRecord.of(trial.design).write(folder / FOLDER / trial.name)
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
        yield Claim(
            "every experiment can be estimated", f"{total - failed} of {total}", holds=not failed
        )
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
            AGREEMENT: self._agreement(),
            MEANS: self._means(),
        }

    def _determinant_claims(self) -> Iterator[Claim]:
        first, second = self.section.criteria
        for kinematics in self.section.kinematics:
            found = [self.determinant(pair, kinematics, "ls") for pair in self.sets]
            smaller = sum(one.difference > 0 for one in found)
            least = min(found, key=lambda one: one.ratio)
            yield Claim(
                f"{_WITH[kinematics]}: the covariance of LS has the smaller determinant with "
                f"'{first}' than with '{second}' in every set, by more than {_CLEAR:g} standard "
                "errors",
                f"{smaller} of {len(found)} sets; log det smaller by {least.difference:.1f} ± "
                f"{least.std_error:.1f} or more ({least.ratio:.0f} standard errors)",
                "the statistical design's is smaller",
                None if kinematics == "central" else bool(least.ratio > _CLEAR),
            )

    def _precision_claims(self) -> Iterator[Claim]:
        first, second = self.section.criteria
        rigid = rigid_body(self.robot.parameter_names)
        kinematics = shown_kinematics(self.section.kinematics)
        better = [self.more_precise(pair, kinematics, "ls") for pair in self.sets]
        predicted = [one.predicted_std("ls") < two.predicted_std("ls") for one, two in self.sets]
        for title, which, paper in (
            ("rigid-body", rigid, "8 of 10"),
            ("friction", ~rigid, "7 of 14"),
        ):
            counts, expected = (
                ", ".join(str(np.count_nonzero(one & which)) for one in found)
                for found in (better, predicted)
            )
            yield Claim(
                f"{title} parameters that LS knows better with '{first}' than with '{second}', by "
                f"set; {_WITH[kinematics]}",
                f"{counts} of {np.count_nonzero(which)}; predicted: {expected}",
                paper,
            )
        motions = np.array([[self.rms_motion[trial.name] for trial in pair] for pair in self.sets])
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
            found = [trial.agreement("exact", estimator) for trial in self.trials]
            worst = max(found, key=lambda one: abs(one.z))
            mean = float(np.mean([one.ratio for one in found]))
            yield Claim(
                f"achieved variances of {estimator.upper()} agree with {_FORMULAS[estimator]} "
                f"within {_CLEAR:g} standard errors for every design",
                f"achieved / predicted {mean:.3f} on average, {worst.ratio:.3f} ± "
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
        tests = [self.means(pair, kinematics) for pair in self.sets]
        level = FAMILY_LEVEL / len(tests)
        joint = sum(test.p_joint < level for test in tests)
        names = self.robot.parameter_names
        apart = {names[k] for test in tests for k in np.flatnonzero(test.p_values < level)}
        listed = ", ".join(name for name in names if name in apart) or "none"
        if len(apart) == len(names):
            listed = "all"
        expected = {"exact": joint == 0, "fourier": None, "central": joint == len(tests)}
        return Claim(
            f"{_WITH[kinematics]}: the mean LS estimates of both designs "
            + {"exact": "are the same", "fourier": "compared", "central": "differ"}[kinematics],
            f"they differ in {joint} of {len(tests)} sets; parameters that differ: {listed}",
            "" if kinematics == "exact" else "they agree but for r_α and r_β",
            expected[kinematics],
        )

    def _designs(self) -> Iterator[DesignRow]:
        nominal = self.robot.scales
        for trial in self.trials:
            design = trial.design
            by_nominal = design.information * np.multiply.outer(nominal, nominal)
            yield DesignRow(
                trial.number,
                trial.criterion,
                f"{FOLDER}/{trial.name}",
                design.status,
                design.passed,
                design.log_det_information,
                float(np.linalg.cond(design.information)),
                float(np.linalg.cond(by_nominal)),
                design.trajectory.period,
                *self.rms_motion[trial.name],
                sum(trial.failed.values()),
            )

    def _precision(self) -> Iterator[PrecisionRow]:
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
                        truth=self.robot.parameters[k],
                        mean=values[:, k].mean(),
                        std=values[:, k].std(ddof=1),
                        predicted_std=predicted[k],
                    )

    def _determinants(self) -> Iterator[DeterminantRow]:
        rigid = rigid_body(self.robot.parameter_names)
        for pair, kinematics, estimator in product(self.sets, self.section.kinematics, ESTIMATORS):
            found = self.determinant(pair, kinematics, estimator)
            better = self.more_precise(pair, kinematics, estimator)
            yield DeterminantRow(
                pair[0].number,
                kinematics,
                estimator,
                found.first,
                found.second,
                found.difference,
                found.std_error,
                int(np.count_nonzero(better & rigid)),
                int(np.count_nonzero(better & ~rigid)),
            )

    def _agreement(self) -> Iterator[AgreementRow]:
        if "exact" not in self.section.kinematics:
            return
        for trial, estimator in product(self.trials, ESTIMATORS):
            found = trial.agreement("exact", estimator)
            numbers = (found.ratio, found.std_error, found.z)
            yield AgreementRow(trial.number, trial.criterion, estimator, *numbers)

    def _means(self) -> Iterator[MeanRow]:
        for pair, kinematics in product(self.sets, self.section.kinematics):
            test = self.means(pair, kinematics)
            for k, name in enumerate(self.robot.parameter_names):
                numbers = (test.difference[k], test.std[k], test.z[k], test.p_values[k])
                unit = parameter_unit(name)
                yield MeanRow(pair[0].number, kinematics, name, unit, *numbers, test.p_joint)


def rigid_body(names: Sequence[str]) -> Mask:
    """Return which parameters are the rigid bodies', the others being friction, (m,)."""
    bodies = {parameter.name for term in _BODIES for parameter in TERMS[term].parameters}
    return np.array([name in bodies for name in names])


def shown_kinematics(kinds: Iterable[str]) -> str:
    """Return the kinematics of which one figure or claim alone is made: Fourier where it is."""
    kinds = tuple(kinds)
    return "fourier" if "fourier" in kinds else kinds[0]
