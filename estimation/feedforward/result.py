"""The result of the stage `feedforward`: tracking errors of every feed-forward."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from constraints.arrays import Array
from expdesign.configuration import Problem
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    Column,
    Numbers,
    OpenNumber,
    RunFile,
    StageResult,
    Table,
    described,
    sized,
    strutwise,
)

CaseName = Literal["none", "gravity", "nominal", "identified", "true"]

MEANINGS: dict[CaseName, str] = {
    "none": "the controller alone",
    "gravity": "weight by the nominal model",
    "nominal": "forces of the nominal model",
    "identified": "forces of the identified model",
    "true": "forces of the true model",
}
"""Meanings of the feed-forwards, in the order of the cases."""

_Struts = Annotated[Numbers, sized(ACTUATORS)]


@dataclass(frozen=True, eq=False)
class ControllerSettings:
    """The controller of every strut, the same in all cases."""

    sampling: Annotated[float, described("Hz", "samples per second; forces are held between")]
    bandwidth: Annotated[float, described("Hz", "natural frequency of a single strut")]
    damping_ratio: Annotated[float, described("1", "of the same")]
    integral_corner: Annotated[float, described("Hz", "of the integral action; 0: none")]
    filter: Annotated[float, described("Hz", "corner of the filter of the error's rate")]
    mass: Annotated[_Struts, described("kg", "that a strut feels at home, the others held")]
    stiffness: Annotated[_Struts, described("N/m", "k")]
    damping: Annotated[_Struts, described("N s/m", "d")]
    integral: Annotated[_Struts, described("N/(m s)", "k_i")]


@dataclass(frozen=True)
class IntegrationSettings:
    """Settings of the numerical integration."""

    step: Annotated[float, described("s", "of the Runge-Kutta method")]
    width: Annotated[
        float, described("m/s", "speed over which the sign of dry friction is smoothed")
    ]
    change: Annotated[
        float,
        described(
            "1",
            "largest change of an rms error of the struts with half the step and half the width, "
            "as a share of the one without feed-forward",
        ),
    ]


@dataclass(frozen=True)
class FeedforwardCase:
    """Tracking errors of the platform with one feed-forward."""

    case: Annotated[CaseName, described("", "kind of feed-forward")]
    rms_struts: Annotated[float, described("m", "rms error of all struts")]
    max_struts: Annotated[float, described("m", "largest error of a strut")]
    rms_position: Annotated[float, described("m", "rms distance of the TCP from its place")]
    max_position: Annotated[float, described("m", "largest distance")]
    rms_rotation: Annotated[float, described("rad", "rms rotation error of the platform")]
    max_rotation: Annotated[float, described("rad", "largest angle")]
    rms_from_true: Annotated[
        float,
        described("m", "rms distance of the struts from their motion with the true model's forces"),
    ]
    rms_feedback: Annotated[float, described("N", "rms of the controller's own force")]
    limited: Annotated[float, described("1", "share of the forces that are at their limit")]
    reduction: Annotated[
        OpenNumber, described("1", "rms_struts without feed-forward over this one")
    ]


@dataclass(frozen=True)
class StrutRow:
    """Tracking errors of one strut with one feed-forward."""

    case: Annotated[str, described("", "kind of feed-forward")]
    strut: Annotated[int, described("1", "strut")]
    rms: Annotated[float, described("m", "rms of the error")]
    max: Annotated[float, described("m", "largest error")]
    rms_feedback: Annotated[float, described("N", "rms of the controller's own force")]


@dataclass(frozen=True, eq=False)
class Tracking:
    """Errors over the last period, commanded minus reached."""

    time: Annotated[Array, Column("t", "s", "time from the start of the period")]
    struts: Annotated[Array, strutwise("e", "m", "error")]
    position: Annotated[Array, Column("position", "m", "distance of the TCP from its place")]
    rotation: Annotated[Array, Column("rotation", "rad", "rotation error of the platform")]
    forces: Annotated[Array, strutwise("Q", "N", "commanded force")]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedforwardResult(RunFile, StageResult):
    """Tracking errors of one machine under one controller, feed-forward by feed-forward."""

    FILE: ClassVar[str] = "feedforward.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign run` of a file with `feedforward:`"
    estimate: Annotated[str, described("", "the `estimate.json` that is fed forward")]
    estimator: Annotated[str, described("", "ls, gm or ml")]
    machine: Annotated[
        Literal["twin", "drawn"],
        described("", "moving machine: the twin, or one drawn from the estimate's covariance"),
    ]
    motion: Annotated[str, described("", "which motion is followed")]
    period: Annotated[float, described("s", "its duration")]
    periods: Annotated[float, described("1", "number that was simulated; the last is judged")]
    controller: Annotated[ControllerSettings, described("", "gains and their design parameters")]
    integration: Annotated[IntegrationSettings, described("", "steps of the simulation")]
    cases: Annotated[tuple[FeedforwardCase, ...], described("", "feed-forward by feed-forward")]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]
    within_limits: Annotated[
        bool, described("", "the motion keeps every limit of the robot, which could make it")
    ]
    rows: Annotated[
        tuple[StrutRow, ...],
        Table("tables/feedforward.csv", rows_of=("case", "strut"), as_in=("case_names", "struts")),
    ]
    tracking: Annotated[tuple[Tracking, ...], Table("tables/tracking.csv", numbered="numbers")]
    """Case by case."""

    @property
    def numbers(self) -> range:
        """Numbers of the cases in the names of their tables."""
        return range(1, len(self.cases) + 1)

    @property
    def case_names(self) -> tuple[CaseName, ...]:
        """Names of the cases."""
        return tuple(each.case for each in self.cases)

    @property
    def struts(self) -> range:
        """Numbers of the struts."""
        return range(1, ACTUATORS + 1)

    def contradictions(self) -> Iterator[Problem]:
        """Yield the cases that a comparison needs and that are missing."""
        missing = {"none", "identified", "true"} - set(self.case_names)
        if missing:
            yield Problem(
                f"the cases {', '.join(sorted(missing))} are missing",
                key="cases",
                allowed=", ".join(MEANINGS),
            )

    def case(self, name: CaseName) -> FeedforwardCase:
        """Return one of the cases."""
        return next(each for each in self.cases if each.case == name)

    @property
    def left(self) -> float:
        """Tracking error due to the errors of the identified model, over that without feed-forward.

        Noise is the same in all cases and not part of this number.
        """
        return self.case("identified").rms_from_true / self.case("none").rms_struts
