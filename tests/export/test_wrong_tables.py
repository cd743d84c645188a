"""No table that breaks a limit, jumps or is not whole is called proved; `make soak` has more."""

import shutil

import pytest

from expdesign.configuration import InputError
from expdesign.export.table_file import find_table_file
from tests.export.wrong_tables import Exported, missed_tables, refused_tables, work_of


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return Exported(tmp_path_factory.mktemp("tables"))


@pytest.fixture(autouse=True)
def no_process_of_its_own(monkeypatch):
    """Read MAT-files in this process: none of them is damaged."""
    monkeypatch.setattr("expdesign.export.table_file._refuse_crashing", lambda *_: None)


@pytest.mark.parametrize("count", [10, pytest.param(30, marks=pytest.mark.slow)])
def test_no_wrong_table_is_called_proved(count, exported):
    missed, wrong, proved = missed_tables(exported, count)
    assert not missed, f"{len(missed)} of {wrong} wrong tables; {proved} of {count} are proved"
    assert wrong > count / 2


@pytest.mark.parametrize("time", ["1e999", "1e300", "1e140", "1e12"])
@pytest.mark.parametrize("form", ["xps-pvt", "pvt-csv"])
def test_absurd_times_are_refused(form, time, exported, tmp_path):
    work, original = work_of("palida"), exported("palida", form)
    path = tmp_path / original.name
    shutil.copy(original.with_name("exports.json"), tmp_path)
    lines = original.read_text().splitlines()
    lines[9] = f"{time}{lines[9][lines[9].index(',') :]}"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"is beyond|add up to more"):
        find_table_file(path, work.robot, work.motion.trajectory)


def test_harmless_changes_are_accepted(exported):
    assert refused_tables(exported, 18) == []
