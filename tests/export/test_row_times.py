"""How far the rows of a table may be apart."""

import numpy as np

from expdesign.export.execution import ExecutedTable
from expdesign.robot import ForwardKinematicsError
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
