"""Monte-Carlo study: K simulated experiments, estimated in parallel, judged against the truth."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.estimators import (
    Experiment,
    ParameterEstimate,
    ParameterPriors,
    cramer_rao_covariance,
)
from estimation.estimators.experiment import MotionEstimate
from estimation.identification.estimation import (
    parameter_priors,
    refuse_ml_without_fit,
    run_estimators,
)
from estimation.identification.periods import UnsuitableDataError
from estimation.identification.recording import (
    linearise_at_load,
    prepare_experiment,
    with_stated_spectrum,
)
from estimation.measurement_model import HarmonicMotion
from estimation.montecarlo.result import (
    EstimatorStatistics,
    Failure,
    MonteCarloResult,
    Repetition,
    RepetitionCounts,
    RepetitionEstimate,
    StatisticsRow,
    parameter_statistics,
    pooled_statistics,
)
from estimation.processing import (
    NoiseEstimate,
    NoiseModel,
    PeriodicRecording,
    PeriodSource,
    fold_recording,
)
from estimation.twin import Twin
from estimation.twin.disturbances import NoiseSource
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import ComputationError, ConfigurationLike, RunConfiguration, load_run
from expdesign.configuration.run import add_back_emf
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.terms import parameter_unit
from expdesign.progress import report_progress
from expdesign.robot import Robot, robot_from
from expdesign.runfolder.journal import Journal
from expdesign.runfolder.manifest import package_versions, text_hash
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import ClusterError, Job, Monitor, cluster_jobs, run_jobs


def run_study(
    config: ConfigurationLike,
    design: FourierTrajectory,
    journal: Path | None = None,
    monitor: Monitor | None = None,
) -> MonteCarloResult:
    """Simulate an experiment K times and estimate the parameters of each repetition.

    Repetition k depends on the run, the design, `montecarlo.seed` and k alone: the results are the
    same for any number of processes.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Its sections `experiment`, `estimate` (but for the estimators) and `montecarlo`, and
        `workers` or `scheduler`.
    design : FourierTrajectory
        The motion that is commanded.
    journal : path, optional
        File of the finished repetitions. Repetitions of the same inputs in it are not done again.
    monitor : Monitor, optional
        A lost cluster ends the study as a request to stop does, and is reported here.

    Raises
    ------
    InputError
        The run cannot be simulated or estimated.
    UnidentifiableError
        The experiment does not determine every free parameter.
    WorkerDiedError, ClusterError
        The finished repetitions are in the journal.
    """
    configuration = load_run(config)
    refuse_ml_without_fit(configuration, configuration.run.montecarlo.estimators, "montecarlo")
    report_progress("the machine and the Cramér–Rao bound")
    recipe = partial(Workbench.of, configuration, design)
    with threadpool_limits(limits=1, user_api="blas"):
        bench = recipe()
        bound = bench.bound()
    wanted = configuration.run.montecarlo.repetitions
    kept: Journal[Repetition, int] | None = None
    if journal is not None:
        inputs = study_inputs(configuration, design)
        kept = Journal(journal, inputs, Repetition, attrgetter("number"))
    known = {} if kept is None else kept.done
    done = {number: repetition for number, repetition in known.items() if number <= wanted}
    missing = [number for number in range(1, wanted + 1) if number not in done]
    watch = monitor or Monitor()
    watch.advanced(len(done), wanted)
    jobs = [Job(_repetition, (number,)) for number in missing]
    scheduler, workers = configuration.run.scheduler, configuration.run.workers or 1
    results = (
        run_jobs(recipe, jobs, workers, Monitor(watch.stop_requested))
        if scheduler is None or not jobs
        else cluster_jobs(scheduler, recipe, deque(jobs), watch.stop_requested)
    )
    try:
        for repetition in results:
            if kept is not None:
                kept.add(repetition)
            done[repetition.number] = repetition
            watch.advanced(len(done), wanted)
    except ClusterError as error:
        if monitor is None or not done:
            raise
        monitor.report(error)
    return _result(bench, bound, tuple(done[number] for number in sorted(done)))


def _result(
    bench: Workbench, bound: Array, repetitions: tuple[Repetition, ...]
) -> MonteCarloResult:
    """Return the statistics of the repetitions; `bound` is the Cramér–Rao covariance, (m, m)."""
    run, truth, priors = bench.configuration.run, bench.twin.truth, bench.priors
    true, bound_std = truth.values_of(priors.names), np.sqrt(np.diag(bound))
    free = np.flatnonzero(priors.free)
    identified = np.flatnonzero(priors.free & (bound_std < IDENTIFIABLE * bench.robot.scales))
    statistics: dict[str, EstimatorStatistics] = {}
    rows: list[StatisticsRow] = []
    for estimator in run.montecarlo.estimators:
        outcomes = [(r.number, r.outcomes[estimator]) for r in repetitions]
        found = [(number, outcome) for number, outcome in outcomes if not outcome.error]
        shape = (-1, len(priors.names))
        errors, std, widths = (
            np.array([getattr(one, name) for _, one in found], dtype=float).reshape(shape)
            for name in ("values", "std", "widths")
        )
        errors = errors - true
        pooled = None
        if found and len(identified):
            pooled = pooled_statistics(
                errors[:, identified],
                std[:, identified],
                widths[:, identified],
                bound_std[identified],
            )
        statistics[estimator] = EstimatorStatistics(
            estimates=len(found),
            not_converged=tuple(n for n, outcome in found if not outcome.converged),
            failures=tuple(Failure(n, outcome.error) for n, outcome in outcomes if outcome.error),
            iterations=_counts(outcome.iterations for _, outcome in found),
            pooled=pooled,
        )
        rows += [
            StatisticsRow(
                estimator=estimator,
                parameter=priors.names[k],
                unit=parameter_unit(priors.names[k]),
                truth=float(true[k]),
                identified=bool(k in identified),
                estimates=len(found),
                **parameter_statistics(errors[:, k], std[:, k], widths[:, k], float(bound_std[k])),
            )
            for k in (free if found else ())
        ]
    return MonteCarloResult(
        name=run.name,
        robot=bench.robot.name,
        counts=RepetitionCounts(run.montecarlo.repetitions, len(repetitions)),
        estimators=statistics,
        parameters=tuple(priors.names[k] for k in free),
        identified=tuple(priors.names[k] for k in identified),
        truth=dict(zip(priors.names, true.tolist(), strict=True)),
        bound_covariance=bound,
        harmonics=_counts(repetition.harmonics for repetition in repetitions),
        settings={
            "seed": run.montecarlo.seed,
            "experiment": run.experiment.model_dump(mode="json"),
            "samples": truth.experiment.samples,
            "samples_per_period": truth.experiment.samples_per_period,
            "estimate": run.estimate.model_dump(mode="json", exclude={"estimators"}),
        },
        repetitions=repetitions,
        rows=tuple(rows),
    )


def _counts(values: Iterable[int | None]) -> dict[str, int]:
    """Return how often each number occurs, in ascending order."""
    counted = Counter(value for value in values if value is not None)
    return {str(value): counted[value] for value in sorted(counted)}


def study_inputs(configuration: RunConfiguration, design: FourierTrajectory) -> str:
    """Return the hash of the inputs that all repetitions share."""
    run = configuration.run
    sections = run.model_dump_json(
        include={
            "robot": True,
            "experiment": True,
            "estimate": True,
            "montecarlo": {"estimators", "seed"},
            "data": {"units"},  # of forces in volts
        },
        exclude={"estimate": {"estimators"}},
    )
    coefficients = " ".join(value.hex() for value in design.vector().tolist())
    return text_hash(sections, coefficients, sorted(package_versions().items()))


def _repetition(bench: Workbench, _monitor: Monitor, number: int) -> Repetition:
    return bench.repeat(number)


NAME = "montecarlo/repetitions.jsonl"


NUMERICAL_FAILURES = (ComputationError, ArithmeticError, np.linalg.LinAlgError)
"""Failures due to noise: no pose, no motion, a singular information matrix."""
FAILURES = (*NUMERICAL_FAILURES, UnsuitableDataError)
"""Failures of one recording that the next one need not have."""


@dataclass(frozen=True, eq=False)
class Workbench:
    """Twin and model that all repetitions share; built once per process."""

    configuration: RunConfiguration
    robot: Robot
    priors: ParameterPriors
    design: FourierTrajectory
    twin: Twin

    @classmethod
    def of(cls, configuration: RunConfiguration, design: FourierTrajectory) -> Workbench:
        """Build it; exceptions as of `run_study`."""
        twin = Twin.of(configuration, design, configuration.run.montecarlo.seed)
        if twin.back_emf is not None:
            configuration = add_back_emf(configuration, twin.back_emf)
        robot = robot_from(configuration.robot)
        priors = parameter_priors(configuration, robot)
        return cls(configuration, robot, priors, design, twin)

    def repeat(self, number: int) -> Repetition:
        """Simulate and estimate a repetition; only the noise depends on its number.

        A failed estimate states its reason in the result. Invalid input raises.
        """
        wanted = self.configuration.run.montecarlo.estimators
        try:
            experiment = prepare_experiment(
                self.configuration, self.robot, self.twin.measurement(number), self.design
            )
        except FAILURES as error:
            failed = RepetitionEstimate(error=_reason(error))
            return Repetition(number, None, np.inf, dict.fromkeys(wanted, failed))
        return Repetition(
            number,
            experiment.harmonics,
            experiment.noise.forces.freedom,
            self._outcomes(experiment, wanted),
        )

    def bound(self) -> Array:
        """Return the Cramér–Rao bound as a covariance, (m, m), SI; zero for fixed parameters.

        The bound holds at the true parameters along the executed motion, whose harmonics are the
        kinematic unknowns, with the true noise, the exact signs of dry friction, and all samples of
        the experiment. Priors count as data. The model is that of the run's robot, for any measured
        machine. Coloured noise counts line by line if a period is a whole number of samples,
        otherwise as white.
        """
        twin, truth = self.twin, self.twin.truth
        free_frequency = self.configuration.run.estimate.frequency == "estimated"
        measured = twin.as_measurement(twin.lengths, twin.forces)
        recording = fold_recording(
            measured, truth.executed.omega, PeriodSource.DESIGN, average=not free_frequency
        )
        motion = HarmonicMotion.of(truth.executed, free_frequency=free_frequency)
        noise = NoiseModel(
            _known_noise(twin.force_noise, recording), _known_noise(twin.length_noise, recording)
        )
        values = truth.values_of(self.robot.parameter_names)
        robot = self.robot.with_load_at(values)
        # The motion is known here: nothing of the fit but the motion itself is used.
        covariance = np.zeros((motion.unknowns, motion.unknowns))
        spread = np.zeros((recording.samples, robot.graph.signs.numel()))
        known = MotionEstimate(motion, covariance, spread)
        experiment = Experiment.along(robot, recording, noise, known)
        return cramer_rao_covariance(robot, [experiment], self.priors, values)

    def _outcomes(
        self, experiment: Experiment, wanted: tuple[str, ...]
    ) -> dict[str, RepetitionEstimate]:
        try:
            robot, experiments = linearise_at_load(self.robot, [experiment], self.priors)
            found = run_estimators(robot, experiments, self.priors, wanted)
        except NUMERICAL_FAILURES as error:
            if len(wanted) == 1:
                return {wanted[0]: RepetitionEstimate(error=_reason(error))}
            # One by one, to keep those that did not fail.
            return {name: self._outcomes(experiment, (name,))[name] for name in wanted}
        return {name: _outcome(found[name]) for name in wanted}


def _known_noise(source: NoiseSource, recording: PeriodicRecording) -> NoiseEstimate:
    plain = NoiseEstimate(source.covariance, np.inf, "given")
    if source.spectrum is None or not recording.averaged:
        return plain
    return with_stated_spectrum(plain, source.spectrum, recording)


def _outcome(estimate: ParameterEstimate) -> RepetitionEstimate:
    if not (np.all(np.isfinite(estimate.values)) and np.all(np.isfinite(estimate.std))):
        return RepetitionEstimate(
            error="the estimate is not finite", iterations=estimate.iterations
        )
    return RepetitionEstimate(
        estimate.values,
        estimate.std,
        interval_widths(estimate.freedom),
        estimate.converged,
        estimate.iterations,
    )


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
