"""`estimate.json`: the recordings, what every estimator found, and what the residuals say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Self

import numpy as np

from estimation.diagnostics.diagnosis_result import Diagnosis, DiagnosisKeys
from estimation.diagnostics.noise_result import NoiseKeys, noise_keys
from estimation.estimators import ParameterEstimate, covariance_ml_less_gm
from estimation.estimators.payload import TEN
from estimation.identification.estimator_result import (
    ConsistentKeys,
    ConstantKeys,
    PayloadKeys,
    SystematicKeys,
    constants_found,
)
from estimation.identification.result import EstimationResult, PreparedRecording
from estimation.identification.term_selection import Selection
from estimation.uncertainty.intervals import Combination
from expdesign.configuration import Problem
from expdesign.experiment.combinations import KnownCombination
from expdesign.robot import robot_from
from expdesign.robot.deviation import toleranced_deviations
from expdesign.runfolder import Numbers, OpenNumbers, RunFile, copied, described
from expdesign.runfolder.fields import (
    unknown_names,
    wrong_count,
    wrong_covariance,
    wrong_names,
    wrong_shape,
)
from expdesign.trajectory import FourierKeys


@dataclass(frozen=True, eq=False, kw_only=True)
class WeightingKeys(NoiseKeys):
    """The noise that the estimators weighted with."""

    force_source: Annotated[str, described("", "estimated, given or residuals")]
    length_source: Annotated[str, described("", "estimated, given or residuals")]
    includes_model_error: Annotated[bool, described("", "Σ comes from the model's residuals")]
    force_spectrum: Annotated[
        str, described("", "how the forces' noise is spread over the frequencies, in words")
    ] = ""
    length_spectrum: Annotated[str, described("", "how that of the lengths is, in words")] = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingKeys:
    """One recording of an estimate."""

    source: Annotated[str, described("", "its file")]
    rows: Annotated[int, described("1", "rows that were used")]
    dropped_rows: Annotated[int, described("1", "rows of incomplete periods that were not")]
    lost_samples: Annotated[
        int, described("1", "samples that are missing among the rows that were used")
    ] = 0
    samples: Annotated[int, described("1", "means over the periods, or rows")]
    averaged: Annotated[bool, described("", "the samples are means over the periods")]
    periods: Annotated[float, described("1", "number of periods")]
    omega: Annotated[float, described("rad/s", "base frequency")]
    omega_std: Annotated[
        float | None, described("rad/s", "its standard deviation; null when it was not estimated")
    ]
    period_source: Annotated[str, described("", "where the period came from")]
    jitter: Annotated[float, described("1", "of the time stamps, as a share of a step")]
    harmonics: Annotated[
        int | None,
        described(
            "1",
            "of the motion fitted to the lengths, which LS and GM take; null after pointwise "
            "differentiation",
        ),
    ]
    harmonics_of_forces: Annotated[
        int | None,
        described("1", "of ML's motion: what forces and lengths show together; null as before"),
    ] = None
    harmonics_of_the_design: Annotated[
        int | None, described("1", "fewest that were tried; null when the number was given")
    ]
    noise: Annotated[WeightingKeys, described("", "noise that the estimators weighted with")]

    @classmethod
    def of(cls, summary: PreparedRecording) -> Self:
        """Describe a recording."""
        record, noise = summary.experiment.record, summary.experiment.noise
        fit = summary.experiment.fit
        free = fit is not None and fit.motion.free_frequency
        return copied(
            cls,
            record,
            source=summary.source,
            dropped_rows=record.dropped,
            lost_samples=record.lost,
            periods=float(record.periods),
            omega=float(record.omega if fit is None else fit.motion.omega),
            omega_std=float(np.sqrt(fit.covariance[-1, -1])) if fit and free else None,
            period_source=record.source.value,
            jitter=float(summary.jitter),
            harmonics=summary.harmonics,
            harmonics_of_forces=summary.harmonics_of_forces,
            harmonics_of_the_design=summary.least_harmonics,
            noise=WeightingKeys(
                **noise_keys(noise),
                force_source=noise.forces.source,
                length_source=noise.lengths.source,
                includes_model_error=noise.forces.includes_model_error,
                force_spectrum=noise.forces.spectrum_words,
                length_spectrum=noise.lengths.spectrum_words,
            ),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatorKeys:
    """What one estimator found."""

    status: Annotated[str, described("", "how it ended, in words")]
    converged: Annotated[bool, described("", "the iteration ended as it should")]
    iterations: Annotated[int, described("1", "number of iterations")]
    cost: Annotated[float, described("1", "weighted sum of squares that was minimised")]
    seconds: Annotated[float, described("s", "how long it took")]
    values: Annotated[dict[str, float], described("SI", "by parameter")]
    covariance: Annotated[Numbers, described("SI", "m × m; zero for fixed parameters")]
    covariance_forces: Annotated[
        Numbers, described("SI", "its share that the forces' noise and the prior make")
    ]
    covariance_kinematics: Annotated[
        Numbers | None,
        described("SI", "its share that the lengths' noise makes; null where it is not known"),
    ]
    covariance_joint: Annotated[
        Numbers | None,
        described(
            "SI",
            "(m + e) × (m + e): random share, of the parameters and of the deviations that were "
            "estimated with them, the first e of `systematic`; null: none was",
        ),
    ] = None
    freedom: Annotated[
        OpenNumbers,
        described("1", "(m,) degrees of freedom behind the standard deviations; null: endless"),
    ] = field(default_factory=lambda: np.zeros(0))
    colour: Annotated[
        OpenNumbers,
        described("1", "(m,) variances over those that white noise would make"),
    ] = field(default_factory=lambda: np.zeros(0))
    covariance_systematic: Annotated[
        Numbers | None, described("SI", "its share that the robot's tolerances make")
    ] = None
    systematic: Annotated[
        SystematicKeys | None,
        described("", "quantities with a tolerance and their effect; null: taken as exact"),
    ] = None
    constants: Annotated[
        tuple[ConstantKeys, ...],
        described("", "constants of terms that were estimated, as in tables/constants.csv"),
    ] = ()
    payload: Annotated[
        PayloadKeys | None,
        described("", "what the platform carries beyond the machine identified before; null: none"),
    ] = None
    consistent: Annotated[
        ConsistentKeys | None,
        described("", "the nearest physically consistent parameters; null: excluded by fixed ones"),
    ] = None
    combinations: Annotated[
        tuple[Combination, ...], described("", "what is known of parameters not identified")
    ]
    base_parameters: Annotated[
        tuple[KnownCombination, ...],
        described("", "combinations that the data identify; of each the table's columns"),
    ] = ()
    motions: Annotated[
        tuple[FourierKeys, ...], described("", "motion of every recording, as in design.json")
    ]

    @classmethod
    def of(cls, result: EstimationResult, estimate: ParameterEstimate) -> Self:
        """Describe an estimate."""
        motions = [
            motion.delayed(record.experiment.record.origin).trajectory
            for motion, record in zip(estimate.motions, result.records, strict=False)
        ]
        return copied(
            cls,
            estimate,
            freedom=np.where(np.isinf(estimate.freedom), np.nan, estimate.freedom),
            values=dict(zip(result.knowledge.names, estimate.values.tolist(), strict=True)),
            systematic=SystematicKeys.of(estimate.systematic),
            constants=constants_found(robot_from(result.configuration.robot), estimate.systematic),
            payload=PayloadKeys.of(result.payloads.get(estimate.estimator)),
            consistent=ConsistentKeys.of(result.consistent[estimate.estimator], result.robot),
            combinations=result.combinations[estimate.estimator],
            base_parameters=result.knowledge.identified_combinations(
                result.robot, estimate.values, estimate.covariance
            ),
            motions=tuple(copied(FourierKeys, motion) for motion in motions),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimateFile(RunFile):
    """`estimate.json`."""

    FILE: ClassVar[str] = "estimate.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign estimate`"
    parameters: Annotated[tuple[str, ...], described("", "order of rows and columns")]
    fixed: Annotated[tuple[str, ...], described("", "parameters that were not estimated")]
    best: Annotated[str, described("", "the estimator to use")]
    recordings: Annotated[tuple[RecordingKeys, ...], described("", "recordings of the estimate")]
    estimators: Annotated[dict[str, EstimatorKeys], described("", "what each of them found")]
    cramer_rao_covariance: Annotated[
        Numbers | None, described("SI", "the bound with noise in forces and lengths, m × m")
    ]
    covariance_ml_less_gm: Annotated[
        Numbers | None,
        described("SI", "of the difference of these estimates, m × m; null without both"),
    ] = None
    intervals_cover: Annotated[bool, described("", "the intervals count the lengths' noise")]
    intervals_note: Annotated[str, described("", "what the intervals count, in words")]
    diagnostics: Annotated[
        DiagnosisKeys | None, described("", "what the residuals say; null when not asked")
    ]
    selection: Annotated[
        Selection | None,
        described("", "terms that were added to those of the robot file; null: none was tried"),
    ] = None
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]

    def contradictions(self) -> Iterator[Problem]:
        """Yield what is not of these parameters, estimators and recordings."""
        names = self.parameters
        count, of = len(names), "parameters"
        square = (count, count)
        yield from unknown_names("best", [self.best], self.estimators, "estimators")
        yield from unknown_names("fixed", self.fixed, names, of)
        yield from wrong_covariance("cramer_rao_covariance", self.cramer_rao_covariance, count, of)
        key, difference = "covariance_ml_less_gm", self.covariance_ml_less_gm
        yield from wrong_shape(key, difference, square, of)
        for name, found in self.estimators.items():
            place = f"estimators.{name}"
            yield from wrong_names(f"{place}.values", found.values, names, of)
            for key in ("covariance", "covariance_forces"):
                yield from wrong_covariance(f"{place}.{key}", getattr(found, key), count, of)
            for key in ("covariance_kinematics", "covariance_systematic"):
                # Shares, which rounding may leave below zero.
                yield from wrong_shape(f"{place}.{key}", getattr(found, key), square, of)
            for key in ("freedom", "colour"):
                # Earlier versions have none.
                numbers = getattr(found, key)
                yield from wrong_shape(
                    f"{place}.{key}", numbers if numbers.size else None, (count,), of
                )
            if found.payload is not None:
                own = found.payload
                yield from wrong_names(f"{place}.payload.values", own.values, TEN, "a payload")
                for key in ("covariance", "covariance_systematic"):
                    matrix = getattr(own, key)
                    path = f"{place}.payload.{key}"
                    yield from wrong_shape(path, matrix, (len(TEN),) * 2, "a payload")
                path = f"{place}.payload.freedom"
                yield from wrong_shape(path, own.freedom, (len(TEN),), "a payload")
            if found.consistent is not None:
                yield from wrong_names(
                    f"{place}.consistent.values", found.consistent.values, names, of
                )
                for key in ("moved", "spread", "low", "high"):
                    numbers = getattr(found.consistent, key)
                    yield from wrong_shape(f"{place}.consistent.{key}", numbers, (count,), of)
            others = 0
            if found.systematic is not None:
                others = len(found.systematic.deviations)
                for key, shape in (("response", (count, others)), ("left", (others, others))):
                    matrix, path = getattr(found.systematic, key), f"{place}.systematic.{key}"
                    yield from wrong_shape(path, matrix, shape, f"{of} and deviations")
            if (joint := found.covariance_joint) is not None:
                size = min(max(len(joint), count), count + others)
                key = f"{place}.covariance_joint"
                yield from wrong_covariance(key, joint, size, f"{of} and deviations")
        if self.diagnostics is not None:
            tested, recordings = self.diagnostics.experiments, len(self.recordings)
            yield from wrong_count("diagnostics.experiments", tested, recordings, "recordings")

    @property
    def numbers(self) -> tuple[int | None, ...]:
        """What is appended to the tables of each recording; nothing when there is one."""
        count = len(self.recordings)
        return tuple(range(1, count + 1)) if count > 1 else (None,)

    @property
    def best_estimator(self) -> EstimatorKeys:
        """What the estimator to use found."""
        return self.estimators[self.best]

    @classmethod
    def of(cls, result: EstimationResult, diagnosis: Diagnosis | None) -> Self:
        """Describe a result."""
        knowledge = result.knowledge
        return copied(
            cls,
            result,
            name=result.configuration.run.name,
            robot=result.robot.name,
            parameters=knowledge.names,
            fixed=tuple(np.array(knowledge.names)[~knowledge.free].tolist()),
            best=result.best.estimator,
            recordings=tuple(RecordingKeys.of(record) for record in result.records),
            estimators={
                name: EstimatorKeys.of(result, found) for name, found in result.estimates.items()
            },
            cramer_rao_covariance=result.bound,
            covariance_ml_less_gm=covariance_ml_less_gm(result.estimates),
            intervals_note=_intervals_note(result),
            diagnostics=None if diagnosis is None else diagnosis.keys,
        )


def _intervals_note(result: EstimationResult) -> str:
    if not result.intervals_cover:
        return (
            "pointwise differentiation: the lengths' noise is in the regressor, which biases "
            "the estimates and is not in the intervals; they do not cover"
        )
    systematic = result.best.systematic
    counted = all(e.noise.forces.lines is not None for e in result.experiments)
    noise = f"the noise of forces and lengths, {'as it is' if counted else 'taken for white'}"
    if systematic is None or not systematic.inexact:
        return (
            f"95 %, with {noise}; they hold for exact geometry and force "
            f"constants: {_NO_TOLERANCES[bool(toleranced_deviations(result.robot))]}"
        )
    verb = "and what is left of" if systematic.with_priors else "and"
    return f"95 %, with {noise}, {verb} the robot's tolerances"


_NO_TOLERANCES = {
    False: "the robot file gives no tolerances",
    True: "its tolerances are left out (estimate.systematic: none)",
}
