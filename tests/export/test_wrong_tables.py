"""No table that breaks a limit, jumps or is not whole is called proved; `make soak` has more."""

import pytest

from tests.export.wrong_tables import Exported, missed_tables, refused_tables


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return Exported(tmp_path_factory.mktemp("tables"))


@pytest.fixture(autouse=True)
def no_process_of_its_own(monkeypatch):
    """Read MAT-files in this process: none of them is damaged."""
    monkeypatch.setattr("expdesign.export.table_file._refuse_crashing", lambda *_: None)


@pytest.mark.parametrize("count", [16, pytest.param(40, marks=pytest.mark.slow)])
def test_no_wrong_table_is_called_proved(count, exported):
    missed, wrong, proved = missed_tables(exported, count)
    assert not missed, f"{len(missed)} of {wrong} wrong tables; {proved} of {count} are proved"
    assert wrong > count / 2


def test_harmless_changes_are_accepted(exported):
    assert refused_tables(exported, 18) == []
