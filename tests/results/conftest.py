import csv
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from constraints import limit_definitions
from expdesign.configuration import load_run
from expdesign.experiment import DesignResult, PredictedPrecision
from expdesign.experiment.result import (
    Eigenvalue,
    ParameterPrecision,
    PredictedStd,
    SearchStatistics,
)
from expdesign.motion.executable import SampledMotion
from expdesign.recheck.limit_check import LimitCheck
from expdesign.robot import robot_from
from expdesign.solver.phases import Iteration
from expdesign.trajectory import FourierTrajectory, fourier_keys

TILT = np.deg2rad(20)
STEPS = 200


@dataclass
class FakeRun:
    """A run folder with a small motion and made-up tables; tests change what they are about."""

    folder: Path
    config: dict = field(
        default_factory=lambda: {
            "name": "fake",
            "robot": "palida",
            "limits": {"actuator_force": 150},
        }
    )

    def __post_init__(self):
        self.trajectory = FourierTrajectory.from_displacements(
            2 * np.pi * 0.5,
            [0.01, 0, -0.654, 0, 0, 0.05],
            np.array([[0.08, 0.02], [0, 0.03], [0.05, 0], [0.1, 0], [0, 0.05], [0.3, 0]]),
            np.array([[0, 0.01], [0.09, 0], [0, 0.02], [0, 0.03], [0.12, 0], [0, 0.1]]),
        )

    def write(self):
        self.record().write(self.folder)
        return self.folder

    def record(self):
        configuration = load_run(self.config)
        robot = robot_from(configuration.robot)
        rng = np.random.default_rng(0)
        iterations = tuple(
            Iteration(
                start, kind, "blunt" if k < 10 else "sharp", k, 100 - 50 * 0.8**k - start, float(v)
            )
            for start, kind in enumerate(("random", "random", "hop"))
            for k, v in zip(range(1, 20 + start), 10.0 ** rng.uniform(-9, -1, 30), strict=False)
        )
        nominal = robot.parameters
        stds = 10.0 ** rng.uniform(-3, 1, nominal.size) * np.abs(nominal)
        parameters = tuple(
            ParameterPrecision(name, "1", p, s, s / 3, 100 * s / abs(p), 100 * s / abs(p) / 3)
            for name, p, s in zip(
                robot.parameter_names, nominal.tolist(), stds.tolist(), strict=True
            )
        )
        times = self.trajectory.period * np.arange(STEPS) / STEPS
        return DesignResult(
            configuration=configuration,
            **self._keys(robot),
            motion=SampledMotion.of(robot, self.trajectory, times),
            checks=CHECKS,
            parameters=parameters,
            iterations=iterations,
            eigenvalues=tuple(
                Eigenvalue(k + 1, 10 ** (k / 8 - 2), 10 ** (k / 3)) for k in range(nominal.size)
            ),
            information=np.eye(nominal.size),
        )

    def table(self, name):
        with (self.folder / name).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {key: [row[key] for row in rows] for key in rows[0]}

    def numbers(self, name, *columns):
        table = self.table(name)
        return np.array([[float(cell or "nan") for cell in table[c]] for c in columns]).T

    def _keys(self, robot):
        std = dict.fromkeys(robot.parameter_names, 0.1)
        return dict(
            **fourier_keys(self.trajectory),
            units="SI and radians",
            name="fake",
            robot_name="palida",
            criterion="d",
            scaling="si",
            parameter_names=robot.parameter_names,
            controller_period=None,
            samples_per_period=STEPS,
            samples=50,
            log_det_information=97.25,
            criterion_value=97.25,
            predicted_std=PredictedStd(
                PredictedPrecision(50, 1, std), PredictedPrecision(10 * STEPS, 10, std)
            ),
            status="converged",
            status_text="",
            solver=SearchStatistics(
                "", 60, {}, 1.0, 1, finish={}, starts=(), ended="", cpu_seconds=1.0
            ),
            base_parameters=(),
            warnings=("made up",),
        )


def limit_check(key, row, unit, value, bound, violation, time):
    definition = limit_definitions().get(key)
    title = key if definition is None else definition.title
    return LimitCheck(key, title, row, unit, value, bound, violation, time, "")


CHECKS = (
    limit_check("actuator_force", "strut 3", "N", -230.0, -230.0, 0.0, 0.5),
    limit_check("tilt", "", "rad", 0.2, TILT, 0.2 / TILT - 1, 0.25),
    limit_check("strut_clearance", "struts 1-6", "m", 0.02, 0.015, -1 / 3, 1.0),
    limit_check("position", "z", "m", -0.55, -0.504, -0.046 / 0.3, 1.5),
)


@pytest.fixture(scope="session")
def original(tmp_path_factory):
    run = FakeRun(tmp_path_factory.mktemp("results") / "fake")
    run.write()
    return run


@pytest.fixture
def run(original, tmp_path):
    """Give each test its own copy of the fake run folder."""
    shutil.copytree(original.folder, tmp_path / "run")
    return FakeRun(tmp_path / "run")
