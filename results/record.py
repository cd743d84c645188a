"""A design run as its folder tells it: everything that figures and reports are made from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import RunConfiguration, load_run
from expdesign.robot import Robot, robot_from
from results.errors import MissingFileError
from results.reading.limit_checks import LimitCheck, read_limit_checks
from results.reading.motion import Motion
from results.reading.precision import Precision
from results.reading.spectrum import Spectrum
from results.reading.summary import DesignSummary
from results.reading.traces import Trace, read_traces


@dataclass(frozen=True, eq=False)
class DesignRecord:
    """What a design run left in its folder.

    Attributes
    ----------
    folder : Path
    configuration : RunConfiguration
    robot : Robot
        With the limits and the noise of the run.
    summary : DesignSummary
    motion : Motion
        One period at the controller's rate.
    traces : tuple of Trace
        The iterations of every start.
    checks : tuple of LimitCheck
    precision : Precision
    spectrum : Spectrum
    """

    folder: Path
    configuration: RunConfiguration
    robot: Robot
    summary: DesignSummary
    motion: Motion
    traces: tuple[Trace, ...]
    checks: tuple[LimitCheck, ...]
    precision: Precision
    spectrum: Spectrum

    @classmethod
    def load(cls, folder: Path) -> DesignRecord:
        """Read a run folder; nothing else is read and nothing is computed.

        Raises
        ------
        RunFolderError
            A file is missing (`MissingFileError`) or does not hold what it should.
        InputError
            `run.yaml` is not a valid run.
        """
        if not (folder / "run.yaml").is_file():
            raise MissingFileError(folder / "run.yaml")
        configuration = load_run(folder / "run.yaml")
        tables = folder / "tables"
        return cls(
            folder=folder,
            configuration=configuration,
            robot=robot_from(configuration.robot),
            summary=DesignSummary.read(folder / "design.json"),
            motion=Motion.read(folder / "trajectory.csv"),
            traces=read_traces(tables / "convergence.csv"),
            checks=read_limit_checks(tables / "limits.csv"),
            precision=Precision.read(tables / "parameters.csv"),
            spectrum=Spectrum.read(tables / "eigenvalues.csv"),
        )

    def limit(self, key: str) -> Limit | None:
        """Return a limit of the run by its key, None when it does not limit."""
        return next((limit for limit in self.robot.limits if limit.key == key), None)

    def home_joints(self) -> Array:
        """Return the platform joints B at home, base frame, m, (6, 3)."""
        robot = self.configuration.robot
        return robot.struts_at(robot.home).joints
