"""The record of controller tables: that of the version before is read, a newer one is refused."""

import json
from pathlib import Path

import pytest

from expdesign.configuration import InputError
from expdesign.export.readme import readme
from expdesign.export.record import ExportsRecord

OLD = Path(__file__).parents[1] / "report" / "format_0" / "exports" / "exports.json"


def test_an_old_record_is_read_and_keeps_what_it_says(tmp_path):
    record = ExportsRecord.read(OLD)
    written = json.loads(record.write_as(tmp_path / "exports.json").read_text(encoding="utf-8"))
    before = json.loads(OLD.read_text(encoding="utf-8"))
    # A later version says how many of the ramps come before the periods.
    assert written["motion"]["ways"].pop("before") == 1
    assert written["motion"].items() >= before["motion"].items()
    assert written["format"] == 1
    for name, entry in before["files"].items():
        new = written["files"][name]
        assert {key: new[key] for key in entry if key != "read_back"} == {
            key: value for key, value in entry.items() if key != "read_back"
        }
        assert name in readme(record)
    assert ExportsRecord.read(tmp_path / "exports.json").motion == record.motion


def test_a_newer_record_is_not_overwritten(tmp_path):
    path = tmp_path / "exports.json"
    path.write_text(json.dumps({**json.loads(OLD.read_text()), "format": 9}), encoding="utf-8")
    with pytest.raises(InputError, match=r"format 9.* up to 1"):
        ExportsRecord.known(path)
    path.write_text("{", encoding="utf-8")
    assert ExportsRecord.known(path) is None
