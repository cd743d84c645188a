"""The report of a run folder: what it says, that it needs nothing else, and that it is safe."""

import csv
import json
import re
import shutil

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.stages.registry import reported_stages
from results.render.run_report import write_report
from tests.blank_figures import blank_figures
from tests.report.conftest import HOSTILE
from tests.report.html import Page


def text_of(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def change(path, edit):
    document = json.loads(path.read_text(encoding="utf-8"))
    edit(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def test_every_stage_is_told(whole):
    page = Page(text_of(whole))
    sections = {"summary", "motion", "design", "experiment", "estimate", "validation"}
    assert sections | {"montecarlo", "provenance"} <= set(page.ids)
    manifest = json.loads((whole / "manifest.json").read_text(encoding="utf-8"))
    for version in manifest["versions"].values():
        assert version in page.text
    design = json.loads((whole / "design.json").read_text(encoding="utf-8"))
    assert f"{design['log_det_information']:.6g}".replace("-", "−") in page.text
    for warning in design["warnings"]:
        assert warning in page.text
    assert "simulated" in page.text


def test_summary_and_verdicts_come_first(whole):
    text = text_of(whole)
    assert text.index('class="verdicts"') < text.index("<section") < text.index("<table")


def test_all_figures_and_tables_are_there(whole):
    page = Page(text_of(whole))
    figures = {path.stem for path in (whole / "figures").glob("*.svg")}
    assert figures == {i.removeprefix("figure-") for i in page.ids if i.startswith("figure-")}
    tables = {i.removeprefix("table-") for i in page.ids if i.startswith("table-")}
    assert {"limits", "parameters", "estimates", "findings", "validation", "montecarlo"} <= tables
    assert len(page.ids) == len(set(page.ids))


def test_nothing_is_loaded(whole):
    page = Page(text_of(whole))
    for tag, link in page.links:
        assert link.startswith(("data:", "#")), (tag, link[:80])
    assert not {"link", "iframe", "object", "embed", "base"} & set(page.tags)
    text = re.sub(r'src="data:[^"]*"', "", text_of(whole))
    assert not re.search(r"url\(|@import|\bfetch\(|XMLHttpRequest", text)
    assert "default-src 'none'" in text


def test_hostile_texts_are_shown_and_not_run(whole):
    text = text_of(whole)
    assert "<script>alert" not in text
    page = Page(text)
    assert f"Report of {HOSTILE}" in page.text
    assert f"All stages of {HOSTILE}" in page.text


def test_hostile_results_are_shown_and_not_run(folder):
    def poison(document):
        document["warnings"] = [HOSTILE]
        document["diagnostics"]["verdict"]["findings"][0]["sentence"] = HOSTILE
        document["diagnostics"]["verdict"]["findings"][0]["assumption"] = HOSTILE

    change(folder / "estimate.json", poison)

    def poison_manifest(document):
        document["versions"][HOSTILE] = HOSTILE
        document["stages"]["estimate"]["message"] = HOSTILE

    change(folder / "manifest.json", poison_manifest)
    write_report(folder, reported_stages())
    assert "<script>alert" not in text_of(folder)
    assert Page(text_of(folder)).text.count("alert(") >= 6


def test_the_same_folder_gives_the_same_bytes(folder, whole):
    first = {path.name: path.read_bytes() for path in write_report(folder, reported_stages())}
    again = {path.name: path.read_bytes() for path in write_report(folder, reported_stages())}
    assert first == again
    assert first["report.html"] == (whole / "report.html").read_bytes()
    assert {"limits.tex", "parameters.tex", "estimates.tex"} <= set(first)


@pytest.mark.parametrize("stage", ["design", "truth", "montecarlo", "estimate", "validation"])
def test_a_folder_without_a_stage(folder, stage):
    (folder / f"{stage}.json").unlink()
    write_report(folder, reported_stages())
    key = {"truth": "experiment"}.get(stage, stage)
    ids = Page(text_of(folder)).ids
    assert key not in ids
    assert "motion" in ids
    others = {"design", "experiment", "montecarlo", "estimate", "validation"} - {key}
    assert others <= set(ids)


def test_a_folder_without_manifest_or_figures(folder):
    (folder / "manifest.json").unlink()
    shutil.rmtree(folder / "figures")
    with blank_figures(filled=True):
        write_report(folder, reported_stages())
    text = text_of(folder)
    assert "has no manifest.json" in text
    # They are drawn anew, from the folder alone.
    ids = Page(text).ids
    assert {"figure-excitation", "figure-montecarlo_bias", "figure-residuals"} <= set(ids)


def test_figures_are_drawn_in_the_formats_that_are_wanted(folder):
    run = folder / "run.yaml"
    text = run.read_text(encoding="utf-8")
    assert 'figures: ["svg"]' in text or "figures: [svg]" in text
    run.write_text(re.sub(r"figures: \[.*\]", "figures: [svg, pdf]", text), encoding="utf-8")
    # Those of one stage show it.
    for stage in ("design", "truth", "estimate", "validation"):
        (folder / f"{stage}.json").unlink()
    shutil.rmtree(folder / "figures")
    write_report(folder, reported_stages())
    drawn = folder / "figures" / "montecarlo_bias.svg"
    svg = drawn.read_bytes()
    assert b"<path" in svg
    pdf = drawn.with_suffix(".pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert not drawn.with_suffix(".png").exists()
    drawn.with_suffix(".pdf").unlink()
    write_report(folder, reported_stages())
    assert drawn.with_suffix(".pdf").read_bytes() == pdf
    # How a figure is laid out does not depend on the formats.
    run.write_text(text, encoding="utf-8")
    drawn.unlink()
    write_report(folder, reported_stages())
    assert drawn.read_bytes() == svg


@pytest.mark.parametrize(("ending", "kind"), [("png", "png"), ("pdf", "svg+xml")])
def test_no_other_formats_are_written_for_the_page(ending, kind, folder):
    run = folder / "run.yaml"
    text = run.read_text(encoding="utf-8")
    run.write_text(re.sub(r"figures: \[.*\]", f"figures: [{ending}]", text), encoding="utf-8")
    for stage in ("design", "truth", "estimate", "validation"):
        (folder / f"{stage}.json").unlink()
    shutil.rmtree(folder / "figures")
    write_report(folder, reported_stages())
    assert {path.suffix for path in (folder / "figures").iterdir()} == {f".{ending}"}
    page = text_of(folder)
    assert "figure-montecarlo_bias" in Page(page).ids
    assert page.count("data:image/") == page.count(f"data:image/{kind};base64,") > 0


def test_figures_that_nobody_knows_are_shown_too(folder):
    shutil.copy(folder / "figures" / "struts.svg", folder / "figures" / "of_another_stage.svg")
    write_report(folder, reported_stages())
    assert "figure-of_another_stage" in Page(text_of(folder)).ids


def test_bad_ends_are_told(folder):
    def interrupt(document):
        document["status"] = "interrupted"

    change(folder / "design.json", interrupt)

    def doubt(document):
        verdict = document["diagnostics"]["verdict"]
        verdict["status"] = "doubtful"
        bias = {"outcome": "fails", "serious": True, "sentence": "a bias of 7 N", "first": True}
        verdict["findings"][0] |= bias

    change(folder / "estimate.json", doubt)

    def fail(document):
        document["stages"]["validate"] |= {"status": "failed", "message": "the disk was full"}

    change(folder / "manifest.json", fail)
    write_report(folder, reported_stages())
    head = text_of(folder).partition("<section")[0]
    assert head.count('<li class="bad">') == 3
    words = Page(head).text
    for said in ("interrupted", "recording: a bias of 7 N.", "the disk was full"):
        assert said in words


def test_a_limit_that_is_broken_is_named(folder):
    change(folder / "design.json", lambda document: document.update(status="limits broken"))
    table = folder / "tables" / "limits.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    place = lines[0].split(",").index("violation")
    cells = lines[1].split(",")
    cells[place] = "0.25"
    table.write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]), encoding="utf-8")
    write_report(folder, reported_stages())
    assert f"It breaks {cells[0]}." in Page(text_of(folder)).text


def test_what_is_no_run_folder(tmp_path, folder, expdesign_says):
    (tmp_path / "empty").mkdir()
    for place, reason in ((tmp_path / "none", "no such folder"), (tmp_path / "empty", "run.yaml")):
        with pytest.raises(InputError, match=reason):
            write_report(place, reported_stages())
    for file in folder.glob("*.json"):
        file.unlink()
    (folder / "report.html").unlink()
    with pytest.raises(InputError, match="no results"):
        write_report(folder, reported_stages())
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("design.json", "{"),
        ("design.json", "[]"),
        ("estimate.json", '{"best": "ml"}'),
        ("montecarlo.json", '{"repetitions": {"done": "x", "wanted": 1}}'),
        ("validation.json", '{"motions": 3}'),
        ("tables/limits.csv", "a,b\n1,2\n"),
        ("trajectory.csv", ""),
        ("estimates.csv", "estimator,parameter\n"),
    ],
)
def test_damaged_files_are_named(folder, file, text):
    (folder / file).write_text(text, encoding="utf-8")
    before = (folder / "report.html").read_bytes()
    with pytest.raises(InputError) as caught:
        write_report(folder, reported_stages())
    assert {problem.file for problem in caught.value.problems} == {folder / file}
    assert (folder / "report.html").read_bytes() == before


def test_a_damaged_manifest_is_as_none(folder):
    for text in ("{", '{"format": 1, "versions": 1, "seeds": {}, "evaluation": "", "stages": {}}'):
        (folder / "manifest.json").write_text(text, encoding="utf-8")
        write_report(folder, reported_stages())
        assert "has no manifest.json" in text_of(folder)


def view_of(folder):
    return json.loads(re.search(r'class="data">(.*?)</script>', text_of(folder)).group(1))


def test_the_view_has_the_motion_and_its_forces(whole):
    data = view_of(whole)
    struts = [
        sum((a - b) ** 2 for a, b in zip(joint, base, strict=True)) ** 0.5 / 1000
        for joint, base in zip(data["joints"][0], data["base"], strict=True)
    ]
    header, first, *_ = (whole / "trajectory.csv").read_text(encoding="utf-8").splitlines()
    row = dict(zip(header.split(","), map(float, first.split(",")), strict=True))
    assert struts == pytest.approx([row[f"q{j}"] for j in range(1, 7)], abs=2e-5)
    assert data["force"][0] == pytest.approx([row[f"Q{j}"] for j in range(1, 7)], abs=0.01)
    assert len(data["time"]) == len(data["joints"]) == len(data["force"]) == len(data["tool"])
    assert data["time"][-1] < data["period"]
    assert max(abs(f) for frame in data["force"] for f in frame) <= data["largest"] + 0.01


def test_the_view_tells_which_limits_are_reached(whole):
    """Against the columns of the trajectory: PaLiDA's own limits, of every strut alike."""
    data = view_of(whole)
    columns = {"strut length": "q", "strut speed": "dq", "actuator force": "Q"}
    bounds = {"strut length": (0.45, 0.95), "strut speed": (-2, 2), "actuator force": (-230, 230)}
    with (whole / "trajectory.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(row["t"]) for row in rows])
    frame = np.searchsorted(data["time"], time - time[0] + 1e-4, side="right") - 1
    told = [
        [(data["limits"][k]["title"], data["limits"][k]["row"]) for k in now]
        for now in data["reached"]
    ]
    assert any(told)
    for title, prefix in columns.items():
        low, high = bounds[title]
        for strut in range(1, 7):
            values = np.array([float(row[f"{prefix}{strut}"]) for row in rows])
            near = np.abs(values - (low + high) / 2) >= 0.99 * (high - low) / 2
            expected = set(frame[near].tolist())
            assert expected == {k for k, now in enumerate(told) if (title, f"strut {strut}") in now}
    for one in data["limits"]:
        assert one["platform"] == (not one["struts"])
        assert all(f"{j + 1}" in one["row"] for j in one["struts"])


def test_the_view_of_an_estimate_is_its_motion(folder):
    designed = view_of(folder)
    (folder / "design.json").unlink()
    write_report(folder, reported_stages())
    assert "motion as it was estimated" in text_of(folder)
    estimated = view_of(folder)
    assert len(estimated["reached"]) == len(estimated["time"])
    # It is nearly the same motion, and reaches nearly the same.
    both = [{k["title"] for k in data["limits"]} for data in (designed, estimated)]
    assert both[0] & both[1]


def test_the_stage_of_run_is_kept_and_done_anew(folder, tmp_path, expdesign_says):
    only = tmp_path / "only.yaml"
    only.write_text(
        "name: tiny\nrobot: palida\nreport: {title: Another title, figures: [svg]}\n",
        encoding="utf-8",
    )
    status, output, error = expdesign_says("run", only, "--out", folder, "--json")
    assert status == 0, (output, error)
    assert "<title>Another title</title>" in text_of(folder)
    status, output, _ = expdesign_says("run", only, "--out", folder, "--json")
    assert json.loads(output)["resumed"] is True
    # By itself it has the same title.
    assert expdesign_says("report", folder)[0] == 0
    assert "<title>Another title</title>" in text_of(folder)


def test_a_run_that_was_changed_is_shown_in_its_report(folder, tmp_path, expdesign_says):
    text = (folder / "run.yaml").read_text(encoding="utf-8")
    file = tmp_path / "changed.yaml"
    for old, new, again in (
        (
            "estimators: [gm, ml]",
            "estimators: [gm]",
            {"montecarlo", "estimate", "validate", "report"},
        ),
        # Of no stage that it names, but of what its report shows.
        ("jerk: null", "jerk: 1234.5", {"report"}),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
        file.write_text(text, encoding="utf-8")
        with blank_figures():
            status, output, error = expdesign_says("run", file, "--out", folder, "--json")
        assert status == 0, (output, error)
        stages = json.loads(output)["stages"]
        assert {name for name, stage in stages.items() if not stage["resumed"]} == again
        resolved = (folder / "run.yaml").read_text(encoding="utf-8")
        assert resolved == resolved_yaml(load_run(file))
    assert "jerk: 1234.5" in text_of(folder)


def test_report_by_command(folder, expdesign_says):
    (folder / "report.html").unlink()
    manifest = (folder / "manifest.json").read_bytes()
    status, output, _ = expdesign_says("report", folder, "--json")
    assert status == 0
    assert "report.html" in json.loads(output)["files"]
    # A report by itself is no stage: it leaves the manifest, and the versions in it, alone.
    assert (folder / "manifest.json").read_bytes() == manifest
