"""How far the rows of a table may be apart."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import export_section
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import ExportError, export_table
from expdesign.robot import ForwardKinematicsError
from tests.export.motions import task
from tests.export.written import written


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
