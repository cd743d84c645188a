"""The record of controller tables: one of another version is neither read nor overwritten."""

import pytest

from expdesign.configuration import InputError
from expdesign.export.result import ExportResult


@pytest.mark.parametrize(("number", "word"), [(9, "newer version"), (0, "earlier version")])
def test_a_record_of_another_version_is_not_overwritten(tmp_path, number, word):
    path = tmp_path / "exports.json"
    path.write_text(f'{{"format": {number}}}', encoding="utf-8")
    with pytest.raises(InputError, match=word):
        ExportResult.known(path)
    path.write_text("{", encoding="utf-8")
    assert ExportResult.known(path) is None
