"""The paper's three studies, reduced: run files that ship, from the command line to the report."""

import csv
import json

import pytest
from ruamel.yaml import YAML

from estimation.studies.records import TABLES
from expdesign.library import run_files

SMALL = {
    "trajectory": {
        "harmonics": 2,
        "frequency": ["0.1 Hz", "0.6 Hz"],
        "samples": 40,
        "controller_period": "20 ms",
    },
    "design": {"starts": 1, "search": "restarts", "max_iterations": 12},
    # With five periods of so small a design the difference test rejects one in four.
    "experiment": {"periods": 20, "sampling": "50 Hz"},
}
STUDIES = {
    "paper_design": {"sets": 1, "repetitions": 25},
    "paper_identification": {"repetitions": 4},
    "paper_validation": {
        "repetitions": 3,
        "cogging": {"amplitude": ["0 N", "0 N", "60 N", "80 N", "0 N", "0 N"], "pitch": "30 mm"},
        "motions": [{"motion": "circle", "radius": "100 mm", "speed": "0.5 m/s", "periods": 40}],
        "wrong": {"p10": 1.5},
    },
}
WRITTEN = {f"paper_{kind}": tables for kind, tables in TABLES.items()}


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def runs(tmp_path_factory, cheaper):
    """Return the folders of the three studies."""
    from typer.testing import CliRunner

    from expdesign.cli.app import app

    place = tmp_path_factory.mktemp("paper")
    folders = {}
    for name, changes in STUDIES.items():
        run = YAML(typ="safe").load(run_files()[name].read_text(encoding="utf-8"))
        # Two of them have the same design, which is kept where the run has the same name.
        run |= SMALL | {"name": "paper", "workers": 1}
        run["study"] |= changes
        file = place / f"{name}.yaml"
        with file.open("w", encoding="utf-8") as stream:
            YAML(typ="safe").dump(run, stream)
        folders[name] = place / name
        if name == "paper_validation":
            # Its design is that of the study before: it is not searched a second time.
            _keep_design(folders["paper_identification"], folders[name])
        with cheaper():
            found = CliRunner().invoke(app, ["run", str(file), "--out", str(folders[name])])
        assert found.exit_code == 0, (found.output, found.exception)
        assert ("design: done already" in found.output) == (name == "paper_validation")
    return folders


def _keep_design(done, folder):
    """Copy what the stage `design` of a run has written."""
    manifest = json.loads((done / "manifest.json").read_text(encoding="utf-8"))
    stage = manifest["stages"]["design"]
    for name in stage["files"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes((done / name).read_bytes())
    manifest["stages"] = {"design": stage}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


@pytest.mark.parametrize("name", list(STUDIES))
def test_a_study_writes_its_claims_tables_figures_and_report(runs, name):
    folder = runs[name]
    record = json.loads((folder / "study.json").read_text())
    assert record["simulated"] is True
    assert record["claims"]
    described = json.loads((folder / "columns.json").read_text())
    for table in WRITTEN[name]:
        assert list(rows(folder / table.file)[0]) == list(table.names)
        assert table.file in described
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "simulated" in page
    for claim in record["claims"][:3]:
        assert claim["value"].split(";")[0].split("<")[0].strip()[:20] in page.replace("&#39;", "'")
    assert list((folder / "figures").glob("study_*.svg"))
    assert json.loads((folder / "manifest.json").read_text())["stages"]["study"]["status"] == "done"


def test_the_design_study_shows_the_pattern_of_table_2(runs):
    folder = runs["paper_design"]
    found = {claim["statement"]: claim for claim in _claims(folder)}
    first = next(text for text in found if "smaller determinant" in text)
    assert found[first]["holds"] is True
    assert found[first]["paper"]
    determinants = rows(folder / "tables" / "study_determinants.csv")
    assert all(float(row["difference"]) > 0 for row in determinants if row["kinematics"] == "exact")
    one, two = rows(folder / "tables" / "study_designs.csv")
    for row in (one, two):
        assert (folder / row["folder"] / "design.json").is_file()
        assert row["keeps_limits"] == "True"
    assert float(two["condition_si"]) < 0.1 * float(one["condition_si"])
    assert float(two["log_det_information"]) < float(one["log_det_information"])


def test_the_identification_study_says_where_the_information_is_disturbed(runs):
    said = {}
    for row in rows(runs["paper_identification"] / "tables" / "study_hausman.csv"):
        said.setdefault(row["case"], set()).add(row["disturbed"])
    assert said == {"undisturbed": {"no"}, "pointwise": {"yes"}, "tracking": {"yes"}}


def test_the_validation_study_names_the_struts(runs):
    for row in rows(runs["paper_validation"] / "tables" / "study_variances.csv"):
        wanted = row["situation"] != "without" and row["actuator"] in "34"
        if row["situation"] != "known":
            assert (row["fails"] == row["runs"]) == wanted, row
    (power,) = rows(runs["paper_validation"] / "tables" / "study_power.csv")
    assert (power["seen"], power["runs"]) == ("3", "3")


def test_a_study_that_is_done_is_kept(runs, expdesign):
    folder = runs["paper_identification"]
    before = (folder / "study.json").stat().st_mtime_ns
    status, out, err = expdesign(
        "run", str(folder.parent / "paper_identification.yaml"), "--out", str(folder)
    )
    assert status == 0
    assert "study: done already" in out + err
    assert (folder / "study.json").stat().st_mtime_ns == before


def test_two_workers_write_the_same_tables(runs, expdesign, tmp_path):
    one = runs["paper_identification"]
    run = YAML(typ="safe").load((one.parent / "paper_identification.yaml").read_text())
    del run["design"], run["report"]
    run["workers"] = 2
    file = tmp_path / "run.yaml"
    with file.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(run, stream)
    two = tmp_path / "two"
    two.mkdir()
    (two / "design.json").write_bytes((one / "design.json").read_bytes())
    status, _, err = expdesign("run", str(file), "--out", str(two))
    assert status == 0, err
    for table in WRITTEN["paper_identification"]:
        assert (two / table.file).read_bytes() == (one / table.file).read_bytes()
    assert (two / "study.json").read_bytes() == (one / "study.json").read_bytes()


def test_the_comparison_ends_with_all_claims(runs, expdesign, tmp_path):
    designs = runs["paper_design"] / "designs"
    status, _, err = expdesign(
        "compare",
        *(str(designs / name) for name in ("1-d", "1-condition")),
        *(str(folder) for folder in runs.values()),
        "--quick",
        "--out",
        str(tmp_path / "paper"),
    )
    assert status == 0, err
    found = rows(tmp_path / "paper" / "tables" / "claims.csv")
    assert len(found) == sum(len(_claims(folder)) for folder in runs.values())


def _claims(folder):
    return json.loads((folder / "study.json").read_text())["claims"]
