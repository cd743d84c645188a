"""How far the rows of a table may be apart."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import InputError, export_section
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import ExportError, export_table, resolve_settings
from expdesign.export.row_times import chosen_times, ideal_rows
from expdesign.robot import ForwardKinematicsError, LimitModel
from tests.export.motions import DESIGNED, task
from tests.export.written import small_task, written


def test_rows_are_put_closer_where_no_pose_has_the_lengths_between_them(tmp_path, monkeypatch):
    """Of a fast motion cubic lengths between rows 0.1 s apart were out of the platform's reach."""
    longest = np.max(
        np.diff(written(tmp_path / "as_it_is.trj", format="xps-pvt").executed.rows.times)
    )
    between = ExecutedTable.between

    def no_pose(table, times):
        if np.max(np.diff(table.rows.times)) > 0.6 * longest:
            raise ForwardKinematicsError((0,), 1e-4)
        return between(table, times)

    monkeypatch.setattr(ExecutedTable, "between", no_pose)
    closer = written(tmp_path / "closer.trj", format="xps-pvt").executed.rows.times
    assert np.max(np.diff(closer)) <= 0.6 * longest


def test_rows_on_straight_lines_are_put_closer_until_they_keep_the_tolerance(tmp_path):
    """A run sampled at 250 Hz: straight lines over 4 ms leave a fast motion by more than 10 µm."""
    slow = replace(task(), controller_period=4e-3)
    made = export_table(export_section(format="linuxcnc-strut"), slow, tmp_path / "t.txt")
    assert made.settings.step == 2e-3
    assert made.check.position_error < 10e-6
    assert "rows 2 ms apart" in made.note
    asked = export_section(format="linuxcnc-strut", segment=4e-3)
    with pytest.raises(ExportError, match="more than the tolerance of 10 µm"):
        export_table(asked, slow, tmp_path / "t.txt")


def test_rows_are_so_close_that_the_table_keeps_the_limits_as_the_design_does():
    """A design at its limits: rows 2.5 ms apart would keep the tolerance."""
    about = task(*DESIGNED)
    limits = LimitModel.of(about.robot)
    first, last = about.motion.window

    def room(sample, times):
        inside = times[(times >= first) & (times <= last)]
        fine = np.linspace(inside[:-1], inside[1:], 10, endpoint=False).ravel()
        return -np.max(limits.violations(np.hstack(sample(fine))))

    def rows(**options):
        settings = resolve_settings(export_section(format="xps-pvt", **options), about)
        return ExecutedTable.of(settings, ideal_rows(settings, chosen_times(settings)))

    def table_room(table):
        return room(lambda at: table.between(at).states, table.rows.times)

    close, far = rows(), rows(segment=2.5e-3)
    wanted = min(1e-5, room(about.motion.sample, close.rows.times) / 2)
    assert 0 < wanted <= table_room(close)
    assert table_room(far) < wanted


def test_a_tolerance_that_no_rows_keep_is_refused():
    settings = resolve_settings(export_section(format="xps-pvt", tolerance=1e-15), small_task(1))
    with pytest.raises(InputError, match="µm from the design in the ramp in") as refused:
        chosen_times(settings)
    assert refused.value.problems[0].key == "tolerance"
