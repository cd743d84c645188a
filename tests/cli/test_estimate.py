import io
import json
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from estimation.kinematics import MotionFitError
from expdesign.cli.terminal import Terminal
from expdesign.robot import load_robot
from expdesign.stages.registry import stages
from expdesign.stages.stage import Outcome
from results.render.terminal import brief_warnings, print_view
from results.views.folder import RunFolder
from results.views.view import Level, StageVerdict, StageView
from tests.estimation.cases import STEP, measured, trajectory

MOTION = trajectory()


class Answer(NamedTuple):
    status: int
    output: str
    error: str


@pytest.fixture
def command(expdesign, monkeypatch):
    """Run a command line without its figures; return what came out by name."""
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())

    def call(*arguments):
        return Answer(*expdesign(*arguments))

    return call


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a design.json, a run file and a recording, as a user has them."""
    design = {
        "harmonics": MOTION.harmonics,
        "omega": MOTION.omega,
        "lambda0": MOTION.lambda0.tolist(),
        "mu": MOTION.mu.tolist(),
        "nu": MOTION.nu.tolist(),
    }
    (tmp_path / "design.json").write_text(json.dumps(design))
    (tmp_path / "run.yaml").write_text("name: lab\nrobot: palida\n")
    write(tmp_path / "recording.csv")
    return tmp_path


def write(path, seed=0, change=None):
    data = measured(MOTION, seed)
    table = pd.DataFrame(
        np.column_stack([data.time, data.lengths, data.forces]),
        columns=["t", *(f"q{j}" for j in range(1, 7)), *(f"Q{j}" for j in range(1, 7))],
    )
    if change is not None:
        table = change(table)
    table.to_csv(path, index=False)
    return path


def arguments(folder, *more):
    return [
        "estimate",
        str(folder / "run.yaml"),
        "--data",
        str(folder / "recording.csv"),
        "--design",
        str(folder),
        "--out",
        str(folder / "out"),
        *more,
    ]


def _rows(folder):
    """Return the rows of the diagnosed estimator."""
    table = pd.read_csv(folder / "out" / "estimates.csv")
    return table[table.estimator == "ml"]


def test_the_screen_of_an_estimate_names_what_would_not_be_seen(folder, command):
    write(folder / "recording.csv", seed=1)
    assert command(*arguments(folder)).status == 0
    view = RunFolder.open(folder / "out", stages()).view("estimate")
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    print_view(view, console, "out", below=len(brief_warnings(view, view.warnings, 80)))
    shown = console.file.getvalue()
    assert len(shown.splitlines()) <= 40, shown
    words = " ".join(shown.split())
    assert "p10: mass of the platform and the six sliders; " in words
    record = json.loads((folder / "out" / "estimate.json").read_text())
    rows = _rows(folder).set_index("parameter", drop=False)
    summary = record["diagnostics"]["verdict"]["summary"]
    assert " would not be seen and could change mass by " in summary
    assert summary.partition(": ")[2] in words
    share = rows.std_undetected / abs(rows.a_priori)
    uncertain = rows.parameter[share.sort_values(ascending=False).index]
    assert all(f"{name} by " in words for name in uncertain[:3])
    assert f"and {np.sum(share >= 0.5) - 3} more by over half" in words


def test_warnings_follow_the_verdict_on_a_line_each(monkeypatch):
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    monkeypatch.setattr("expdesign.cli.terminal.results", lambda: console)
    monkeypatch.setattr("expdesign.cli.terminal.messages", lambda: console)
    verdict = StageVerdict("Estimate", Level.BAD, "doubtful", "ML from 1 recording.")
    warnings = ("12 rows were left out", "the forces lag behind the lengths. " * 5)
    view = StageView(verdict, most_lines=40)
    Terminal().show(Outcome(folder=Path("run"), view=view, warnings=warnings))
    first, place, *last = console.file.getvalue().splitlines()
    assert first.startswith("Estimate: doubtful.")
    assert place == "written to run"
    assert last[0] == "warning: 12 rows were left out"
    assert last[1].startswith("warning: the forces lag behind the lengths. the forces")
    assert last[1].endswith(" … (report)")
    assert len(last) == 2


@pytest.mark.parametrize("wanted", ["mass", "centre", "v1"])
def test_the_verdict_states_what_undetected_effects_change_of_what_the_run_asks_for(
    folder, command, wanted
):
    goal = "1 mm" if wanted == "centre" else "1 %"
    run = {"name": "lab", "robot": "palida", "goals": {wanted: goal}}
    (folder / "run.yaml").write_text(json.dumps(run))
    write(folder / "recording.csv", seed=1)
    assert command(*arguments(folder)).status == 0
    record = json.loads((folder / "out" / "estimate.json").read_text())
    stds = {one["quantity"]: one["std"] for one in record["estimators"]["ml"]["derived"]}
    stds |= _rows(folder).set_index("parameter")["std"].to_dict()
    ratio, change, text = max(
        (size / stds[name], size, effect["text"])
        for effect in record["diagnostics"]["undetected"]
        for name, size in {**effect["shifts"], **effect["derived"]}.items()
        if name == wanted or name.startswith(f"{wanted}_")
    )
    words = record["diagnostics"]["verdict"]["summary"]
    by, named, unit, sigmas = re.search(
        rf"no test contradicts the model, but (.+) would not be seen and could change {wanted} "
        r"by ([\d.]+) ([^(]+) \(([\d.]+) σ\)",
        words,
    ).groups()
    assert float(sigmas) == pytest.approx(ratio, rel=0.05)
    assert by == text
    scale = {"mass": ("kg", 1), "centre": ("mm", 1e3), "v1": ("N s/m", 1)}
    assert (unit, float(named)) == (
        scale[wanted][0],
        pytest.approx(scale[wanted][1] * change, rel=0.05),
    )


def test_an_estimate_writes_what_the_contract_names(folder, expdesign, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    result = Answer(*expdesign(*arguments(folder)))
    assert result.status == 0, result.error
    names = {path.name for path in (folder / "out" / "figures").iterdir()}
    assert {"estimates.png", "correlation.svg", "residuals.png"} <= names
    assert "p10" in result.output
    assert len(result.output.splitlines()) <= 40
    (counted,) = re.findall(r"identified: (\d+) of 24", result.output)
    assert result.output.count("identified") == 1
    assert int(counted) == np.sum(_rows(folder).identified)
    table = pd.read_csv(folder / "out" / "estimates.csv")
    assert list(table.columns) == [
        "estimator",
        "parameter",
        "unit",
        "value",
        "std",
        "std_random",
        "std_systematic",
        "std_undetected",
        "ci_low",
        "ci_high",
        "rel_std_percent",
        "a_priori",
        "identified",
    ]
    assert list(table.estimator.unique()) == ["ls", "gm", "ml"]
    assert len(table) == 72
    assert np.all(np.isfinite(table.std_undetected) == (table.estimator == "ml"))
    assert np.all((table.ci_low < table.value) & (table.value < table.ci_high))
    record = json.loads((folder / "out" / "estimate.json").read_text())
    assert np.shape(record["estimators"]["ml"]["covariance"]) == (24, 24)
    assert record["recordings"][0]["period_source"] == "design"
    np.testing.assert_allclose(
        np.sqrt(np.diag(record["estimators"]["ml"]["covariance"])),
        table[table.estimator == "ml"]["std"],
    )
    columns = json.loads((folder / "out" / "columns.json").read_text())
    for file in columns["formats"]:
        header = pd.read_csv(folder / "out" / file, nrows=1).columns
        told = [c["name"] for c in columns[file] if not c["name"].startswith("<")]
        assert list(header)[: len(told)] == told
    manifest = json.loads((folder / "out" / "manifest.json").read_text())
    assert manifest["stages"]["estimate"]["status"] == "done"


@pytest.mark.slow
def test_estimates_do_not_depend_on_the_units_of_the_file(folder, command):
    command(*arguments(folder))
    lengths = [f"q{j}" for j in range(1, 7)]
    forces = [f"Q{j}" for j in range(1, 7)]

    def rescaled(table):
        table[lengths] *= 1e3
        table[forces] /= 1e3
        table["t"] *= 1e6
        return table[["t", *forces, *lengths]]

    write(folder / "other.csv", change=rescaled)
    (folder / "other.yaml").write_text(
        "name: lab\nrobot: palida\ndata: {units: {t: us, q: mm, Q: kN}}\n"
    )
    result = command(
        "estimate",
        str(folder / "other.yaml"),
        "--data",
        str(folder / "other.csv"),
        "--design",
        str(folder),
        "--out",
        str(folder / "out2"),
    )
    assert result.status == 0, result.error
    one, two = (pd.read_csv(folder / name / "estimates.csv") for name in ("out", "out2"))
    assert np.all(np.abs(one.value - two.value) < 1e-6 * one["std"])


def test_json(folder, command):
    result = command(*arguments(folder, "--json"))
    data = json.loads(result.output)
    assert data["status"] == 0
    assert data["best"] == "ml"
    assert set(data["estimates"]["p10"]) == {"value", "std", "unit"}


def test_the_folder_of_a_simulation_needs_no_options(folder, command):
    (folder / "twin.yaml").write_text(
        "name: lab\nrobot: palida\n"
        f"experiment: {{periods: 3, sampling: {1 / STEP} Hz}}\nestimate: {{estimators: [gm]}}\n"
    )
    run = str(folder / "twin.yaml")
    assert command("simulate", run, "--design", str(folder), "--out", str(folder)).status == 0
    assert command("estimate", run, "--out", str(folder)).status == 0
    assert (folder / "estimates.csv").is_file()


def test_several_recordings_are_combined(folder, command):
    write(folder / "second.csv", seed=1)
    one = command(*arguments(folder, "--json"))
    two = command(*arguments(folder, "--data", str(folder / "second.csv"), "--json"))
    assert two.status == 0, two.error
    first, both = (json.loads(each.output)["estimates"] for each in (one, two))
    ratio = [both[name]["std"] / first[name]["std"] for name in first]
    # Each standard deviation is of the noise as the recording shows it: chance is in both.
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1 / np.sqrt(2), rel=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.drop(columns="q3"), ["q3"]),
        (lambda t: t.assign(Q2=[*t.Q2[:7], np.nan, *t.Q2[8:]]), ["Q2", "9"]),
        (lambda t: t.assign(q1=["x", *t.q1[1:]]), ["q1", "2"]),
        (lambda t: t.drop(index=range(300, 600)), ["302"]),
        (lambda t: t.assign(q4=1000 * t.q4), ["q4", "mm"]),
        (lambda t: t.head(20), ["20"]),
    ],
    ids=["column", "nan", "text", "gap", "unit", "few"],
)
def test_defects_are_named_and_nothing_is_written(folder, command, change, words):
    write(folder / "recording.csv", change=change)
    result = command(*arguments(folder))
    assert result.status == 2
    for word in (*words, "recording.csv"):
        assert word in result.error
    assert "Traceback" not in result.error
    assert not (folder / "out").exists()


def test_a_recording_that_is_not_there(folder, command):
    result = command("estimate", str(folder / "run.yaml"), "--out", str(folder / "new"))
    assert result.status == 2
    assert "--data" in result.error
    assert not (folder / "new").exists()


def test_parameters_that_cannot_be_identified_end_with_1(folder, command):
    def still(table):
        columns = table.columns[1:]
        table[columns] = table[columns].iloc[0].to_numpy()
        rng = np.random.default_rng(0)
        table[columns] += rng.normal(size=(len(table), 12)) * ([1e-6] * 6 + [1.0] * 6)
        return table

    write(folder / "recording.csv", change=still)
    result = command(*arguments(folder))
    assert result.status in (1, 2)
    assert "Traceback" not in result.error


def test_wrong_channels_are_refused_with_the_section_that_is_right(command, folder):
    """One force negated and two exchanged, in a file in mm: `check --data` writes all of it."""

    def change(table):
        lengths = [f"q{j}" for j in range(1, 7)]
        table = table.rename(columns={"Q2": "Q5", "Q5": "Q2"})
        return table.assign(Q4=-table["Q4"], **{name: 1e3 * table[name] for name in lengths})

    write(folder / "wrong.csv", change=change)
    keys = {
        "order": {"Q": [1, 5, 3, 4, 2, 6]},
        "sign": {"Q": [1, 1, 1, -1, 1, 1]},
    }
    given = ("--data", folder / "wrong.csv", "--design", folder, "--json")
    checked = json.loads(command("check", folder / "run.yaml", *given).output)
    assert checked["channels"]["sure"]
    assert checked["data"] == {"file": "wrong.csv", "units": {"q": "mm"}, **keys}
    (folder / "run.yaml").write_text("name: lab\nrobot: palida\ndata: {units: {q: mm}}\n")
    given = (folder / "run.yaml", *given, "--out", folder / "out")
    refused = command("estimate", *given)
    assert refused.status == 2
    assert json.loads(refused.output)["data"] == {"units": {"q": "mm"}, **keys}
    data = json.dumps({"units": {"q": "mm"}, **keys})
    (folder / "run.yaml").write_text(f"name: lab\nrobot: palida\ndata: {data}\n")
    checked = json.loads(command("check", *given[:-2]).output)
    assert checked["channels"]["faults"] == []


LENGTHS, FORCES = ([f"{letter}{j}" for j in range(1, 7)] for letter in "qQ")


def permuted(table):
    """Return the forces in a random order of time: only their means are those of the machine."""
    shuffled = np.random.default_rng(0).permutation(table[FORCES].to_numpy())
    return table.assign(**dict(zip(FORCES, shuffled.T, strict=True)))


def test_forces_that_no_channels_explain(command, folder):
    write(folder / "wrong.csv", change=permuted)
    for name, unexplained in (("recording.csv", False), ("wrong.csv", True)):
        given = (folder / "run.yaml", "--data", folder / name, "--design", folder)
        found = json.loads(command("check", *given, "--json").output)
        assert found["channels"]["faults"] == []
        assert (found["channels"]["as_given"] < 0.1) == unexplained
        said = command("check", *given).error
        assert ("no channels explain the forces" in said) == unexplained
        assert ("the channels are those of the struts" in said) != unexplained
        assert ("a delay of less than" in said) != unexplained


ZEROS = 1e-3 * np.array([49.7, 20.2, 57.6, 33.5, 21.1, 44.6])


def from_zeros(table, shift=ZEROS):
    """Return lengths of a logger whose zeros are elsewhere than home."""
    robot = load_robot("palida")
    zeros = robot.inverse_kinematics(robot.home) + shift
    return table.assign(**{q: table[q] - zero for q, zero in zip(LENGTHS, zeros, strict=True)})


def precise(table):
    """Return the same motion with hardly any noise of the forces."""
    rng = np.random.default_rng(5)
    forces = load_robot("palida").actuator_forces(*MOTION.sample(table["t"].to_numpy()))
    forces += 0.3 * rng.standard_normal(forces.shape)
    return table.assign(**dict(zip(FORCES, forces.T, strict=True)))


def test_zeros_of_all_lengths_are_found_behind_a_lag(command, folder):
    """The lag hides what the zeros explain, and the zeros stated are a guess: home."""

    def late(table):
        table = precise(table)
        table[FORCES] = np.roll(table[FORCES].to_numpy(), 2, axis=0)
        return from_zeros(table)

    robot = load_robot("palida")
    write(folder / "wrong.csv", change=late)
    (folder / "run.yaml").write_text("name: lab\nrobot: palida\ndata: {offset: home}\n")
    given = ("check", folder / "run.yaml", "--data", folder / "wrong.csv", "--design", folder)
    found = json.loads(command(*given, "--json").output)
    assert found["channels"]["sure"]
    delay = float(found["data"]["delay"]["forces"].removesuffix(" ms"))
    assert delay == pytest.approx(2e3 * STEP, rel=0.05)
    zeros = [float(one.removesuffix(" mm")) for one in found["data"]["offset"]["q"]]
    right = 1e3 * (robot.inverse_kinematics(robot.home) + ZEROS)
    assert np.allclose(zeros, right, atol=1.0), zeros - right


def test_forces_that_are_unexplained_far_above_the_noise_do_not_prove_the_channels(command, folder):
    """Zeros of all lengths are wrong, and without the design no single one explains it."""

    (folder / "run.yaml").write_text("name: lab\nrobot: palida\ndata: {offset: home}\n")
    for zeros, wrong in ((0.0 * ZEROS, False), (ZEROS, True)):
        write(folder / "wrong.csv", change=lambda table: from_zeros(precise(table), zeros))  # noqa: B023
        said = command("check", folder / "run.yaml", "--data", folder / "wrong.csv").error
        assert ("the channels are those of the struts" in said) != wrong, said
        assert ("times the noise" in said) == wrong, said


@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_a_delay_is_found_from_the_size_on_that_a_sound_recording_states(command, folder, noise):
    def given(name, late):
        text = {"delay": {"forces": f"{-late} ms"}} if late else {}
        run = {"name": "lab", "robot": "palida", "data": text}
        (folder / "run.yaml").write_text(json.dumps(run))
        arguments = ("check", folder / "run.yaml", "--data", folder / name, "--design", folder)
        return command(*arguments), json.loads(command(*arguments, "--json").output)["channels"]

    def more_noise(table):
        size = 20 * (noise - 1) * np.random.default_rng(3).standard_normal((len(table), 6))
        return table.assign(**{f"Q{j}": table[f"Q{j}"] + size[:, j - 1] for j in range(1, 7)})

    write(folder / "recording.csv", change=more_noise)
    said = given("recording.csv", 0.0)[0].error
    least = float(re.search(r"a delay of less than ([\d.]+) ms, or a mean over", said)[1])
    assert least >= 3.7, "three quarters of a sample"
    for share, found in ((0.5, False), (1.25, True)):
        channels = given("recording.csv", share * least)[1]
        assert bool(channels["lag"] or channels["faults"]) == found, (share, least, channels)


def test_another_clock_belongs_into_the_section_and_stops_an_estimate(command, folder):
    """Before anything on the channels, which the folded periods of another length do not show."""
    write(folder / "late.csv", change=lambda table: table.assign(t=1.01 * table["t"]))
    stated = "name: lab\nrobot: palida\ndata: {file: late.csv}\n"
    (folder / "run.yaml").write_text(stated)
    given = (folder / "run.yaml", "--design", folder)
    run = ("--data", folder / "late.csv")
    said = command("check", *given, *run)
    assert said.output == "data:\n  file: late.csv\nestimate:\n  frequency: estimated\n"
    first = said.error.splitlines()[0]
    assert re.search(r"clocks of the recording and of the design differ by 0\.99\d* ± 0\.0", first)
    refused = command("estimate", *given, "--json", "--out", folder / "out")
    assert refused.status == 2
    right = json.loads(refused.output)
    assert (right["data"], right["estimate"]) == ({"file": "late.csv"}, {"frequency": "estimated"})
    (folder / "run.yaml").write_text(f"{stated}estimate: {{frequency: estimated}}\n")
    checked = command("check", *given, *run)
    assert "clocks" not in checked.error
    assert checked.output == "data:\n  file: late.csv\n"


def test_another_unit_than_that_of_the_file_is_a_scale(command, folder):
    def change(table):
        return table.assign(**(1e3 * table[LENGTHS])).rename(
            columns={name: f"{name} [m]" for name in LENGTHS}
        )

    write(folder / "wrong.csv", change=change)
    given = (folder / "run.yaml", "--data", folder / "wrong.csv", "--design", folder, "--json")
    data = json.loads(command("check", *given).output)["data"]
    assert data == {"file": "wrong.csv", "scale": {"q": 0.001}}
    text = json.dumps({"name": "lab", "robot": "palida", "data": data})
    (folder / "run.yaml").write_text(text)
    assert json.loads(command("check", *given).output)["channels"]["faults"] == []


def test_a_wrong_sign_of_the_first_length_is_no_scale(command, folder):
    write(folder / "wrong.csv", change=lambda table: table.assign(q1=-table["q1"]))
    given = (folder / "run.yaml", "--data", folder / "wrong.csv", "--design", folder, "--json")
    (fault,) = json.loads(command("check", *given).output)["channels"]["faults"]
    assert fault["place"] == "q1"


@pytest.mark.parametrize("factor", [0.25, 2.0])
def test_a_wrong_scale_of_all_lengths_is_found_by_the_design(command, folder, factor):
    """Such as 40 000 counts of a turn that has 10 000."""
    robot = load_robot("palida")
    home = robot.inverse_kinematics(robot.home)
    write(
        folder / "wrong.csv",
        change=lambda table: table.assign(**((table[LENGTHS] - home) * factor)),
    )
    run = {"name": "lab", "robot": "palida", "data": {"offset": "home"}}
    (folder / "run.yaml").write_text(json.dumps(run))
    given = (folder / "run.yaml", "--data", folder / "wrong.csv", "--design", folder, "--json")
    found = json.loads(command("check", *given).output)
    assert found["channels"]["sure"]
    assert found["data"]["scale"] == {"q": 1 / factor}
    run["data"] = found["data"]
    (folder / "run.yaml").write_text(json.dumps(run))
    assert json.loads(command("check", *given).output)["channels"]["faults"] == []


@pytest.mark.parametrize(
    ("offset", "words"), [(676, "would fit with 676 mm"), (-9, "out of this robot")]
)
def test_zeros_far_out_of_range_are_refused_before_anything_is_computed(
    command, folder, monkeypatch, offset, words
):
    def long(*_arguments, **_options):
        raise AssertionError("it would take minutes")

    monkeypatch.setattr("expdesign.stages.estimate.check_channels_of", long)
    home = load_robot("palida").description.struts_at(load_robot("palida").home).lengths
    write(
        folder / "zeros.csv", change=lambda table: table.assign(**(table[LENGTHS] - home.tolist()))
    )
    run = {"name": "lab", "robot": "palida", "data": {"offset": [offset] * 6}}
    (folder / "run.yaml").write_text(json.dumps(run))
    found = command("check", folder / "run.yaml", "--data", folder / "zeros.csv")
    assert found.status == 2
    assert words in found.error


def test_lengths_that_no_pose_has_refer_to_the_design(command, folder, monkeypatch):
    def no_pose(*_arguments, **_options):
        raise MotionFitError("no pose has the measured lengths")

    monkeypatch.setattr("expdesign.stages.estimate.prepare_recording", no_pose)
    given = ("check", folder / "run.yaml", "--data", folder / "recording.csv")
    found = command(*given)
    assert found.status == 1
    assert "file: recording.csv" in found.output
    for text in ("5 periods of 1 s", "--design DIR determines order and sign", "no pose has"):
        assert text in found.error
    found = json.loads(command(*given, "--json").output)
    assert found["data"] == {"file": "recording.csv"}
    assert found["message"] == "no pose has the measured lengths"


def test_all_zeros_that_may_be_wrong_are_named(command, folder):
    limit = load_robot("palida").description.limits["strut_length"]
    lower, upper = (float(one[0]) for one in limit.stated_bounds)
    stroke = upper - lower
    middle = pd.read_csv(folder / "recording.csv")[LENGTHS].median()
    write(folder / "zeros.csv", change=lambda table: table.assign(**(table[LENGTHS] - middle)))

    def problems(*middles):
        run = {"name": "lab", "robot": "palida", "data": {"offset": list(middles)}}
        (folder / "run.yaml").write_text(json.dumps(run))
        given = (folder / "run.yaml", "--data", folder / "zeros.csv", "--design", folder, "--json")
        result = command("check", *given)
        assert result.status == 2
        return [one["message"] for one in json.loads(result.output)["problems"]]

    outside, far = lower - 0.6 * stroke, lower - 1.5 * stroke
    found = problems(outside, outside, outside, far, far, far)
    assert [message.split()[:2] for message in found] == [["strut", f"{j}"] for j in range(1, 7)]
    found = problems(upper, outside, outside, far, far, far)
    assert len(found) == 5
    assert "zeros of possible lengths may be wrong as well: strut 1" in found[-1]


@pytest.mark.parametrize("constant", [False, True])
def test_a_failure_names_a_constant_channel_only_if_there_is_one(
    command, folder, monkeypatch, constant
):
    def fail(*_, **__):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr("estimation.identification.estimate", fail)
    if constant:
        write(folder / "recording.csv", change=lambda table: table.assign(Q3=1.0))
    failed = command(*arguments(folder))
    assert failed.status == 1
    words = " ".join(failed.error.split())
    assert ("constant channels: Q3" in words) == constant
    assert ("no channel is constant" in words) != constant
