"""What a report says of the noise of a recording and of controller tables."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from expdesign.cli.app import app
from expdesign.configuration import InputError, export_section
from expdesign.export.exporting import export_table
from expdesign.export.result import ExportResult, exported_motion, exported_table, readme
from expdesign.runfolder.files import write_text
from expdesign.stages.execution import record_added
from expdesign.stages.registry import reported_stages
from results.render.run_report import run_page, write_report
from results.views.folder import RunFolder
from tests.blank_figures import blank_figures
from tests.export.motions import task
from tests.report.html import Page

NOISE_FIGURES = {"noise_distribution", "noise_quantiles", "noise_covariance"}
SPECTRUM = {"noise_spectrum"}


def page(folder):
    place = RunFolder.open(folder, reported_stages())
    return run_page(place, {name: place.stages[name].views().view(place) for name in place.held})


def section(folder, key):
    (found,) = (s for s in page(folder).sections if s.key == key)
    return found


def figures(found):
    return {block.key for block in found.blocks if block.kind == "figure"}


def tables(found):
    return {block.key: block for block in found.blocks if block.kind == "table"}


def verdict(folder, title):
    (found,) = (v for v in page(folder).verdicts if v.title == title)
    return found


def change(path, edit):
    document = json.loads(path.read_text(encoding="utf-8"))
    edit(document)
    path.write_text(json.dumps(document), encoding="utf-8")


@pytest.fixture(scope="session")
def analysed(whole, made_once):
    """Return a run folder whose own recording's noise was analysed."""

    def make(place):
        shutil.copytree(whole, place / "tiny")
        run = place / "tiny" / "run.yaml"
        with blank_figures(filled=True):
            found = CliRunner().invoke(app, ["noise", str(run), "--out", str(run.parent)])
        assert found.exit_code == 0, (found.output, found.exception)

    return made_once("noise", make) / "tiny"


@pytest.fixture
def noisy(folder, analysed):
    """Give each test its own copy, of which noise and estimate say that they are of its data."""
    shutil.copytree(analysed, folder, dirs_exist_ok=True)
    recording = str(folder / "measurement.csv")
    change(folder / "noise.json", lambda d: d.update(recording=recording))
    change(folder / "estimate.json", lambda d: d["recordings"][0].update(source=recording))
    return folder


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return a folder of two controller tables, of a motion that is known."""
    place = tmp_path_factory.mktemp("exports")
    made = {}
    for name in ("xps-pvt.trj", "pvt-csv.csv"):
        options = export_section(format=name.partition(".")[0])
        made[name] = exported_table(export_table(options, task(), place / name))
    record = ExportResult(exported_motion(task()), made)
    record.write_as(place / "exports.json")
    write_text(place / "README.txt", readme(record))
    return place


@pytest.fixture
def with_tables(folder, exported):
    shutil.copytree(exported, folder / "exports")
    record_added(folder, (folder / "exports").iterdir(), {})
    return folder


def test_the_noise_is_told(noisy):
    record = json.loads((noisy / "noise.json").read_text(encoding="utf-8"))
    found = tables(section(noisy, "noise"))
    forces, lengths = found["noise_forces"].rows, found["noise_lengths"].rows
    assert [row[1] for row in forces] == pytest.approx(record["force_std"])
    assert [row[1] for row in lengths] == pytest.approx(1e3 * np.array(record["length_std"]))
    assert [row[2] for row in forces] == record["normality"]["forces"]["skewness"]
    memory = np.array(record["whiteness"]["length_noise"]["autocorrelation"])
    assert [abs(row[5]) for row in lengths] == np.abs(memory).max(axis=1).tolist()
    assert [row[1] for row in found["noise_findings"].rows] == [
        finding["outcome"] for finding in record["findings"]
    ]
    assert len(found["noise_covariance"].rows) == 72
    assert found["noise_covariance"].folded
    assert verdict(noisy, "Noise").word == "as assumed"


def test_recordings_are_named_from_the_folder(noisy):
    def recording_of(key):
        texts = [
            fact
            for block in section(noisy, key).blocks
            if block.kind == "facts"
            for fact in block.facts
        ]
        (note,) = [fact.note for fact in texts if fact.name == "recording"]
        return note

    assert recording_of("noise") == "measurement.csv"
    assert recording_of("estimate").endswith("; measurement.csv")
    change(noisy / "noise.json", lambda d: d.update(recording="/home/of/me/other.csv"))
    assert recording_of("noise") == "other.csv"


def test_noise_figures_are_shown_once(noisy):
    assert figures(section(noisy, "noise")) == NOISE_FIGURES | SPECTRUM
    assert not NOISE_FIGURES & figures(section(noisy, "estimate"))
    # Of another recording: the figures are those of the estimate, which drew them last.
    change(noisy / "noise.json", lambda d: d.update(recording="another.csv"))
    assert figures(section(noisy, "noise")) == SPECTRUM
    assert figures(section(noisy, "estimate")) >= NOISE_FIGURES


def test_noise_against_what_is_assumed(noisy):
    def fail(place, serious):
        def edit(document):
            document["findings"][place] |= {
                "outcome": "fails",
                "sentence": f"seen {place}",
                "serious": serious,
            }

        change(noisy / "noise.json", edit)

    fail(2, serious=False)
    found = verdict(noisy, "Noise")
    assert (found.level.value, found.word) == ("caution", "conspicuous")
    fail(0, serious=True)
    found = verdict(noisy, "Noise")
    assert (found.level.value, found.word) == ("bad", "doubtful")
    assert "seen 0; seen 2" in found.sentence


def test_noise_of_which_little_was_tested(noisy):
    count = 0

    def untested(document):
        for finding in document["findings"][:count]:
            finding["outcome"] = "not tested"
        for finding in document["findings"][count:]:
            finding["outcome"] = "holds"

    change(noisy / "noise.json", untested)
    assert verdict(noisy, "Noise").level.value == "good"
    every = len(json.loads((noisy / "noise.json").read_text(encoding="utf-8"))["findings"])
    count = 3
    change(noisy / "noise.json", untested)
    found = verdict(noisy, "Noise")
    assert found.level.value == "neutral"
    assert found.word.split()[:3] == [f"{every - 3}", "of", f"{every}"]


def test_noise_without_whole_periods(noisy):
    def edit(document):
        document["averaged"] = False
        document["whiteness"] = {"force_noise": None, "length_noise": None}
        document["whiteness"]["refused"] = "2 samples are missing" * missing

    for missing in (False, True):
        change(noisy / "noise.json", edit)
        found = section(noisy, "noise")
        assert all(row[5] is None for row in tables(found)["noise_forces"].rows)
        (text,) = [b.text for b in found.blocks if b.kind == "text" and "Fourier" in b.text]
        assert ("2 samples" in text) == missing


def test_noise_alone_makes_a_report(noisy, tmp_path):
    alone = tmp_path / "alone"
    for name in ("run.yaml", "noise.json", "noise.yaml", "tables", "figures"):
        (alone / name).parent.mkdir(parents=True, exist_ok=True)
        if (noisy / name).is_dir():
            shutil.copytree(noisy / name, alone / name)
        else:
            shutil.copy(noisy / name, alone / name)
    assert figures(section(alone, "noise")) == NOISE_FIGURES | SPECTRUM


def test_tables_are_told_with_what_they_do(with_tables):
    record = json.loads((with_tables / "exports/exports.json").read_text(encoding="utf-8"))
    found = tables(section(with_tables, "export"))
    assert [row[0] for row in found["exports"].rows] == list(record["files"])
    for row in found["read_back"].rows:
        check = record["files"][row[0]]["read_back"]
        assert row[1] == pytest.approx(1e6 * check["position_error"])
        assert row[2] == pytest.approx(1e6 * check["tolerances"]["position"])
        assert row[4] == pytest.approx(100 * check["acceleration_error_share"])
        assert row[7:] == (
            "yes" if check["certified"] else "no",
            check["information"]["log_det_change"],
            pytest.approx(100 * check["information"]["std_change"]),
            check["information"]["parameter"],
        )
        # The motion of the tests keeps two percent of every limit's range.
        title, _, share = row[6].rpartition(", ")
        assert title
        assert 90 < float(share.removesuffix(" %")) <= 98.5
    assert len(found["export_axes"].rows) == 12
    assert verdict(with_tables, "Controller tables").word == "checked"
    write_report(with_tables, reported_stages())
    page = Page((with_tables / "report.html").read_text(encoding="utf-8"))
    assert "Before the first run" in page.text
    assert "export" in page.ids


def test_a_table_that_is_gone_is_named(with_tables):
    (with_tables / "exports/xps-pvt.trj").unlink()
    found = verdict(with_tables, "Controller tables")
    assert found.level.value == "bad"
    assert "xps-pvt.trj" in found.sentence


def test_a_table_that_was_changed_is_named(with_tables):
    with (with_tables / "exports/xps-pvt.trj").open("a") as table:
        table.write("\n")
    found = verdict(with_tables, "Controller tables")
    assert (found.level.value, found.word) == ("caution", "changed")
    assert "Changed since the check: xps-pvt.trj." in found.sentence


def test_a_limit_that_a_table_exceeds_within_its_tolerance_is_told(with_tables):
    words = "strut acceleration of strut 1 is 30.0084 m/s^2, exceeded by 0.014 % of its range"

    def edit(document):
        check = document["files"]["xps-pvt.trj"]["read_back"]
        check["limits"]["strut_acceleration"]["violation"] = 0.00014
        check["limits_in_words"] = words
        check["broken"] = [words]

    change(with_tables / "exports/exports.json", edit)
    found = verdict(with_tables, "Controller tables")
    assert (found.level.value, found.word) == ("bad", "beyond limits")
    assert f"xps-pvt.trj breaks limits: {words}." in found.sentence
    assert "every limit" not in found.sentence


def test_tables_without_noise_and_without_limits_of_force(with_tables):
    def edit(document):
        check = document["files"]["xps-pvt.trj"]["read_back"]
        check |= {"information": None, "force_error_share": None, "limits": {}}

    change(with_tables / "exports/exports.json", edit)
    row = tables(section(with_tables, "export"))["read_back"].rows[0]
    assert np.isnan(row[5])
    assert row[6:] == ("–", "yes", None, None, "–")
    write_report(with_tables, reported_stages())


@pytest.mark.parametrize("name", ["noise.json", "exports/exports.json"])
def test_files_of_something_else_are_named(noisy, exported, name):
    shutil.copytree(exported, noisy / "exports")
    (noisy / name).write_text('{"motion": 3, "rows": "many"}', encoding="utf-8")
    with pytest.raises(InputError, match=name.rpartition("/")[2]):
        write_report(noisy, reported_stages())
