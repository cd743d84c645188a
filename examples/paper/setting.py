"""Settings, claims and results that the three studies share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import pandas as pd

from estimation.montecarlo.study import FAILURES
from expdesign.configuration import ComputationError, RunConfiguration, load_run
from expdesign.workers import Job, Monitor, run_jobs
from results.figures.drawing import FigureDefinition

T = TypeVar("T")

PAPER_ROBOT = "palida"
"""The robot of the paper: comparisons with printed values apply to it alone."""

_FULL: dict[str, dict[str, Any]] = {
    "trajectory": {
        "harmonics": 5,
        "frequency": ["0.1 Hz", "0.6 Hz"],
        "samples": 200,
        "controller_period": "1 ms",
    },
    "design": {"search": "restarts", "starts": 2},
}
_QUICK: dict[str, dict[str, Any]] = {
    "trajectory": {
        "harmonics": 2,
        "frequency": ["0.1 Hz", "0.6 Hz"],
        "samples": 40,
        "controller_period": "20 ms",
    },
    "design": {"search": "restarts", "starts": 1, "max_iterations": 12},
    # With five periods of so small a design the difference test rejects one in four.
    "experiment": {"periods": 20, "sampling": "50 Hz"},
}

_FEWEST = 3


class TooFewEstimatesError(ComputationError):
    """Noise made so many estimations fail that nothing can be compared."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, tested on the digital twin.

    `paper` is the printed value; it is empty where there is none, and for other robots. `holds` is
    None for a number that is reported without a verdict.
    """

    statement: str
    value: str
    paper: str = ""
    holds: bool | None = None


@dataclass(frozen=True, eq=False)
class StudyResult:
    """Claims of one study, its tables by file name, and further figures with their data."""

    title: str
    claims: tuple[Claim, ...]
    tables: Mapping[str, pd.DataFrame]
    figures: tuple[tuple[FigureDefinition[Any], Any], ...] = ()


@dataclass(frozen=True)
class Setting:
    """Robot and size of the studies: a robot by name or file, full or quick."""

    robot: str = PAPER_ROBOT
    quick: bool = False
    workers: int = 2

    @property
    def is_paper_robot(self) -> bool:
        """Whether the results can be compared with printed values."""
        return self.robot == PAPER_ROBOT

    def printed(self, value: str) -> str:
        """Return a value that the paper prints; empty for another robot."""
        return value if self.is_paper_robot else ""

    def configuration(self, **sections: Any) -> RunConfiguration:
        """Load the run of a study, with keys of its sections changed."""
        run: dict[str, Any] = {"name": "paper", "robot": self.robot, "workers": self.workers}
        run |= _QUICK if self.quick else _FULL
        for name, section in sections.items():
            run[name] = run.get(name, {}) | section if isinstance(section, dict) else section
        return load_run(run)


def require_estimates(what: str, found: Sequence[T | None]) -> tuple[T, ...]:
    """Return the experiments that could be estimated.

    Raises
    ------
    TooFewEstimatesError
        There are fewer than three.
    """
    kept = tuple(one for one in found if one is not None)
    if len(kept) < _FEWEST:
        raise TooFewEstimatesError(f"{what}: only {len(kept)} of {len(found)} could be estimated")
    return kept


def completeness_claim(what: str, kept: int, total: int) -> Claim:
    """Return the claim that every run or experiment of a study can be estimated."""
    return Claim(f"every {what} can be estimated", f"{kept} of {total}", holds=kept == total)


def repeat(setting: Setting, what: str, build: Callable[[], Any], count: int) -> list[Any]:
    """Return `build().repeat(number)` for 1 … count; None where noise made an estimation fail.

    The bench is built once per process.
    """
    jobs = [Job(_repetition, (number,)) for number in range(1, count + 1)]
    return list(run_in_processes(setting, what, build, jobs))


def _repetition(bench: Any, _monitor: Monitor, number: int) -> Any:
    try:
        return bench.repeat(number)
    except FAILURES:
        return None


def run_in_processes(
    setting: Setting, what: str, build: Callable[[], Any], jobs: list[Job]
) -> Iterator[Any]:
    """Yield the results of jobs in their order, and print how many are done."""
    for done, result in enumerate(run_jobs(build, jobs, setting.workers, Monitor()), start=1):
        print(f"\r{what}: {done} of {len(jobs)}", end="", file=sys.stderr, flush=True)
        yield result
    print(file=sys.stderr)
