"""The next motion: designed for what the measured recordings left open.

Its precision together with these recordings is compared with that of the last motion measured
again for the same time.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration, load_run
from expdesign.configuration.consistency import identification_of
from expdesign.configuration.robot import RobotSource
from expdesign.experiment.plan import Prediction
from expdesign.robot import robot_from
from expdesign.runfolder import OpenNumber, StageResult, Table, described
from expdesign.runfolder.files import RUN_FILE
from expdesign.runfolder.manifest import Manifest
from expdesign.trajectory import FourierTrajectory


@dataclass(frozen=True)
class QuantityGain:
    """Predicted precision of a derived quantity or a parameter by further measuring."""

    quantity: Annotated[str, described("", "derived quantity or parameter")]
    parameter: Annotated[bool, described("", "it is a parameter")]
    unit: Annotated[str, described("", "SI unit of value and standard deviations")]
    value: Annotated[OpenNumber, described("see unit", "nominal value")]
    std_measured: Annotated[
        OpenNumber, described("see unit", "standard deviation by the recordings so far")
    ]
    std_repeated: Annotated[
        OpenNumber, described("see unit", "with the last motion repeated for the same time")
    ]
    std_next: Annotated[OpenNumber, described("see unit", "with the next motion")]

    @property
    def share_repeated(self) -> float:
        """Standard deviation with the repeated motion over that so far."""
        return self.std_repeated / self.std_measured

    @property
    def share_next(self) -> float:
        """Standard deviation with the next motion over that so far."""
        return self.std_next / self.std_measured


@dataclass(frozen=True, eq=False, kw_only=True)
class NextResult(StageResult):
    """Predicted precision with the next motion, and with the last one repeated."""

    FILE: ClassVar[str] = "next.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign next`"

    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]
    periods: Annotated[float, described("1", "periods of the next motion")]
    minutes: Annotated[float, described("min", "measuring time of these periods")]
    repeated_periods: Annotated[
        float, described("1", "periods of the last motion in this time, not rounded")
    ]
    gains: Annotated[tuple[QuantityGain, ...], Table("tables/next.csv", some=True)]

    @property
    def repeated_percent(
        self,
    ) -> Annotated[
        float,
        described(
            "%",
            "standard deviations with the last motion repeated over those so far, geometric mean "
            "of the parameters",
        ),
    ]:
        """Geometric mean of the parameters' shares with the repeated motion, in percent."""
        return 100 * _mean([one.share_repeated for one in self.gains if one.parameter])

    @property
    def next_percent(
        self,
    ) -> Annotated[float, described("%", "the same with the next motion")]:
        """Geometric mean of the parameters' shares with the next motion, in percent."""
        return 100 * _mean([one.share_next for one in self.gains if one.parameter])


def _mean(ratios: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(ratios))))


def next_run(folders: Sequence[Path], design: Path | None = None) -> RunConfiguration:
    """Return the run of the last folder, for the motion after the estimates of all folders.

    Its recordings are new, `trajectory` is that of the executed design's run, and everything else
    that of the folder's `run.yaml`. The priors of the folders' own designs count as well, unless an
    estimate contains their recordings. By default the executed `design`, a folder or file, is that
    of the last folder's estimate. A run that is a sweep or judges a change is refused.
    """
    folder = folders[-1]
    if not (folder / RUN_FILE).is_file():
        message = "not a run folder: run.yaml is missing"
        raise InputError(message, folder, key="DIR", allowed="a folder with design and estimate")
    runs = {each: load_run(each / RUN_FILE) for each in folders if (each / RUN_FILE).is_file()}
    configuration, run = runs[folder], runs[folder].run
    refused = ""
    if run.sweep is not None:
        refused = "a sweep has several designs"
    elif run.design.is_change:
        refused = "its design is for the change since a prior"
    elif run.trajectory.count > 1:
        refused = "it has several motions"
    if refused:
        allowed = "the run folder of one design for a machine that has not changed"
        raise InputError(f"{refused}: there is no next motion", folder, key="DIR", allowed=allowed)
    section, known = run.design, run.design.known
    if section.named_parameters is not None:
        names = robot_from(configuration.robot).parameter_names
        known = tuple(name for name in names if name not in section.named_parameters)
    parameters = None if section.named_parameters is not None else section.parameters
    changes = {"parameters": parameters, "known": known, "others": ()}
    executed = design or (executed_designs(folder) or [folder])[-1]
    file = (executed if executed.is_dir() else executed.parent) / RUN_FILE
    trajectory, warnings = run.trajectory, tuple[str, ...]()
    if file.is_file():
        trajectory = load_run(file).run.trajectory
    else:
        warnings = (
            f"{executed.parent if executed.is_file() else executed}: no {RUN_FILE} of the executed "
            f"design; `trajectory` of the next one is that of {folder / RUN_FILE}",
        )

    def following(*priors: RobotSource) -> RunConfiguration:
        update = {
            "name": _following_name(run.name),
            "trajectory": trajectory.model_copy(update={"count": 1}),
            "design": section.model_copy(update={"prior": priors, **changes}),
            "data": run.data.model_copy(update={"file": None}),
        }
        return load_run(run.model_copy(update=update))

    found = following(*(str(each.absolute()) for each in folders))
    priors = list(found.run.design.priors)
    counted = {name for one in priors for name in identification_of(one).recordings}
    for each, own in runs.items():
        # An estimate from recordings of several designs contains the earlier ones.
        several = len(executed_designs(each)) > 1
        for one in () if own.run.design.is_change or several else own.run.design.priors:
            recordings = identification_of(one).recordings
            if one not in priors and not (recordings and counted.issuperset(recordings)):
                priors.append(one)
    if len(priors) > len(folders):
        found = following(*priors)
    return replace(found, warnings=(*found.warnings, *warnings))


def executed_designs(folder: Path) -> list[Path]:
    """Return the files of the designs whose recordings a folder's estimate was made from."""
    manifest = Manifest.known(folder)
    made = None if manifest is None else manifest.stages.get("estimate")
    files = [] if made is None else [folder / name for name in made.made_from]
    return [file for file in files if file.suffix == ".json" and file.is_file()]


def _following_name(name: str) -> str:
    """Return the name of the next run.

    Examples
    --------
    >>> _following_name("lab"), _following_name("lab-next"), _following_name("lab-next-2")
    ('lab-next', 'lab-next-2', 'lab-next-3')
    """
    found = re.fullmatch(r"(.*)-next(?:-(\d+))?", name)
    return f"{found[1]}-next-{int(found[2] or 1) + 1}" if found else f"{name}-next"


def compare_with_repetition(
    configuration: RunConfiguration, following: FourierTrajectory, last: FourierTrajectory
) -> NextResult:
    """Return the predicted precision of a next motion, and of the last one for the same time."""
    periods = configuration.run.experiment.periods
    repeated_periods = periods * following.period / last.period
    new, old = (Prediction.of(configuration, one) for one in (following, last))
    count = len(new.evaluator.names)

    def stds(prediction: Prediction, number: float) -> dict[str, float]:
        found: Array = prediction.errors(number).std
        return dict(zip(prediction.names, found.tolist(), strict=True))

    measured, repeated, better = stds(new, 0.0), stds(old, repeated_periods), stds(new, periods)
    return NextResult(
        name=configuration.run.name,
        robot=configuration.robot.name,
        periods=periods,
        minutes=periods * following.period / 60,
        repeated_periods=repeated_periods,
        gains=tuple(
            QuantityGain(
                quantity=name,
                parameter=place >= len(new.names) - count,
                unit=unit,
                value=float(value),
                std_measured=measured[name],
                std_repeated=repeated[name],
                std_next=better[name],
            )
            for place, (name, unit, value) in enumerate(
                zip(new.names, new.units, new.values, strict=True)
            )
        ),
    )
