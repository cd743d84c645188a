"""A controller table of a small experiment, written once for all tests that execute it."""

from functools import cache

from expdesign.configuration import export_section
from expdesign.export.definition import Task
from expdesign.export.exporting import export_table
from expdesign.export.table_file import read_table_file
from tests.estimation.cases import PERIODS, ROBOT, trajectory
from tests.export.motions import motion_of

SAMPLING = 200.0


@cache
def small_task(periods=PERIODS):
    """Return the task of two lively harmonics with analytic ways from and to rest."""
    return Task(
        name="small",
        robot=ROBOT,
        motion=motion_of(ROBOT, trajectory(), periods),
        controller_period=1e-3,
        sampling=SAMPLING,
        parameters=ROBOT.parameter_names,
        force_covariance=ROBOT.description.noise.force_covariance,
    )


def written(path, **options):
    """Write the small motion in a format and read it as its controller does."""
    task = small_task()
    made = export_table(export_section(**options), task, path)
    return read_table_file(made.path, made.settings)
