"""Controller tables of a million rows, PaLiDA: written, read back and certified.

Each table is made in a separate process: processor time, and memory beyond that at its start.
"""

from __future__ import annotations

import multiprocessing
import resource
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from expdesign.configuration import export_section, load_run
from expdesign.export.definition import Task
from expdesign.export.exporting import export_table, file_name
from expdesign.export.table_file import certify_file, read_table_file
from expdesign.motion.planning import executable_motion
from expdesign.robot import robot_from
from expdesign.trajectory import TrajectoryFile

TITLE = "Long controller tables"

Row = dict[str, Any]

TABLES: tuple[tuple[int, dict[str, str]], ...] = (
    (600, {"format": "csv"}),
    (600, {"format": "linuxcnc-strut"}),
    (600, {"format": "pi-wave"}),
    (6000, {"format": "linuxcnc-gcode"}),
    (6000, {"format": "linuxcnc-gcode", "repeat": "controller"}),
    (1500, {"format": "xps-pvt"}),
    (1500, {"format": "pmac-pvt"}),
    (1500, {"format": "pvt-csv"}),
    (1500, {"format": "ros2"}),
    # Both libraries take and give whole tables.
    (600, {"format": "mat"}),
    (1500, {"format": "ros2", "encoding": "mcap"}),
)
"""Numbers of periods, and options."""


def rows() -> Iterator[Row]:
    """Yield a row for each table."""
    task = _task()
    context = multiprocessing.get_context("fork")
    for periods, options in TABLES:
        with context.Pool(1) as pool:
            yield pool.apply(_measure, (task, periods, options))


def summary(table: pd.DataFrame) -> str:
    """Return the largest time and memory."""
    return f"at most {table['s'].max()} s and {table['MB'].max()} MB"


def _task() -> Task:
    design = TrajectoryFile.read(Path(__file__).parent / "designs" / "palida.json").trajectory
    run = load_run({"name": "long", "robot": "palida", "experiment": {"sampling": "1 kHz"}})
    robot, noise = robot_from(run.robot), run.robot.noise
    return Task(
        name="long",
        robot=robot,
        motion=executable_motion(run, design),
        controller_period=run.run.controller_period,
        sampling=run.run.experiment.sampling,
        parameters=robot.parameter_names,
        force_covariance=None if noise is None else noise.force_covariance,
    )


def _measure(task: Task, periods: int, options: dict[str, str]) -> Row:
    section = export_section(**options)
    motion = task.motion.with_periods(periods)
    long = Task(**{**vars(task), "motion": motion})
    before, begin = _largest_memory(), time.process_time()
    with TemporaryDirectory() as folder, threadpool_limits(1):
        made = export_table(section, long, Path(folder) / file_name(section))
        certify_file(read_table_file(made.path, made.settings))
        size = made.path.stat().st_size
    return {
        "table": " ".join(
            options[key] for key in ("format", "encoding", "repeat") if key in options
        ),
        "rows": made.check.rows,
        "file, MB": round(size / 1e6, 2),
        "s": round(time.process_time() - begin, 1),
        "MB": round(_largest_memory() - before),
    }


def _largest_memory() -> float:
    """Return the largest resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
