"""Tables of the manual: keys and columns of every result, those of plug-ins too."""

import textwrap

import pytest

from constraints import plugins
from expdesign.experiment import DesignResult
from expdesign.runfolder.documentation import (
    all_results,
    documented_page,
    file_tables,
    main,
    result_tables,
)

PAGE = """# Run folder

<!-- design.json -->
yesterday
<!-- end -->

Prose.

<!-- further files -->
<!-- end of further files -->
"""

MODULE = '''
    """A stage of somebody else."""

    from dataclasses import dataclass
    from typing import Annotated, ClassVar

    from expdesign.runfolder import StageResult, Table, described


    @dataclass(frozen=True)
    class Sway:
        """Amplitude of a mode."""

        mode: Annotated[int, described("1", "number of the mode")]


    @dataclass(frozen=True, eq=False, kw_only=True)
    class SwayResult(StageResult):
        FILE: ClassVar[str] = "sway.json"
        WRITTEN_BY: ClassVar[str] = "`expdesign sway`"
        amplitude: Annotated[float, described("m", "largest amplitude")]
        modes: Annotated[tuple[Sway, ...], Table("tables/sway.csv")]
'''


def test_tables_replace_the_text_between_markers():
    page = documented_page(PAGE, [DesignResult])
    assert "yesterday" not in page
    assert "Prose." in page
    assert "| `omega` | rad/s | base frequency |" in page
    assert "| `solver.starts` |" in page
    assert "### tables/limits.csv" in page
    assert "| `q1` … `q6` | m | length of strut 1 … 6 |" in page
    assert documented_page(page, [DesignResult]) == page


def test_every_column_of_a_result_is_documented():
    tables = dict(file_tables([DesignResult]))
    for table in result_tables(DesignResult):
        text = tables[table.file]
        assert all(f"`{name}`" in text for name in table.names if not name[-1:].isdigit())


def test_a_page_is_checked_and_written(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(PAGE, encoding="utf-8")
    assert main([str(path), "--check"]) == 1
    assert main([str(path)]) == 0
    assert main([str(path), "--check"]) == 0
    assert "### sweep.json" in path.read_text(encoding="utf-8")


@pytest.fixture
def plug_in(tmp_path, monkeypatch):
    """Install a plug-in with a result for the time of a test."""
    (tmp_path / "swaying_stage.py").write_text(textwrap.dedent(MODULE), encoding="utf-8")
    about = tmp_path / "swaying-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: swaying\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nsway = swaying_stage\n")
    monkeypatch.syspath_prepend(tmp_path)
    plugins.plugin_modules.cache_clear()
    yield
    plugins.plugin_modules.cache_clear()


@pytest.mark.usefixtures("plug_in")
def test_the_result_of_a_plug_in_is_documented():
    page = documented_page(PAGE, all_results())
    assert "### sway.json" in page
    assert "| `amplitude` | m | largest amplitude |" in page
    assert "### tables/sway.csv\n\nOne row each. Amplitude of a mode." in page
