"""How surely the validation tells a right model from a wrong one, on many simulated experiments.

The paper's Fig. 7: a model is identified on the designed motion and predicts the benchmark. It is
right, or the machine has a cogging force that the model does not know, or one of its parameters is
wrong on purpose.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from constraints.arrays import Mask
from estimation.studies.records import (
    POWER,
    VARIANCES,
    VERDICTS,
    Claim,
    PowerRow,
    VarianceRow,
    VerdictRow,
)
from estimation.studies.statistics import Share
from estimation.studies.study import (
    Study,
    TooFewEstimatesError,
    all_estimated,
    repeated,
    study_section,
)
from estimation.studies.validation_runs import SITUATIONS, Predicted, ValidationBench, ValidationRun
from estimation.validation.motions import motion_name
from expdesign.configuration import RunConfiguration
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import RowTable
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor

_WANTED = 0.95
"""Share of the runs in which a verdict must be right: 38 of 40."""

_POWER = 0.8
_MOST = 0.5
_PAPER = "992.0 and 594.1 N² against 883.0 and 371.9 N² of noise"
_PAPER_ACTUATORS = [2, 3]


@dataclass(frozen=True, eq=False)
class ValidationStudy(Study):
    """All runs but those that `failed` to be estimated; the first one's motions are drawn."""

    motions: tuple[str, ...]
    runs: tuple[ValidationRun, ...]
    failed: int
    first: Predicted

    @classmethod
    def run(
        cls,
        configuration: RunConfiguration,
        design: FourierTrajectory,
        monitor: Monitor | None = None,
    ) -> ValidationStudy:
        """Identify, predict and test many times.

        Raises
        ------
        InputError
            The run cannot be simulated or estimated, or a motion cannot be made.
        TooFewEstimatesError
            No run can be estimated.
        StoppedError
            A stop was requested.
        """
        build = partial(ValidationBench, configuration, design)
        bench = build()
        done = repeated(configuration, build, monitor)
        numbers = [number for number, run in enumerate(done, start=1) if run is not None]
        if not numbers:
            raise TooFewEstimatesError("no run of the study could be estimated")
        return cls(
            configuration,
            bench.robot,
            tuple(map(motion_name, study_section(configuration).motions)),
            tuple(done[number - 1] for number in numbers),
            len(done) - len(numbers),
            bench.predicted(numbers[0], bench.estimates(numbers[0])),
        )

    def expected(self, situation: str) -> Mask:
        """Return which actuators should fail, (6,)."""
        amplitudes = np.broadcast_to(self.section.cogging.amplitude, ACTUATORS)
        return np.asarray((amplitudes > 0) & (situation == "unknown"))

    def as_expected(self, situation: str, motion: int | None = None) -> Share:
        """Return how often exactly the right actuators fail on a motion, from 0, or on all."""
        wanted = self.expected(situation)
        which = slice(None) if motion is None else slice(motion, motion + 1)
        return Share.of(
            [all(one.says(wanted) for one in run.situations[situation][which]) for run in self.runs]
        )

    def power(self, parameter: str) -> Share:
        """Return how often a wrong parameter is seen on the first motion."""
        return Share.of([bool(run.wrong[parameter].against) for run in self.runs])

    def tests_against(self, parameter: str) -> list[tuple[str, int]]:
        """Return which tests saw a wrong parameter, and in how many runs, most often first."""
        seen: Counter[str] = Counter()
        for run in self.runs:
            seen.update(set(run.wrong[parameter].against))
        return sorted(seen.items(), key=lambda item: (-item[1], item[0]))

    def claims(self) -> Iterator[Claim]:
        """Yield what the study was to show."""
        for situation, number in self._predicted():
            yield self._verdict_claim(situation, number)
        struts = np.flatnonzero(self.expected("unknown"))
        for number, motion in enumerate(self.motions):
            rows = self._variances("unknown", number)
            model = " and ".join(f"{rows[j].variance_model_error:.1f}" for j in struts)
            noise = " and ".join(f"{rows[j].variance_measurement_error:.1f}" for j in struts)
            yield Claim(
                f"{motion}: variance about the prediction of actuators {_listed(struts)} with "
                "cogging that the model does not know",
                f"{model} N² against {noise} N² of noise",
                _PAPER if list(struts) == _PAPER_ACTUATORS else "",
            )
        for situation in ("without", "unknown"):
            share = self.as_expected(situation)
            yield Claim(
                f"{SITUATIONS[situation]}: the verdict is right on all motions of a run",
                str(share),
                holds=share.hits >= _WANTED * share.trials,
            )
        yield self._power_claim()
        yield all_estimated("run", len(self.runs) + self.failed, self.failed)

    def rows(self) -> dict[RowTable[Any], Iterable[Any]]:
        """Return the rows of every table."""
        return {
            VARIANCES: [row for motion in self._predicted() for row in self._variances(*motion)],
            POWER: self._power(),
            VERDICTS: self._verdicts(),
        }

    def _predicted(self) -> Iterator[tuple[str, int]]:
        """Return every situation with the number of every motion, from 0."""
        return product(SITUATIONS, range(len(self.motions)))

    def _verdict_claim(self, situation: str, number: int) -> Claim:
        title = f"{SITUATIONS[situation]}, {self.motions[number]}"
        if situation == "known":
            rows = self._variances(situation, number)
            most = [row.actuator - 1 for row in rows if row.fails > _MOST * row.runs]
            return Claim(
                f"{title}: reported, not judged",
                f"actuators that fail in most runs: {_listed(most)}",
            )
        share = self.as_expected(situation, number)
        wanted = np.flatnonzero(self.expected(situation))
        failing = f"exactly actuators {_listed(wanted)} fail"
        return Claim(
            f"{title}: {failing if wanted.size else 'all actuators pass'}",
            str(share),
            "actuators 3 and 4 fail" if wanted.size else "",
            holds=share.hits >= _WANTED * share.trials,
        )

    def _power_claim(self) -> Claim:
        wrong = self.section.wrong
        shares = {name: self.power(name) for name in wrong}
        weak = [name for name, share in shares.items() if share.hits < _POWER * share.trials]
        seen = {test for name in wrong for test, _ in self.tests_against(name)}
        value = f"{len(wrong) - len(weak)} of {len(wrong)} parameters"
        if seen:
            value += "; tests that fail: " + ", ".join(f"'{test}'" for test in sorted(seen))
        if weak:
            listed = ", ".join(f"{name} ({shares[name]})" for name in weak)
            value += f"; the power is below {100 * _POWER:.0f} % for {listed}"
        factors = ", ".join(f"{name} by {factor:g}" for name, factor in wrong.items())
        return Claim(
            f"a parameter that is wrong on purpose ({factors}; one at a time) fails a test in at "
            f"least {100 * _POWER:.0f} % of the runs",
            value,
        )

    def _variances(self, situation: str, number: int) -> list[VarianceRow]:
        """Return the rows of all actuators on one motion."""
        found = [run.situations[situation][number] for run in self.runs]
        model = np.mean([one.variances.model_error for one in found], axis=0)
        noise = np.mean([one.variances.measurement_error for one in found], axis=0)
        fails = np.sum([one.bias.failed for one in found], axis=0)
        motion, runs = self.motions[number], len(found)
        return [
            VarianceRow(situation, motion, j + 1, model[j], noise[j], int(fails[j]), runs)
            for j in range(ACTUATORS)
        ]

    def _verdicts(self) -> Iterator[Any]:
        for number, run in enumerate(self.runs, start=1):
            for situation in SITUATIONS:
                for motion, one in zip(self.motions, run.situations[situation], strict=True):
                    fails = (bool(failed) for failed in one.bias.failed)
                    yield VerdictRow(number, situation, motion, *fails, "; ".join(one.against))

    def _power(self) -> Iterator[PowerRow]:
        for name, factor in self.section.wrong.items():
            share = self.power(name)
            yield PowerRow(
                name,
                factor,
                share.hits,
                share.trials,
                share.hits / share.trials,
                share.low,
                share.high,
                "; ".join(f"{test}: {count}" for test, count in self.tests_against(name)),
            )


def _listed(places: Any) -> str:
    return " and ".join(str(j + 1) for j in places) or "none"
