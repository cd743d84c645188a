"""A reader in a process of its own: crashes, endless loops and printing stay there."""

import numpy as np
import pytest

from estimation.data import formats
from expdesign.configuration import DataSection, InputError
from tests.data.unruly_reader import FORMAT


@pytest.fixture
def load(tmp_path):
    def loading(what):
        path = tmp_path / "file"
        path.write_text(what)
        return FORMAT.load(path, DataSection())

    return loading


def test_a_table_comes_back_whatever_the_library_prints(load, capfd):
    table = load("chat")
    assert np.array_equal(table.values["t"], [0, 1, 2])
    assert table.columns["t"].text == "t"
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("what", "message"), [("crash", "its library crashed (SIGSEGV)"), ("hoard", "allocate")]
)
def test_a_library_that_fails_is_bad_input(what, message, load, capfd):
    with pytest.raises(InputError) as caught:
        load(what)
    assert message in str(caught.value)
    assert "the file is damaged or not of the format unruly" in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_reading_that_does_not_end_is_bad_input(load, monkeypatch):
    monkeypatch.setattr(formats, "_SECONDS", 2.0)
    with pytest.raises(InputError, match="reading does not end"):
        load("hang")


def test_a_process_that_fails_is_no_bad_input(load):
    with pytest.raises(RuntimeError, match=r"reading .*file failed"):
        load("exit")
