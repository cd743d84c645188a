import csv
import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory

POSE = ["x", "y", "z", "phi", "theta", "psi"]
STRUTWISE = ["q", "dq", "ddq", "alpha", "beta", "Q"]
SPREADS = ["std", "rel_std_percent"]
STEPS = 200


def write_table(path, header, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


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
        configuration = load_run(self.config)
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "run.yaml").write_text(resolved_yaml(configuration), encoding="utf-8")
        robot = robot_from(configuration.robot)
        self._write_trajectory(robot)
        self._write_tables(robot)
        self._write_summary(robot)
        return self.folder

    def table(self, name):
        with (self.folder / name).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {key: [row[key] for row in rows] for key in rows[0]}

    def numbers(self, name, *columns):
        table = self.table(name)
        return np.array([[float(cell or "nan") for cell in table[c]] for c in columns]).T

    def _write_trajectory(self, robot):
        times = self.trajectory.period * np.arange(STEPS) / STEPS
        motion = self.trajectory.sample(times)
        states = (motion.pose, motion.rate, motion.acceleration)
        struts = robot.strut_motion(*states)
        strutwise = (struts.length, struts.length_rate, struts.length_acceleration)
        header = ["t", *(d + name for d in ("", "d", "dd") for name in POSE)]
        header += [f"{name}{j}" for name in STRUTWISE for j in range(1, 7)]
        table = np.column_stack(
            [times, *states, *strutwise, struts.alpha, struts.beta, robot.actuator_forces(*states)]
        )
        write_table(self.folder / "trajectory.csv", header, table.tolist())

    def _write_tables(self, robot):
        tables = self.folder / "tables"
        rng = np.random.default_rng(0)
        convergence = [
            [start, kind, "blunt" if k < 10 else "sharp", k, 100 - 50 * 0.8**k - start, v, 0.1 * k]
            for start, kind in enumerate(("random", "random", "hop"))
            for k, v in zip(range(1, 20 + start), 10.0 ** rng.uniform(-9, -1, 30), strict=False)
        ]
        write_table(
            tables / "convergence.csv",
            ["start", "kind", "stage", "iteration", "objective", "violation", "seconds"],
            convergence,
        )
        write_table(
            tables / "limits.csv",
            ["limit", "row", "unit", "value", "bound", "violation", "time", "strut"],
            [
                ["actuator_force", "strut 3", "N", -230.0, -230.0, 0.0, 0.5, 3],
                ["tilt", "", "rad", 0.2, np.deg2rad(20), 0.2 / np.deg2rad(20) - 1, 0.25, ""],
                ["strut_clearance", "struts 1-6", "m", 0.02, 0.015, -1 / 3, 1.0, ""],
                ["position", "z", "m", -0.55, -0.504, -0.046 / 0.3, 1.5, ""],
            ],
        )
        nominal = robot.parameters
        period = 10.0 ** rng.uniform(-3, 1, nominal.size) * np.abs(nominal)
        write_table(
            tables / "parameters.csv",
            [
                "parameter",
                "unit",
                "nominal",
                *(f"{kind}_{over}" for kind in SPREADS for over in ("per_period", "experiment")),
            ],
            [
                [name, "1", p, s, s / 3, 100 * s / abs(p), 100 * s / abs(p) / 3]
                for name, p, s in zip(robot.parameter_names, nominal, period, strict=True)
            ],
        )
        write_table(
            tables / "eigenvalues.csv",
            ["index", "eigenvalue", "eigenvalue_nominal"],
            [[k + 1, 10 ** (k / 8 - 2), 10 ** (k / 3)] for k in range(nominal.size)],
        )

    def _write_summary(self, robot):
        values = dict.fromkeys(robot.parameter_names, 0.1)
        experiment = {"samples": 10 * STEPS, "periods": 10, "values": values}
        document = {
            "criterion": "d",
            "harmonics": self.trajectory.harmonics,
            "omega": self.trajectory.omega,
            "lambda0": self.trajectory.lambda0.tolist(),
            "mu": self.trajectory.mu.tolist(),
            "nu": self.trajectory.nu.tolist(),
            "samples": 50,
            "samples_per_period": STEPS,
            "log_det_information": 97.25,
            "criterion_value": 97.25,
            "scaling": "si",
            "predicted_std": {
                "per_period": {"samples": 50, "values": values},
                "experiment": experiment,
            },
            "status": "done",
            "solver": {"iterations": 60, "evaluations": {}, "seconds": 1.0, "best_start": 1},
            "limits": [],
            "certified": {"method": "sampled"},
            "warnings": ["made up"],
            "a key of a later version": 1,
        }
        (self.folder / "design.json").write_text(json.dumps(document), encoding="utf-8")


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
