"""A sweep through the command line: its designs, what its table says of them, and its report."""

import csv
import json
import shutil
import signal
from contextlib import contextmanager

import numpy as np
import pytest

import expdesign as package
from expdesign.cli.app import app
from expdesign.cli.app import run as command
from expdesign.configuration import load_run, resolved_yaml
from expdesign.experiment.sweep import SweepResult
from expdesign.runfolder.manifest import Manifest
from tests.blank_figures import blank_figures
from tests.stages.test_registry import assert_declared_files

SWEEP = {"trajectory.harmonics": [1, 2], "limits.strut_speed.scale": [1, 1e-9]}
"""No motion is as slow as the second limit."""
FAILING = {"harmonics-1-strut_speed.scale-1e-09", "harmonics-2-strut_speed.scale-1e-09"}
MADE = ["harmonics-1-strut_speed.scale-1", "harmonics-2-strut_speed.scale-1"]


@pytest.fixture(scope="module")
def mapping(tiny, few_limits):
    """Return a maker of runs whose designs take a second each."""

    def of(sweep, **sections):
        quick = {"starts": 1, "max_iterations": 4}
        return tiny(robot=few_limits, design=quick, sweep=sweep, **sections)

    return of


def written(place, run):
    path = place / "input.yaml"
    path.write_text(json.dumps(run), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def half_failed(mapping, made_once, cheaper):
    """Return the folder of a sweep of which two of four designs fail; its run file lies in it."""

    def make(folder):
        file = written(folder, mapping(SWEEP, report={"figures": ["svg"]}))
        with blank_figures(), cheaper():
            status = command(app, ["run", str(file), "--out", str(folder / "out")])
        (folder / "status").write_text(str(status))

    return made_once("sweep-half-failed", make)


def rows(folder):
    with (folder / "tables" / "sweep.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_one_that_fails_ends_no_other_and_is_a_row(half_failed):
    folder = half_failed / "out"
    assert (half_failed / "status").read_text() == "1"
    found = rows(folder)
    assert [(row["trajectory.harmonics"], row["limits.strut_speed.scale"]) for row in found] == [
        *(("1", "1.0"), ("1", "1e-09"), ("2", "1.0"), ("2", "1e-09"))
    ]
    for row in found[1::2]:
        assert (row["status"], row["folder"], row["certified"]) == ("failed", "", "False")
        assert "strut_speed" in row["reason"]
    assert {path.name for path in (folder / "designs").iterdir()} == set(MADE)
    entry = Manifest.read(folder).stages["sweep"]
    assert entry.status == "incomplete"
    assert "2 of 4 designs failed" in entry.message
    assert assert_declared_files(folder) == {"sweep", "report"}


def test_the_table_says_what_the_folders_hold(half_failed):
    folder = half_failed / "out"
    for row in rows(folder)[::2]:
        place = folder / row["folder"]
        design = json.loads((place / "design.json").read_text(encoding="utf-8"))
        assert row["status"] == design["status"]
        assert row["trajectory.harmonics"] == str(design["harmonics"])
        assert row["criterion"] == design["criterion"] == "d"
        for key in ("criterion_value", "log_det_information", "period"):
            assert float(row[key]) == design[key]
        proved = [limit["certified"] for limit in design["limits"].values()]
        assert row["certified"] == str(all(proved))
        experiment = design["predicted_std"]["experiment"]
        assert float(row["measuring_time"]) == pytest.approx(
            experiment["periods"] * design["period"]
        )
        nominal = load_run(place / "run.yaml").robot.parameters
        percent = {name: 100 * experiment[name] / abs(nominal[name]) for name in nominal}
        worst = max(percent, key=percent.get)
        assert row["worst_parameter"] == worst
        assert float(row["worst_rel_std_percent"]) == pytest.approx(percent[worst])
        median = np.median(list(percent.values()))
        assert float(row["median_rel_std_percent"]) == pytest.approx(median)
        # Three periods at the highest frequency, 0.6 Hz, for all designs.
        longer = experiment["periods"] * design["period"] / 5.0
        equal = float(row["equal_time_rel_std_percent"])
        assert equal == pytest.approx(median * np.sqrt(longer), rel=1e-6)
        solver = design["solver"]
        assert float(row["cpu_seconds"]) == solver["cpu_seconds"] > 0
        assert int(row["iterations"]) == solver["iterations"]
        assert int(row["evaluations"]) == sum(solver["evaluations"].values())
        assert row["reason"] == ""


def test_every_folder_is_that_of_a_run_with_its_values(half_failed, mapping):
    folder = half_failed / "out"
    for harmonics, name in enumerate(MADE, start=1):
        place = folder / "designs" / name
        alone = load_run(place / "run.yaml")
        wanted = mapping(None, trajectory={"harmonics": harmonics}, report={"figures": ["svg"]})
        wanted |= {"name": f"tiny-{name}", "limits": {"strut_speed": 2.0}}
        del wanted["sweep"]
        assert resolved_yaml(alone) == resolved_yaml(load_run(wanted))
        assert assert_declared_files(place) == {"design"}


def test_the_record_is_read_as_it_was_written(half_failed, tmp_path):
    folder = half_failed / "out"
    record = SweepResult.read(folder)
    assert (record.point_count, record.made, record.interrupted) == (4, 2, False)
    assert record.labels[1] == "harmonics 1, strut_speed.scale 1e-09"
    assert record.most_precise is min(record.designs[::2], key=lambda one: one.precision)
    record.write(tmp_path)
    for file in ("sweep.json", "tables/sweep.csv"):
        assert (tmp_path / file).read_bytes() == (folder / file).read_bytes()
    (tmp_path / "tables" / "sweep.csv").write_bytes(
        b"\n".join((folder / "tables" / "sweep.csv").read_bytes().splitlines()[:-1])
    )
    with pytest.raises(package.InputError, match="3 rows"):
        SweepResult.read(tmp_path)


def test_the_report_shows_all_of_it(half_failed):
    page = (half_failed / "out" / "report.html").read_text(encoding="utf-8")
    assert "incomplete" in page
    assert 'id="sweep"' in page
    assert page.count("data:image/svg+xml") == 1
    assert (half_failed / "out" / "figures" / "sweep.svg").is_file()
    for name in MADE:
        assert f"designs/{name}" in page
    for path in SWEEP:
        assert path in page


def test_the_same_command_makes_what_is_missing_only(
    expdesign, half_failed, mapping, tmp_path, cheap_finish
):
    folder = tmp_path / "out"
    shutil.copytree(half_failed / "out", folder)
    before = {name: (folder / "designs" / name / "design.json").read_bytes() for name in MADE}
    # One that failed fails again; a table that was lost is made again from the folders.
    (folder / "tables" / "sweep.csv").unlink()
    status, out, messages = expdesign("run", half_failed / "input.yaml", "--out", folder)
    assert status == 1
    assert "2 of 4 designs failed" in messages
    assert "most precise design" in out
    assert (folder / "tables" / "sweep.csv").read_bytes() == (
        half_failed / "out" / "tables" / "sweep.csv"
    ).read_bytes()

    # Another grid: what it shares with the one before is there already.
    other = {"trajectory.harmonics": [2, 1, 3], "limits.strut_speed.scale": [1]}
    file = written(tmp_path, mapping(other, report={"figures": ["svg"]}))
    status, out, _ = expdesign("run", file, "--out", folder, "--json")
    assert status == 0
    stages = json.loads(out)["stages"]
    assert (stages["sweep"]["made"], stages["sweep"]["failed"]) == (3, 0)
    assert [row["number"] for row in rows(folder)] == ["1", "2", "3"]
    assert [row["trajectory.harmonics"] for row in rows(folder)] == ["2", "1", "3"]
    for name, content in before.items():
        assert (folder / "designs" / name / "design.json").read_bytes() == content
    assert json.loads(expdesign("run", file, "--out", folder, "--json")[1])["resumed"]

    # A folder that is gone is made again, though nothing else has changed.
    shutil.rmtree(folder / "designs" / MADE[0])
    assert expdesign("run", file, "--out", folder)[0] == 0
    again = json.loads((folder / "designs" / MADE[0] / "design.json").read_text(encoding="utf-8"))
    assert again["mu"] == json.loads(before[MADE[0]])["mu"]


class Impatient(package.Progress):
    """Presses Ctrl-C when the first design is done, as the search of the second begins."""

    @contextmanager
    def count(self, what):
        assert what == "designs"
        yield lambda done, total: signal.raise_signal(signal.SIGINT) if done == 1 else None


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(expdesign, mapping, tmp_path, cheap_finish):
    folder = tmp_path / "out"
    run = mapping({"design.seed": [0, 1, 2]}, report={})
    with pytest.raises(package.StageFailed, match="interrupted after 1 of 3 designs"):
        package.run(run, out=folder, progress=Impatient())
    assert [row["status"] for row in rows(folder)][1:] == ["not begun"] * 2
    assert Manifest.read(folder).stages["sweep"].status == "interrupted"
    assert json.loads((folder / "sweep.json").read_text())["interrupted"]
    assert expdesign("report", folder)[0] == 0
    assert "interrupted" in (folder / "report.html").read_text(encoding="utf-8")
    kept = (folder / "designs" / "seed-0" / "design.json").read_bytes()
    status, out, _ = expdesign("run", written(tmp_path, run), "--out", folder, "--json")
    assert (status, json.loads(out)["stages"]["sweep"]["interrupted"]) == (0, False)
    assert (folder / "designs" / "seed-0" / "design.json").read_bytes() == kept
    assert all(one.complete for one in SweepResult.read(folder).designs)


class Hasty(package.Progress):
    """Presses Ctrl-C when the second design looks for its first motion."""

    def __init__(self):
        self.begun = 0

    @contextmanager
    def working(self, what):
        yield self.told

    def told(self, what, done, total):
        self.begun += what == "the first start"
        if self.begun == 2:
            self.begun += 1
            signal.raise_signal(signal.SIGINT)


def test_a_design_under_way_is_marked_and_made_again(mapping, tmp_path, cheap_finish):
    folder = tmp_path / "out"
    run = mapping({"design.seed": [0, 1, 2]})
    with pytest.raises(package.StageFailed, match="interrupted after 1 of 3 designs"):
        package.run(run, out=folder, progress=Hasty())
    assert [row["status"] for row in rows(folder)][1:] == ["interrupted", "not begun"]
    package.run(run, out=folder)
    assert all(one.complete for one in SweepResult.read(folder).designs)


def test_check_says_how_many_designs_there_are(expdesign, mapping, tmp_path):
    file = written(tmp_path, mapping(SWEEP, estimate={}, export=["csv"], report={}))
    status, out, messages = expdesign("check", file)
    assert status == 0
    assert "4 designs: trajectory.harmonics 1 | 2, limits.strut_speed.scale 1 | 1e-09" in messages
    assert "expdesign run does: sweep, report" in messages
    assert "sweep:" in out
    found = json.loads(expdesign("check", file, "--json")[1])
    assert set(found["designs"]) == {*MADE, *FAILING}
    assert found["run_does"] == ["sweep", "report"]
    # Home lies beyond the second limit.
    shut = {"trajectory.harmonics": [1, 2], "limits.strut_length.scale": [1, 1e-9]}
    status, _, messages = expdesign("check", written(tmp_path, mapping(shut)))
    assert status == 2
    assert "with trajectory.harmonics 1, limits.strut_length.scale 1e-09: the home" in messages
    wrong = written(tmp_path, mapping({"trajectory.harmonix": [1]}))
    status, _, messages = expdesign("check", wrong)
    assert status == 2
    assert "did you mean 'trajectory.harmonics'" in messages
    assert expdesign("run", wrong, "--out", tmp_path / "none")[0] == 2
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_two_workers_make_the_same_designs(expdesign, mapping, tmp_path):
    tables = []
    for workers in (1, 2):
        run = mapping({"design.criterion": ["d", "a"]}, workers=workers)
        folder = tmp_path / f"{workers}"
        assert expdesign("run", written(tmp_path, run), "--out", folder)[0] == 0
        found = rows(folder)
        assert all(float(row.pop("cpu_seconds")) > 0 for row in found)
        tables.append(found)
    assert tables[0] == tables[1]
    assert [row["criterion"] for row in tables[0]] == ["d", "a"]
