"""Galil's contour mode: whole counts that add up, and files that mean something else."""

import re

import numpy as np
import pytest

from expdesign.configuration import InputError, export_section
from expdesign.export.definition import TableError
from expdesign.export.exporting import ExportError, export_table, resolve_settings
from expdesign.export.formats import table_formats
from tests.export.motions import task
from tests.export.wrong_tables import work_of

READ = table_formats()["galil-contour"].read
COUNTS = 2e5


def _section(**more):
    options = {"counts_per_metre": COUNTS, "segment": "20 ms", "tolerance": "3 mm"} | more
    return export_section(format="galil-contour", **options)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("galil") / "galil.dmc"
    section, work = _section(), work_of("palida")
    export_table(section, work, path)
    return path, resolve_settings(section, work)


def test_increments_are_whole_counts_that_add_up(table):
    path, settings = table
    text = path.read_text()
    assert "\nTM 1250\nCM ABCDEF\nDT 4\n" in text
    assert text.endswith("CD 0,0,0,0,0,0=0\nEN\n")
    assert "." not in text.partition("TM")[2]
    rows, motion = READ(path, settings), settings.task.motion
    rows = rows.expanded()
    struts = settings.task.robot.inverse_kinematics(motion.sample(rows.times).pose)
    np.testing.assert_allclose(rows.position, COUNTS * struts, atol=0.5 + 1e-6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("TM 1250", "TM 125"),
        ("DT 4", "DT 3"),
        ("CM ABCDEF", "CM ABCD"),
        ("CD ", "CR "),
        ("CD 0,0,0,0,0,0=0\n", ""),
        ("EN\n", "EN\nCD 1,0,0,0,0,0\n"),
        ("\nCD ", "\nCD 0.5,0,0,0,0,0\nCD "),
        ("\nCD ", "\nCD 1,2,3\nCD "),
    ],
)
def test_a_file_that_means_something_else_is_refused(old, new, table, tmp_path):
    path, settings = table
    text = path.read_text()
    assert old in text
    (tmp_path / "changed.dmc").write_text(text.replace(old, new, 1))
    with pytest.raises(TableError):
        READ(tmp_path / "changed.dmc", settings)


def test_a_step_that_the_controller_has_not_is_refused(tmp_path):
    with pytest.raises((InputError, TableError), match="servo updates"):
        export_table(_section(segment="7.3 ms"), work_of("palida"), tmp_path / "galil.dmc")


@pytest.mark.parametrize(
    ("options", "words", "better"),
    [
        (
            {"counts_per_metre": 1e6},
            r"finer counts \((\d+) times as many\), or a longer segment with a larger tolerance "
            r"\(.*\) may help",
            lambda times: {"counts_per_metre": 1e6 * int(times)},
        ),
        (
            {"counts_per_metre": 1e9, "segment": "4 ms", "tolerance": "1 um"},
            r"a shorter segment, or a tolerance of (\d+) µm or more may help",
            lambda size: {"tolerance": f"{size} um"},
        ),
        (
            {"counts_per_metre": 1e9, "segment": "20 ms"},
            r"rows 20 ms apart: (a shorter segment) may help",
            lambda _: {"segment": "4 ms"},
        ),
        (
            {"counts_per_metre": 1e4, "segment": "20 ms"},
            r"(finer counts) may help: their rounding is beyond the tolerance",
            None,
        ),
    ],
)
def test_what_a_refused_table_advises_helps(options, words, better, tmp_path):
    """Rounding at short steps, and straight lines at long ones, whose advice is another."""

    def export(**more):
        section = export_section(format="galil-contour", **(options | more))
        export_table(section, task("linuxcnc"), tmp_path / "fine.dmc")

    with pytest.raises(ExportError) as caught:
        export()
    assert not (tmp_path / "fine.dmc").exists()
    (found,) = re.findall(words, caught.value.message)
    if better is not None:
        export(**better(found))
        assert (tmp_path / "fine.dmc").exists()
