"""Several motions of one experiment: designed one after another, then each again with the others.

The motions share the measuring time equally. Each has periods, limits and a proof like a single
design; the criterion is that of all recordings together, with the information F₁ + … + F_K.

In the greedy phase each motion adds most to those before it. In the exchange phase the motions in
turn are improved with the others fixed, until none gains anything: block coordinate ascent. At its
end no motion can be improved alone; changing several together might still gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from itertools import cycle, islice
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from expdesign.configuration import RunConfiguration
from expdesign.configuration.several_runs import motion_folders, motion_runs, seed_of
from expdesign.experiment import result
from expdesign.experiment.design import FoundMotion, design_result, find_motion
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.precision import (
    combine_effects,
    derived_precisions,
    experiment_information,
    experiment_tolerance_effects,
    imprecise,
    parameter_precisions,
    precision,
    tolerance_std,
)
from expdesign.experiment.setup import plan_search
from expdesign.information import fisher
from expdesign.robot.derived import KnownQuantity
from expdesign.runfolder import OpenNumber, RunFile, StageResult, Table, described
from expdesign.solver.search import NoDesignError
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import JobJournal, Monitor, StoppedError

LEAST_GAIN = 1e-3
"""Gain per parameter, as a logarithm, of an exchange that counts: 0.1 % of D-efficiency."""
STOPPED = "stopped"
"""Reason for the end of exchanges that were interrupted."""
ROUNDS = 5
"""Largest number of exchanges of each motion."""


@dataclass(frozen=True)
class DesignedMotion:
    """One of several motions."""

    number: Annotated[int, described("1", "of the motion, from 1")]
    folder: Annotated[str, described("", "its run folder")]
    status: Annotated[str, described("", "converged, not converged, limits broken or interrupted")]
    certified: Annotated[bool, described("", "every limit is proved to be kept at every instant")]
    period: Annotated[float, described("s", "of the motion")]
    periods: Annotated[float, described("1", "number of periods")]
    measuring_time: Annotated[float, described("s", "of these periods")]
    log_det_information: Annotated[
        OpenNumber, described("1", "log det F of one period of this motion alone, SI")
    ]


@dataclass(frozen=True)
class MotionSearch:
    """One search of a motion with the others fixed."""

    search: Annotated[int, described("1", "number of the search, from 1")]
    motion: Annotated[int, described("1", "number of the motion")]
    phase: Annotated[
        str,
        described("", "greedy: added to the motions before it; exchange: improved with the others"),
    ]
    criterion_value: Annotated[
        OpenNumber,
        described("", "criterion after it, of the mean information of the motions by then"),
    ]
    gain_percent: Annotated[
        OpenNumber,
        described(
            "%",
            "gain per parameter over the motion before; empty in the greedy phase and where none "
            "was found",
        ),
    ]
    accepted: Annotated[bool, described("", f"gains {100 * LEAST_GAIN:g} % or more")]


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionsResult(RunFile, StageResult):
    """Several motions of one experiment, with the predicted precision of all recordings."""

    FILE: ClassVar[str] = "motions.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign design` of a run with several motions"

    criterion: Annotated[str, described("", "the optimised criterion: d, a, e or condition")]
    criterion_value: Annotated[
        OpenNumber,
        described(
            "",
            "of the mean information of the motions over one period: comparable with that of a "
            "single motion of the same measuring time",
        ),
    ]
    log_det_information: Annotated[
        OpenNumber, described("", "log det of that mean, for the noise alone, SI")
    ]
    samples: Annotated[int, described("1", "samples of one period in the information")]
    predicted_std: Annotated[
        result.PredictedStd,
        described(
            "SI", "as in design.json, of all recordings; per_period: of the mean information"
        ),
    ]
    derived: Annotated[
        tuple[KnownQuantity, ...],
        described("", "mass, centre, inertia and further quantities; of each the table's columns"),
        Table("tables/motions_derived.csv", optional=True),
    ] = ()
    ended: Annotated[str, described("", "reason for the end of the exchanges")]
    seconds: Annotated[float, described("s", "time of all searches")]
    cpu_seconds: Annotated[float, described("s", "processor time of all searches")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]
    motions: Annotated[tuple[DesignedMotion, ...], Table("tables/motions.csv")]
    searches: Annotated[tuple[MotionSearch, ...], Table("tables/motions_search.csv")]
    parameters: Annotated[
        tuple[result.ParameterPrecision, ...], Table("tables/motions_parameters.csv")
    ]

    @property
    def measuring_time(self) -> Annotated[float, described("s", "of all motions")]:
        """Measuring time of all motions, s."""
        return sum(one.measuring_time for one in self.motions)

    @property
    def interrupted(self) -> bool:
        """Whether the exchanges were stopped before their end."""
        return self.ended == STOPPED


Searching = Callable[[RunConfiguration], AbstractContextManager[Monitor]]
"""Context of a search, which shows its events."""


def design_motions(
    configuration: RunConfiguration,
    folder: Path,
    searching: Searching,
    journal: JobJournal | None = None,
) -> tuple[MotionsResult, list[result.DesignResult]]:
    """Design the motions of a run, in folders of `folder`, and return the whole and each of them.

    `searching` shows each search; a request to stop of its monitor before every motion has a design
    is a `StoppedError`.
    """
    ascent = _Ascent(motion_runs(configuration, folder), searching, journal)
    for _ in ascent.runs:
        ascent.add()
    ended = ascent.exchange()
    designs = ascent.designs()
    return _motions_result(configuration, ascent, designs, ended), designs


@dataclass(eq=False)
class _Ascent:
    """The motions found so far, and their searches."""

    runs: list[RunConfiguration]
    searching: Searching
    journal: JobJournal | None
    found: list[FoundMotion] = field(default_factory=list)
    searches: list[MotionSearch] = field(default_factory=list)
    stopped: bool = False
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    def add(self) -> None:
        """Find the motion that adds most to those before it."""
        self.found.append(self._search(len(self.found)))
        self._note(len(self.found) - 1, "greedy", np.nan, accepted=True)
        if self.stopped and len(self.found) < len(self.runs):
            raise StoppedError(
                f"interrupted after {len(self.found)} of {len(self.runs)} motions were designed"
            )

    def exchange(self) -> str:
        """Improve each motion with the others fixed, in turn; return why it ended, in words."""
        # The last motion of the greedy phase is the best one for the others.
        count, idle = len(self.runs), 1
        for place in islice(cycle(range(count)), ROUNDS * count):
            idle = 1 if not self.stopped and self._improve(place) else idle + 1
            if self.stopped:
                return STOPPED
            if idle >= count:
                return f"no motion gains {100 * LEAST_GAIN:g} % with the others fixed"
        return f"{ROUNDS} exchanges of each motion were made"

    def _improve(self, place: int) -> bool:
        """Search from a motion with the others fixed; return whether that gained anything."""
        before = self.found[place]
        try:
            made = self._search(place, before.search.trajectory)
        except (NoDesignError, StoppedError):
            self._note(place, "exchange", np.nan, accepted=False)
            return False
        evaluator, samples = made.plan.evaluator, made.plan.problem.cost.samples
        merits = [evaluator.merit(one.search.trajectory, samples) for one in (made, before)]
        gain = evaluator.gain(*merits)
        check, was = made.search.finish.check, before.search.finish.check
        accepted = gain > LEAST_GAIN and check.passed and check.certified >= was.certified
        if accepted:
            self.found[place] = made
        self._note(place, "exchange", float(100 * np.expm1(gain)), accepted=accepted)
        return accepted

    def _search(self, place: int, origin: FourierTrajectory | None = None) -> FoundMotion:
        run, number = self.runs[place], len(self.searches)
        changes: dict[str, Any] = {} if origin is None else {"starts": 1}
        run = run.with_section("design", seed=seed_of(run.run.design.seed, number), **changes)
        if self.journal is not None:
            self.journal.prefix = f"search {number + 1}, "
        with self.searching(run) as monitor:
            try:
                made = find_motion(run, monitor, self.journal, self._others(place), origin)
            finally:
                self.stopped = monitor.stop_requested()
        self.seconds += made.search.seconds
        self.cpu_seconds += made.search.cpu_seconds
        return made

    def _others(self, place: int) -> list[FourierTrajectory]:
        return [one.search.trajectory for k, one in enumerate(self.found) if k != place]

    def _note(self, place: int, phase: str, gain: float, *, accepted: bool) -> None:
        plan = plan_search(self.runs[place], self._others(place))
        evaluator, samples = plan.evaluator, plan.problem.cost.samples
        # Of this motion and the others together.
        total = evaluator.information(self.found[place].search.trajectory, samples)
        value = evaluator.value(total / len(self.found))
        number = len(self.searches) + 1
        self.searches.append(MotionSearch(number, place + 1, phase, value, gain, accepted))

    def designs(self) -> list[result.DesignResult]:
        """Return the motions as designs, judged together with the others."""
        return [
            design_result(run, replace(one, plan=plan_search(run, self._others(place))))
            for place, (run, one) in enumerate(zip(self.runs, self.found, strict=True))
        ]


def _motions_result(
    configuration: RunConfiguration,
    ascent: _Ascent,
    designs: Sequence[result.DesignResult],
    ended: str,
) -> MotionsResult:
    run, evaluator, first = ascent.runs[0], noise_evaluator(ascent.runs[0]), designs[0]
    parts = [experiment_information(evaluator, one.trajectory, run) for one in designs]
    whole, total = np.sum([part[0] for part in parts], axis=0), sum(part[1] for part in parts)
    mean = np.mean([one.information for one in designs], axis=0)
    effects = combine_effects(
        [experiment_tolerance_effects(run, evaluator, one.trajectory) for one in designs],
        [part[1] for part in parts],
    )
    random = fisher.parameter_covariance(whole, evaluator.names)
    errors = effects.shares(random, total, estimated=run.run.estimate.estimates_tolerances)
    predicted = result.PredictedStd(
        per_period=precision(evaluator, mean, first.samples, 1),
        experiment=precision(evaluator, whole, total, configuration.run.experiment.periods),
        **tolerance_std(evaluator.names, errors),
    )
    folders = motion_folders(configuration, Path())
    own = [
        f"motion {number}: {text}"
        for number, one in enumerate(designs, start=1)
        for text in one.warnings[len(configuration.warnings) :]
    ]
    return MotionsResult(
        name=configuration.run.name,
        robot=evaluator.robot.name,
        criterion=first.criterion,
        criterion_value=ascent.searches[-1].criterion_value,
        log_det_information=evaluator.log_det(mean),
        samples=first.samples,
        predicted_std=predicted,
        derived=derived_precisions(run, evaluator, errors),
        ended=ended,
        seconds=ascent.seconds,
        cpu_seconds=ascent.cpu_seconds,
        warnings=(
            *configuration.warnings,
            *own,
            *imprecise(evaluator.robot, predicted, errors),
        ),
        motions=tuple(
            DesignedMotion(
                number=number,
                folder=folder.name,
                status=one.status,
                certified=one.check.certified,
                period=one.period,
                periods=one.experiment.periods,
                measuring_time=one.period * one.experiment.periods,
                log_det_information=one.log_det_information,
            )
            for number, (one, folder) in enumerate(zip(designs, folders, strict=True), start=1)
        ),
        searches=tuple(ascent.searches),
        parameters=tuple(parameter_precisions(evaluator.robot, predicted, errors)),
    )
