"""A comparison of feed-forwards as its run folder keeps it: `feedforward.json` and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from constraints.arrays import Array
from expdesign.configuration import Problem
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Contents,
    FolderRecord,
    Numbers,
    OpenNumber,
    RowKeys,
    RowTable,
    RunFile,
    described,
    sized,
    strutwise,
)

_WRITTEN_BY = "`expdesign run` of a file with `feedforward:`"

CaseName = Literal["none", "gravity", "nominal", "identified", "true"]

MEANINGS: dict[CaseName, str] = {
    "none": "the controller alone",
    "gravity": "weight by the nominal model",
    "nominal": "forces of the nominal model",
    "identified": "forces of the identified model",
    "true": "forces of the true model",
}
"""What is fed forward, in the order in which cases are listed."""

_Struts = Annotated[Numbers, sized(ACTUATORS)]


@dataclass(frozen=True, eq=False)
class ControllerKeys:
    """The controller of every strut, the same in all cases."""

    sampling: Annotated[float, described("Hz", "samples per second; forces are held between")]
    bandwidth: Annotated[float, described("Hz", "natural frequency of a strut by itself")]
    damping_ratio: Annotated[float, described("1", "of the same")]
    integral_corner: Annotated[float, described("Hz", "of the integral action; 0: none")]
    filter: Annotated[float, described("Hz", "corner of the filter of the error's rate")]
    mass: Annotated[_Struts, described("kg", "that a strut feels at home, the others held")]
    stiffness: Annotated[_Struts, described("N/m", "k")]
    damping: Annotated[_Struts, described("N s/m", "d")]
    integral: Annotated[_Struts, described("N/(m s)", "k_i")]


@dataclass(frozen=True)
class IntegrationKeys:
    """How the machine's motion was computed."""

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
class CaseKeys:
    """How well the motion is followed with one feed-forward."""

    case: Annotated[CaseName, described("", "what is fed forward")]
    rms_struts: Annotated[float, described("m", "rms error of all struts")]
    max_struts: Annotated[float, described("m", "largest error of a strut")]
    rms_position: Annotated[float, described("m", "rms distance of the TCP from its place")]
    max_position: Annotated[float, described("m", "largest distance")]
    rms_rotation: Annotated[float, described("rad", "rms angle by which the platform is turned")]
    max_rotation: Annotated[float, described("rad", "largest angle")]
    rms_from_true: Annotated[
        float,
        described("m", "rms distance of the struts from where the true model's forces bring them"),
    ]
    rms_feedback: Annotated[float, described("N", "rms of what the controller itself adds")]
    limited: Annotated[float, described("1", "share of the forces that are at their limit")]
    reduction: Annotated[
        OpenNumber, described("1", "rms_struts without feed-forward over this one")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedforwardFile(RunFile):
    """`feedforward.json`."""

    FILE: ClassVar[str] = "feedforward.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    estimate: Annotated[str, described("", "the `estimate.json` that is fed forward")]
    estimator: Annotated[str, described("", "ls, gm or ml")]
    machine: Annotated[
        Literal["twin", "drawn"],
        described("", "what moves: the twin, or a machine drawn from the estimate's covariance"),
    ]
    motion: Annotated[str, described("", "which motion is followed")]
    period: Annotated[float, described("s", "its duration")]
    periods: Annotated[float, described("1", "number that was simulated; the last is judged")]
    controller: Annotated[ControllerKeys, described("", "gains, and what they come from")]
    integration: Annotated[IntegrationKeys, described("", "steps of the simulation")]
    cases: Annotated[tuple[CaseKeys, ...], described("", "feed-forward by feed-forward")]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]
    within_limits: Annotated[
        bool, described("", "the motion keeps every limit of the robot, which could make it")
    ] = True

    def contradictions(self) -> Iterator[Problem]:
        """Yield cases without which nothing can be compared."""
        missing = {"none", "identified", "true"} - {each.case for each in self.cases}
        if missing:
            yield Problem(
                f"the cases {', '.join(sorted(missing))} are missing",
                key="cases",
                allowed=", ".join(MEANINGS),
            )

    def case(self, name: CaseName) -> CaseKeys:
        """Return one of the cases."""
        return next(each for each in self.cases if each.case == name)

    @property
    def left(self) -> float:
        """What the identified model's errors cost, over the error without feed-forward.

        Noise is the same in all cases and not in this number.
        """
        return self.case("identified").rms_from_true / self.case("none").rms_struts


@dataclass(frozen=True)
class StrutRow:
    """How well one strut follows with one feed-forward."""

    case: Annotated[str, described("", "what is fed forward")]
    strut: Annotated[int, described("1", "strut")]
    rms: Annotated[float, described("m", "rms of the error")]
    max: Annotated[float, described("m", "largest error")]
    rms_feedback: Annotated[float, described("N", "rms of what the controller itself adds")]


@dataclass(frozen=True, eq=False)
class Tracking:
    """Errors over the period that is judged, wanted minus reached."""

    time: Annotated[Array, Column("t", "s", "time from the start of the period")]
    struts: Annotated[Array, strutwise("e", "m", "error")]
    position: Annotated[Array, Column("position", "m", "distance of the TCP from its place")]
    rotation: Annotated[
        Array, Column("rotation", "rad", "angle by which the platform is turned from its own")
    ]
    forces: Annotated[Array, strutwise("Q", "N", "commanded force")]


TRACKING = ArrayTable("tables/tracking.csv", _WRITTEN_BY, Tracking)


@dataclass(frozen=True, eq=False)
class FeedforwardRecord(FolderRecord):
    """A comparison, from memory or from its run folder: what figures and reports are made from."""

    TABLES: ClassVar = {
        "rows": RowTable(
            "tables/feedforward.csv", _WRITTEN_BY, StrutRow, rows_of=("case", "strut")
        ),
    }
    summary: FeedforwardFile
    rows: tuple[StrutRow, ...]
    tracking: tuple[Tracking, ...]
    """Case by case."""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        found = cls.fields_in(folder)
        numbers = range(1, len(found["summary"].cases) + 1)
        return cls(**found, tracking=tuple(TRACKING.numbered(n).read(folder) for n in numbers))

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return the cases, and of each the struts."""
        cases = [each.case for each in found["summary"].cases]
        return {"rows": [(case, strut) for case in cases for strut in range(1, ACTUATORS + 1)]}

    def contents(self) -> Contents:
        """Yield the tables, those of each case after the others."""
        yield from super().contents()
        for number, tracking in enumerate(self.tracking, start=1):
            yield TRACKING.numbered(number), tracking
