import json

import pytest

from expdesign.runfolder.columns import MEASUREMENT, NAME, TRAJECTORY, add_columns


def names(folder):
    data = json.loads((folder / NAME).read_text(encoding="utf-8"))
    return {table: [column["name"] for column in columns] for table, columns in data.items()}


def test_tables_are_added(tmp_path):
    assert add_columns(tmp_path, {"trajectory.csv": TRAJECTORY}) == tmp_path / NAME
    add_columns(tmp_path, {"measurement.csv": MEASUREMENT})
    found = names(tmp_path)
    assert list(found) == ["trajectory.csv", "measurement.csv"]
    assert found["trajectory.csv"] == [column.name for column in TRAJECTORY]
    struts = [f"{name}{j}" for name in "qQ" for j in range(1, 7)]
    assert found["measurement.csv"] == ["t", *struts, "period"]


def test_a_table_is_described_anew(tmp_path):
    add_columns(tmp_path, {"trajectory.csv": MEASUREMENT})
    add_columns(tmp_path, {"trajectory.csv": TRAJECTORY})
    assert names(tmp_path) == {"trajectory.csv": [column.name for column in TRAJECTORY]}


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "\ud7ff"])
def test_a_file_that_cannot_be_used_is_replaced(tmp_path, text):
    (tmp_path / NAME).write_text(text, encoding="utf-8")
    add_columns(tmp_path, {"measurement.csv": MEASUREMENT})
    assert list(names(tmp_path)) == ["measurement.csv"]
