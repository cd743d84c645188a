"""The study: K repetitions in parallel, kept as they come, and judged against truth and bound."""

from __future__ import annotations

import json
import os
from collections import deque
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.estimators import ParameterPriors
from estimation.identification.estimate import refuse_ml_without_fit
from estimation.montecarlo.repetition import Outcome, Repetition, Workbench
from estimation.montecarlo.statistics import (
    ParameterStatistics,
    PooledStatistics,
    parameter_statistics,
    pooled_statistics,
)
from estimation.twin import Truth
from expdesign.configuration import ConfigurationLike, RunConfiguration, load_run
from expdesign.configuration.section import unstated
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.progress import report_progress
from expdesign.robot import Robot
from expdesign.runfolder.fields import checker
from expdesign.runfolder.files import FORMAT, check_format, errors_naming, json_values, write_text
from expdesign.runfolder.manifest import package_versions, text_hash
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Job, Monitor, cluster_jobs, run_jobs


@dataclass(frozen=True, eq=False)
class Study:
    """What a study found."""

    configuration: RunConfiguration
    robot: Robot
    knowledge: ParameterPriors
    truth: Truth
    bound: Array
    """(m, m), Cramér–Rao bound at the truth as a covariance; zero for fixed parameters."""
    repetitions: tuple[Repetition, ...]
    wanted: int
    """K. Fewer are done when the study was interrupted."""

    @property
    def interrupted(self) -> bool:
        """True when repetitions are missing."""
        return len(self.repetitions) < self.wanted

    @property
    def estimators(self) -> tuple[str, ...]:
        """Estimators in the order of the run file."""
        return self.configuration.run.montecarlo.estimators

    @property
    def bound_std(self) -> Array:
        """(m,) smallest standard deviations of an unbiased estimator, SI."""
        return np.sqrt(np.diag(self.bound))

    @property
    def free(self) -> NDArray[np.intp]:
        """Places of the parameters that are estimated."""
        return np.flatnonzero(self.knowledge.free)

    @property
    def identified(self) -> NDArray[np.intp]:
        """Places of the parameters whose bound is below half their scale: those that are pooled."""
        scales = self.robot.scales
        return np.flatnonzero(self.knowledge.free & (self.bound_std < IDENTIFIABLE * scales))

    def estimated(self, estimator: str) -> tuple[tuple[Repetition, Outcome], ...]:
        """Return the repetitions in which an estimator has an estimate."""
        pairs = ((r, r.outcomes[estimator]) for r in self.repetitions)
        return tuple((r, outcome) for r, outcome in pairs if not outcome.error)

    def failures(self, estimator: str) -> tuple[tuple[int, str], ...]:
        """Return number and reason of every repetition in which an estimator failed."""
        pairs = ((r.number, r.outcomes[estimator].error) for r in self.repetitions)
        return tuple((number, error) for number, error in pairs if error)

    def statistics(self, estimator: str) -> dict[str, ParameterStatistics]:
        """Return the statistics of every free parameter; none without an estimate."""
        errors, std, widths = self._samples(estimator)
        if not len(errors):
            return {}
        return {
            self.knowledge.names[k]: parameter_statistics(
                errors[:, k], std[:, k], widths[:, k], float(self.bound_std[k])
            )
            for k in self.free
        }

    def pooled(self, estimator: str) -> PooledStatistics | None:
        """Return the statistics of all identified parameters together."""
        errors, std, widths = self._samples(estimator)
        which = self.identified
        if not len(errors) or not len(which):
            return None
        return pooled_statistics(
            errors[:, which], std[:, which], widths[:, which], self.bound_std[which]
        )

    def _samples(self, estimator: str) -> tuple[Array, Array, Array]:
        """Return errors, std and half widths of intervals in std, (K, m) each."""
        found = self.estimated(estimator)
        shape = (-1, len(self.knowledge.names))
        values = np.array([outcome.values for _, outcome in found], dtype=float).reshape(shape)
        std = np.array([outcome.std for _, outcome in found], dtype=float).reshape(shape)
        widths = np.array([outcome.widths for _, outcome in found], dtype=float).reshape(shape)
        return values - self.truth.values_of(self.knowledge.names), std, widths


def run_study(
    config: ConfigurationLike,
    design: FourierTrajectory,
    journal: Path | None = None,
    monitor: Monitor | None = None,
) -> Study:
    """Repeat a simulated experiment K times and estimate each time.

    Repetition k depends on the run, the design, `montecarlo.seed` and k alone: neither the number
    of processes nor the order in which they end changes a digit.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Its sections `experiment`, `estimate` (but for the estimators) and `montecarlo`, and
        `workers` or `scheduler`.
    design : FourierTrajectory
        The motion that is commanded.
    journal : path, optional
        File that keeps every repetition when it is done. Those of the same inputs that it holds
        already are not done again.
    monitor : Monitor, optional

    Raises
    ------
    InputError
        The run cannot be simulated or estimated.
    UnidentifiableError
        The experiment does not determine every free parameter.
    WorkerDiedError, ClusterError
        What was done until then is in the journal.
    """
    configuration = load_run(config)
    refuse_ml_without_fit(configuration, configuration.run.montecarlo.estimators, "montecarlo")
    report_progress("the machine and the Cramér–Rao bound")
    recipe = partial(Workbench.of, configuration, design)
    with threadpool_limits(limits=1, user_api="blas"):
        bench = recipe()
        bound = bench.bound()
    wanted = configuration.run.montecarlo.repetitions
    kept = None if journal is None else Journal(journal, study_inputs(configuration, design))
    known = {} if kept is None else kept.done
    done = {number: repetition for number, repetition in known.items() if number <= wanted}
    missing = [number for number in range(1, wanted + 1) if number not in done]
    monitor = monitor or Monitor()
    monitor.advanced(len(done), wanted)
    jobs = [Job(_repetition, (number,)) for number in missing]
    scheduler, workers = configuration.run.scheduler, configuration.run.workers or 1
    results = (
        run_jobs(recipe, jobs, workers, Monitor(monitor.stop_requested))
        if scheduler is None or not jobs
        else cluster_jobs(scheduler, recipe, deque(jobs), monitor.stop_requested)
    )
    for repetition in results:
        if kept is not None:
            kept.add(repetition)
        done[repetition.number] = repetition
        monitor.advanced(len(done), wanted)
    return Study(
        configuration=configuration,
        robot=bench.robot,
        knowledge=bench.knowledge,
        truth=bench.twin.truth,
        bound=bound,
        repetitions=tuple(done[number] for number in sorted(done)),
        wanted=wanted,
    )


def study_inputs(configuration: RunConfiguration, design: FourierTrajectory) -> str:
    """Return the hash of what every repetition is made from, their number left out."""
    run = configuration.run
    exclude = unstated(run)
    exclude["estimate"] = exclude.get("estimate", {}) | {"estimators": True}
    sections = run.model_dump_json(
        include={
            "robot": True,
            "experiment": True,
            "estimate": True,
            "montecarlo": {"estimators", "seed"},
        },
        exclude=exclude,
    )
    coefficients = " ".join(value.hex() for value in design.vector().tolist())
    return text_hash(sections, coefficients, sorted(package_versions().items()))


def _repetition(bench: Workbench, _monitor: Monitor, number: int) -> Repetition:
    return bench.repeat(number)


_FORMAT = 1
NAME = "montecarlo/repetitions.jsonl"


class Journal:
    """Repetitions on disk.

    Parameters
    ----------
    path : Path
    inputs : str
        Hash of what repetitions are made from. A journal of other inputs counts as empty, and is
        replaced when the first repetition is added.

    Attributes
    ----------
    done : dict of Repetition
        By number.
    """

    def __init__(self, path: Path, inputs: str) -> None:
        self.path = path
        self.done: dict[int, Repetition] = {}
        self._header = json.dumps({FORMAT: _FORMAT, "inputs": inputs}) + "\n"
        self._inputs = inputs
        self._valid = self._read()

    def _read(self) -> int:
        """Take what the file holds; return how many of its bytes are whole lines of this study."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return 0
        if not lines or not self._is_of_this_study(lines[0]):
            return 0
        size = len(lines[0])
        for line in lines[1:]:
            try:
                repetition = checker(Repetition).validate_json(line)
            except ValueError:
                break
            if not line.endswith(b"\n"):
                break
            self.done[repetition.number] = repetition
            size += len(line)
        return size

    def _is_of_this_study(self, line: bytes) -> bool:
        try:
            header = json.loads(line)
        except ValueError:
            return False
        if not isinstance(header, dict) or header.get("inputs") != self._inputs:
            return False
        check_format(self.path, header.get(FORMAT), _FORMAT)
        return True

    def add(self, repetition: Repetition) -> None:
        """Keep a repetition; it is on disk when this returns."""
        if not self._valid:
            write_text(self.path, self._header)
            self._valid = len(self._header)
        line = (
            json.dumps(json_values(checker(Repetition).dump_python(repetition))) + "\n"
        ).encode()
        with errors_naming(self.path), self.path.open("r+b") as stream:
            stream.truncate(self._valid)
            stream.seek(self._valid)
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._valid += len(line)
        self.done[repetition.number] = repetition
