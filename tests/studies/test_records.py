"""Folders of studies that the version before wrote, when files had no format number."""

import json
from pathlib import Path

import pytest

from estimation.studies.records import TABLES, StudyRecord, StudySummary
from expdesign.configuration import InputError

OLD = Path(__file__).parent / "format_0"


@pytest.mark.parametrize("kind", list(TABLES))
def test_an_old_folder_is_read_and_comes_back_with_every_digit(tmp_path, kind):
    record = StudyRecord.read(OLD / kind)
    assert record.summary.kind == kind
    assert all(record.tables.values())
    written = record.write(tmp_path)
    for path in (path for path in written if path.suffix == ".csv"):
        assert path.read_bytes() == (OLD / kind / path.relative_to(tmp_path)).read_bytes()
    old, new = (
        json.loads((folder / "study.json").read_text()) for folder in (OLD / kind, tmp_path)
    )
    assert new == {"format": 1, **old}
    described, before = (
        json.loads((folder / "columns.json").read_text()) for folder in (tmp_path, OLD / kind)
    )
    for table in TABLES[kind]:
        for columns in zip(described[table.file], before[table.file], strict=True):
            assert len({(column["name"], column["unit"]) for column in columns}) == 1


def test_a_study_of_another_kind_is_refused(tmp_path):
    text = (OLD / "design" / "study.json").read_text()
    (tmp_path / "study.json").write_text(text.replace('"kind": "design"', '"kind": "dance"', 1))
    with pytest.raises(InputError, match="dance"):
        StudySummary.read(tmp_path)
