"""The comparison of run folders: numbers against their definitions, and what is not compared."""

import csv
import io
import json
import re
import shutil
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from ruamel.yaml import YAML

from expdesign.configuration import InputError, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.experiment import DesignResult
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.plan import Prediction
from expdesign.runfolder.manifest import Manifest, entry, file_hash
from expdesign.stages.registry import reported_stages
from results.comparison.comparison import write_comparison
from results.comparison.designs import ComparedDesign, DesignComparison
from results.render.terminal import print_view
from tests.blank_figures import blank_figures
from tests.report.html import Page


@pytest.fixture
def rendered():
    """Let this test's figures be rendered."""


@pytest.fixture(autouse=True)
def _blank_figures(request):
    """The folders that are compared were made before, with figures that were rendered."""
    with nullcontext() if "rendered" in request.fixturenames else blank_figures():
        yield


@pytest.fixture
def twin(folder):
    """Return a second folder with half the noise in the forces' information."""
    other = folder.parent / "other"
    shutil.copytree(folder, other)
    return other


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def rewrite(path, edit):
    table = rows(path)
    for row in table:
        edit(row)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


def scale_by(factor, names=None):
    def edit(row):
        for name in names or list(row)[1:]:
            row[name] = repr(factor * float(row[name]))

    return edit


def double_information(folder, factor=2.0):
    rewrite(folder / "tables" / "information.csv", scale_by(factor))
    names = ("std_per_period", "std_experiment")
    rewrite(folder / "tables" / "parameters.csv", scale_by(factor**-0.5, names))


def change_robot(folder, edit):
    file = folder / "run.yaml"
    yaml = YAML(typ="safe")
    run = yaml.load(file.read_text(encoding="utf-8"))
    edit(run["robot"])
    with file.open("w", encoding="utf-8") as stream:
        yaml.dump(run, stream)


def change_design(folder, **settings):
    file = folder / "run.yaml"
    yaml = YAML(typ="safe")
    run = yaml.load(file.read_text(encoding="utf-8"))
    run.setdefault("design", {}).update(settings)
    with file.open("w", encoding="utf-8") as stream:
        yaml.dump(run, stream)


def change(path, edit):
    document = json.loads(path.read_text(encoding="utf-8"))
    edit(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def vouch_for(folder):
    """Let the manifest hold a folder's files as they are, as if its stages had written them."""
    manifest = Manifest.read(folder)
    stages = {name: replace(one, made_from={}) for name, one in manifest.stages.items()}
    files = [*folder.glob("design.json"), *folder.glob("tables/*.csv")]
    design = entry("done", "", 0.0, "", folder, files)
    written = [path for path in folder.rglob("*") if path.is_file()]
    run_file = file_hash(folder / "run.yaml")
    made = replace(manifest, stages=stages | {"design": design}, run_file=run_file)
    made.with_files(folder, written).write(folder)


def compare(folders, out, *, vouched=True, **options):
    given = {"precision": 0.05, "quick": True} | options
    for folder in folders if vouched else ():
        if (folder / "manifest.json").is_file():
            vouch_for(folder)
    write_comparison(folders, out, reported_stages(), **given)
    return (out / "report.html").read_text(encoding="utf-8")


def information(folder):
    table = rows(folder / "tables" / "information.csv")
    return np.array([[float(cell) for cell in list(row.values())[1:]] for row in table])


def test_criteria_by_their_definitions(folder, twin, tmp_path):
    double_information(twin)
    compare([folder, twin], tmp_path / "out")
    one, two = rows(tmp_path / "out" / "tables" / "criteria.csv")
    design = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    assert float(one["log det F"]) == pytest.approx(design["log_det_information"], rel=1e-9)
    m = len(design["parameters"])
    assert float(two["log det F"]) - float(one["log det F"]) == pytest.approx(m * np.log(2))
    assert float(one["D-efficiency [%]"]) == pytest.approx(50)
    assert float(two["D-efficiency [%]"]) == pytest.approx(100)
    F = information(folder)
    scale = 1 / np.sqrt(np.diag(F))
    inverse = np.linalg.inv(F * np.outer(scale, scale)) * np.outer(scale, scale)
    assert float(one["trace F⁻¹, SI"]) == pytest.approx(np.trace(inverse), rel=1e-6)
    smallest = 1 / np.linalg.eigvalsh(inverse)[-1]
    assert float(one["smallest eigenvalue, SI"]) == pytest.approx(smallest, rel=1e-6)
    largest = np.linalg.eigvalsh(F)[-1]
    assert float(one["condition, SI"]) == pytest.approx(largest / smallest, rel=1e-6)
    assert float(two["condition, nominal"]) == pytest.approx(
        float(one["condition, nominal"]), rel=1e-6
    )


def test_each_symbol_has_its_meaning_on_the_screen_and_in_the_page(folder, twin, tmp_path):
    for path in (folder, twin):
        vouch_for(path)
    out = tmp_path / "out"
    _, views = write_comparison([folder, twin], out, reported_stages(), precision=0.05, quick=True)
    page = (out / "report.html").read_text(encoding="utf-8")
    titles = {view.verdict.title: view for view in views}
    for view in (titles["Designs"], titles["Estimates"]):
        console = Console(file=io.StringIO(), width=100)
        print_view(view, console)
        screen = " ".join(console.file.getvalue().split())
        assert "p10: mass of the platform and the six sliders; " in screen
        assert "r1 … r6/v1 … v6: dry/viscous friction of the actuators." in screen
    # The third is that of the Monte-Carlo studies.
    assert page.count("p4: first moment of a stator: mass times its centre") == 3


def test_changed_designs_and_estimates_make_no_claim(folder, twin, tmp_path):
    for each in (folder, twin):
        vouch_for(each)
    sound = compare([folder, twin], tmp_path / "sound", vouched=False)
    assert "has the largest log det F" in sound
    double_information(twin)
    with (twin / "estimates.csv").open("a", encoding="utf-8") as file:
        file.write("\n")
    page = compare([folder, twin], tmp_path / "out", vouched=False)
    assert "has the largest log det F" not in page
    shares = [row["D-efficiency [%]"] for row in rows(tmp_path / "out" / "tables" / "criteria.csv")]
    assert shares == ["", ""]
    effort = rows(tmp_path / "out" / "tables" / "effort.csv")
    assert [row["status"] == "changed" for row in effort] == [False, True]
    assert "not tested. Changed: other." in page


def test_a_design_that_was_made_by_hand_is_changed(folder, twin, tmp_path):
    page = compare([folder, twin], tmp_path / "out", vouched=False)
    effort = rows(tmp_path / "out" / "tables" / "effort.csv")
    assert [row["status"] for row in effort] == ["changed", "changed"]
    assert "has the largest log det F" not in page


def test_precision_and_the_periods_that_it_needs(folder, twin, tmp_path):
    double_information(twin)
    compare([folder, twin], tmp_path / "out", precision=0.02)
    design = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    samples = design["predicted_std"]["experiment"]["samples"]
    # What the design states for its experiment, whose samples are more than those of its period.
    std = [float(row["std_experiment"]) for row in rows(folder / "tables" / "parameters.csv")]
    for k, row in enumerate(rows(tmp_path / "out" / "tables" / "compared_parameters.csv")):
        nominal = abs(float(row["nominal"]))
        share = float(row["σ, tiny [%]"]) / 100
        assert share == pytest.approx(std[k] / nominal, rel=1e-6)
        assert share == pytest.approx(np.sqrt(2) * float(row["σ, other [%]"]) / 100, rel=1e-6)
        per_period = share * np.sqrt(samples / (design["period"] * 100))
        needed = float(row["periods, tiny"])
        assert per_period / np.sqrt(needed) <= 0.02 * (1 + 1e-6)
        assert needed == 1 or per_period / np.sqrt(needed - 1) > 0.02 * (1 - 1e-6)


def test_precision_is_relative_to_each_robots_own_values(folder, twin, tmp_path):
    def edit(row):
        if row["parameter"] == "p1":
            scale_by(0.1, ["nominal"])(row)

    rewrite(twin / "tables" / "parameters.csv", edit)
    change_robot(twin, lambda robot: robot["parameters"].update(p1=0.0005))
    text = compare([folder, twin], tmp_path / "out")
    first, second, *_ = rows(tmp_path / "out" / "tables" / "compared_parameters.csv")
    assert float(first["nominal, other"]) == pytest.approx(0.1 * float(first["nominal, tiny"]))
    assert float(first["σ, other [%]"]) == pytest.approx(10 * float(first["σ, tiny [%]"]))
    assert float(first["periods, other"]) == pytest.approx(
        100 * float(first["periods, tiny"]), rel=0.01
    )
    assert second["σ, other [%]"] == second["σ, tiny [%]"]
    effort = rows(tmp_path / "out" / "tables" / "effort.csv")
    # What neither design tells half of is not waited for.
    told = [
        row
        for row in rows(tmp_path / "out" / "tables" / "compared_parameters.csv")
        if min(float(row["σ, tiny [%]"]), float(row["σ, other [%]"])) <= 50
    ]
    assert first not in told
    most = max(told, key=lambda row: float(row["periods, other"]))
    assert float(effort[1]["periods, all parameters"]) == float(most["periods, other"])
    assert effort[1]["decided by"] == most["parameter"]
    one, two = rows(tmp_path / "out" / "tables" / "criteria.csv")
    assert one["trace F⁻¹, SI"] == two["trace F⁻¹, SI"]
    assert float(two["trace F⁻¹, nominal"]) > 2 * float(one["trace F⁻¹, nominal"])
    # F does not depend on the values: the same machine.
    assert one["D-efficiency [%]"] == two["D-efficiency [%]"] == "100.0"
    assert "other has other nominal values than tiny: its precision is relative to its own" in text


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda robot: robot.update(gravity=[0.0, 0.0, 9.81]), "other gravity"),
        (
            lambda robot: robot["noise"].update(force_std=[3.0] * 6),
            "other noise of the forces",
        ),
        (
            lambda robot: robot["noise"].update(force_spectrum={"ar": 0.5}),
            "other spectrum of the force noise",
        ),
        (
            lambda robot: robot["base_joints"][0].__setitem__(0, 0.45),
            "other joints of the base",
        ),
    ],
)
def test_different_robots_have_no_efficiency(folder, twin, tmp_path, edit, words):
    double_information(twin)
    change_robot(twin, edit)
    third = folder.parent / "third"
    shutil.copytree(folder, third)
    double_information(third, 0.5)
    text = compare([folder, twin, third], tmp_path / "out")
    found = rows(tmp_path / "out" / "tables" / "criteria.csv")
    shares = [row["D-efficiency [%]"] for row in found]
    assert (shares[0], shares[1]) == ("100.0", "")
    assert float(shares[2]) == pytest.approx(50)
    assert words in text
    largest = r"tiny has the largest log det F of tiny and third; third has 50(\.0)? % of its"
    assert re.search(largest, text)
    assert "other has the largest" not in text
    assert not re.search(r"other has [\d.]+ % of its information", text)
    assert "for 2 different robots" in text
    assert "empty where no other design is of it" in text


def on_screws(thread):
    def edit(robot):
        robot["terms"].remove("passive_friction")
        robot["parameters"] = {k: v for k, v in robot["parameters"].items() if k[:2] != "r_"}
        robot["drive"] = {"screw": {"lead": "5 mm", "thread": thread}}
        robot["platform_cardan_axes"] = np.add(robot["alpha_axes"], [0.1, 0, 0.2]).tolist()

    return edit


def with_cogging(pitch):
    return lambda robot: robot["terms"].append({"cogging": {"pitch": pitch}})


@pytest.mark.parametrize(
    ("edits", "machines"),
    [
        ((with_cogging("30 mm"), with_cogging("20 mm")), 2),
        ((with_cogging("30 mm"), with_cogging("30 mm")), 1),
        ((on_screws("right"), on_screws("left")), 2),
        ((on_screws("left"), on_screws("left")), 1),
    ],
)
def test_constants_of_terms_and_threads_make_another_robot(edits, machines):
    """The forces of the parameters depend on them, and so does F."""
    palida = load_robot_description("palida").description
    designs = []
    for edit in edits:
        robot = palida.model_dump(mode="json", by_alias=True, exclude_none=True)
        edit(robot)
        result = SimpleNamespace(configuration=load_run({"name": "n", "robot": robot}))
        designs.append(ComparedDesign("a design", result))
    assert DesignComparison(tuple(designs), 0.01).machine_count == machines


def test_limits_home_and_names_make_no_other_robot(folder, twin, tmp_path):
    double_information(twin)

    def edit(robot):
        robot["limits"]["strut_speed"] = 2 * float(robot["limits"]["strut_speed"])
        robot["name"] = "another"

    change_robot(twin, edit)
    text = compare([folder, twin], tmp_path / "out")
    one, two = rows(tmp_path / "out" / "tables" / "criteria.csv")
    assert float(one["D-efficiency [%]"]) == pytest.approx(50)
    assert float(two["D-efficiency [%]"]) == pytest.approx(100)
    assert "in what counts the same" in text
    assert "different robots" not in text


def test_a_prior_is_no_information_of_a_motion(folder, twin, tmp_path):
    double_information(twin)
    prior = shutil.copy(folder / "identified-robot.yaml", tmp_path / "prior.yaml")
    change_design(twin, prior=str(prior))
    text = compare([folder, twin], tmp_path / "out")
    found = rows(tmp_path / "out" / "tables" / "criteria.csv")
    assert [row["D-efficiency [%]"] for row in found] == ["", ""]
    assert "other differs from tiny in its earlier recordings (design.prior)" in text
    assert "has the largest" not in text
    design = DesignResult.read(twin)
    configuration = load_run(twin / "run.yaml")
    prediction = Prediction.of(configuration, design.trajectory)
    samples = design.experiment.samples
    rate = configuration.run.experiment.sampling * design.trajectory.period
    count = len(design.parameter_names)

    def shares(periods):
        return prediction.errors(periods).std[-count:] / np.abs(design.robot.parameters)

    for k, row in enumerate(rows(tmp_path / "out" / "tables" / "compared_parameters.csv")):
        assert float(row["σ, other [%]"]) == pytest.approx(100 * shares(samples / rate)[k])
        needed = float(row["periods, other"])
        assert shares(needed)[k] <= 0.05
        assert needed == 0 or shares(needed - 1)[k] > 0.05
    # With the same prior they are compared with it.
    change_design(folder, prior=str(prior))
    text = compare([folder, twin], tmp_path / "both")
    found = rows(tmp_path / "both" / "tables" / "criteria.csv")
    assert float(found[0]["D-efficiency [%]"]) == pytest.approx(50)
    assert "other has the largest log det S" in text
    change_design(folder, others=[str(twin)])
    text = compare([folder, twin], tmp_path / "motions")
    assert "(design.others)" in text
    assert "has the largest" not in text


def test_other_parameters_are_not_compared(folder, twin, tmp_path):
    design = twin / "design.json"
    change(design, lambda document: document["parameters"].pop())
    for name, columns in (("information", -1), ("parameters", None), ("eigenvalues", None)):
        path = twin / "tables" / f"{name}.csv"
        table = rows(path)[:-1]
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(table[0])[:columns], extrasaction="ignore")
            writer.writeheader()
            writer.writerows(table)
    text = compare([folder, twin], tmp_path / "out")
    assert "judge different parameters" in text
    assert not (tmp_path / "out" / "tables" / "criteria.csv").exists()
    assert (tmp_path / "out" / "tables" / "compared_limits.csv").exists()


def test_estimates_of_the_same_data_are_not_tested(folder, twin, tmp_path):
    text = compare([folder, twin], tmp_path / "out")
    assert "Both come from the same data" in text
    assert not list((tmp_path / "out" / "tables").glob("difference_*"))


def test_estimates_of_the_same_noise_are_not_tested(folder, twin, tmp_path):
    (twin / "measurement.csv").write_text("other\n", encoding="utf-8")
    change(twin / "estimate.json", _measured_by_itself(twin))
    assert "the same seed" in compare([folder, twin], tmp_path / "out")


def _measured_by_itself(place):
    def edit(document):
        document["recordings"][0]["source"] = str(place / "measurement.csv")
        document["recordings"][0]["fingerprint"] = "other"

    return edit


@pytest.fixture
def independent(twin):
    (twin / "measurement.csv").write_text("other\n", encoding="utf-8")
    change(twin / "truth.json", lambda document: document["seeds"].update(repetitions=99))
    change(twin / "estimate.json", _measured_by_itself(twin))
    return twin


def test_an_estimate_and_its_prior_are_not_independent(folder, independent, tmp_path):
    first = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    (fingerprint,) = (one["fingerprint"] for one in first["recordings"])
    change(
        independent / "estimate.json",
        lambda document: document.update(prior_recordings=[fingerprint]),
    )
    assert "in common by their priors" in compare([folder, independent], tmp_path / "out")
    assert not list((tmp_path / "out" / "tables").glob("difference_*"))


def test_a_difference_is_found(folder, independent, tmp_path):
    def shift(document):
        entry = document["estimators"]["ml"]
        k = document["parameters"].index("r3")
        entry["values"]["r3"] += 12 * entry["covariance"][k][k] ** 0.5

    text = compare([folder, independent], tmp_path / "first")
    assert "0 of 1 independent pair differ" in Page(text).text
    change(independent / "estimate.json", shift)
    text = compare([folder, independent], tmp_path / "out")
    assert "1 of 1 independent pair differ" in Page(text).text
    found = {row["parameter"]: row for row in rows(tmp_path / "out/tables/difference_1.csv")}
    assert float(found["r3"]["z"]) == pytest.approx(12 / np.sqrt(2))
    assert [name for name, row in found.items() if row["outcome"] == "differs"] == ["r3"]


def test_the_information_matrix_is_judged(folder, twin, tmp_path):
    text = Page(compare([folder, twin], tmp_path / "out")).text
    untested = "Bias of GM from errors of the measured motion is not tested"
    assert text.count(untested) == 2

    def disturb(document):
        gm, ml = (document["estimators"][name] for name in ("gm", "ml"))
        k = document["parameters"].index("p10")
        gm["values"]["p10"] = ml["values"]["p10"] + ml["covariance"][k][k] ** 0.5

    change(twin / "estimate.json", disturb)
    text = Page(compare([folder, twin], tmp_path / "out")).text
    assert text.count(untested) == 1
    assert text.count("Hausman") == 1


def test_studies_are_set_beside_their_bounds(folder, twin, tmp_path):
    compare([folder, twin], tmp_path / "out")
    table = {row["parameter"]: row for row in rows(folder / "tables" / "montecarlo.csv")}
    achieved = rows(tmp_path / "out" / "tables" / "achieved.csv")
    assert {row["parameter"] for row in achieved} == set(table)
    for row in achieved:
        for name in ("tiny", "other"):
            assert row[f"LS, {name}"] == table[row["parameter"]]["spread"]
            assert row[f"bound, {name}"] == table[row["parameter"]]["bound"]


def test_names_of_folders_are_told_apart_and_harmless(folder, tmp_path, rendered):
    hostile = tmp_path / "b" / "<script>alert(1)<" / "tiny"
    hostile.parent.mkdir(parents=True)
    shutil.copytree(folder, hostile)
    text = compare([folder, hostile], tmp_path / "out")
    assert "<script>alert" not in text
    assert "<script>alert(1)</tiny" in Page(text).text
    for figure in (tmp_path / "out" / "figures").glob("*.svg"):
        assert "<script" not in figure.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_same_folders_give_the_same_bytes(folder, twin, tmp_path, rendered):
    def written(name):
        compare([folder, twin], tmp_path / name)
        place = tmp_path / name
        return {p.relative_to(place): p.read_bytes() for p in place.rglob("*") if p.is_file()}

    assert written("one") == written("two")


def test_what_limits_cost_is_part_of_it(folder, twin, tmp_path):
    text = compare([folder, twin], tmp_path / "out", quick=False)
    table = {row["limit"]: row for row in rows(tmp_path / "out" / "tables" / "limit_gains.csv")}
    assert "base frequency" in table
    left = float(table["unexplained by the limits"]["tiny [%]"])
    assert 0 <= left <= 100
    # A design that was stopped early is near no optimum, and nothing is claimed of it.
    if left > 10:
        assert table["actuator force"]["tiny [%]"] == ""
        assert "not near an optimum" in text


def test_what_cannot_be_compared(folder, twin, tmp_path, expdesign_says):
    for folders, reason in (
        ([folder], "two run folders"),
        ([folder, folder], "named twice"),
        ([folder, tmp_path], "not a run folder"),
    ):
        with pytest.raises(InputError, match=reason):
            compare(folders, tmp_path / "out")
    with pytest.raises(InputError, match="overwrite"):
        compare([folder, twin], twin)
    for stage in ("design", "estimate", "montecarlo", "validation"):
        (twin / f"{stage}.json").unlink()
    with pytest.raises(InputError, match="no result that can be compared"):
        compare([folder, twin], tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["0", "-1%", "200 %", "one", "nan", "inf", ""])
def test_precisions_that_are_none(folder, twin, tmp_path, text, expdesign_says):
    _, _, error = expdesign_says(
        "compare", folder, twin, "--out", tmp_path / "out", f"--precision={text}"
    )
    assert isinstance(error, InputError)
    assert error.problems[0].key == "--precision"


def test_comparison_by_command(folder, twin, tmp_path, expdesign_says):
    status, output, error = expdesign_says(
        "compare", folder, twin, "--out", tmp_path / "out", "--quick", "--precision", "1%", "--json"
    )
    assert status == 0, (output, error)
    assert "report.html" in json.loads(output)["files"]
    effort = (tmp_path / "out" / "tables" / "effort.tex").read_text(encoding="utf-8")
    assert re.search(r"\\toprule", effort)
    assert "σ = 1 %" in effort


def test_how_long_a_search_took_is_in_no_table(folder, twin, tmp_path):
    text = compare([folder, twin], tmp_path / "out")
    tables = {path.name: path.read_bytes() for path in (tmp_path / "out" / "tables").iterdir()}

    def slower(document):
        document["solver"]["seconds"] = 7200.0

    change(twin / "design.json", slower)
    later = compare([folder, twin], tmp_path / "out")
    assert tables == {
        path.name: path.read_bytes() for path in (tmp_path / "out" / "tables").iterdir()
    }
    assert "2 h 0 min" not in text
    assert "other: 2 h 0 min" in later


def test_designs_for_other_ends_are_compared_by_their_predicted_errors(folder, twin, tmp_path):
    """Both motions are judged with the tolerances that one of the designs counts."""
    tolerances = {"force_constant": {"common": 0.05}}
    change_robot(twin, lambda robot: robot.update(tolerances=tolerances))
    names = json.loads((twin / "design.json").read_text(encoding="utf-8"))["parameters"]
    change(
        twin / "design.json",
        lambda design: design["predicted_std"].update(systematic=dict.fromkeys(names, 1e-3)),
    )
    faster = 2 * DesignResult.read(twin).trajectory.omega  # by the same speeds: smaller
    change(twin / "design.json", lambda design: design.update(omega=faster))
    text = _text(compare([folder, twin], tmp_path / "totals"))
    smallest = "tiny has the smallest predicted σ of all parameters with the tolerances of other"
    worse = re.search(f"{smallest}; other has ([0-9]+) % of them", text)
    assert int(worse[1]) > 100
    assert "log det F" not in text.partition("Criteria of every design")[0]
    for one in (folder, twin):
        change_design(one, interest=["mass"])
    text = _text(compare([folder, twin], tmp_path / "mass"))
    assert "the smallest predicted σ of mass with the tolerances of other; " in text
    change_design(folder, interest=["mass", "p6"])
    text = _text(compare([folder, twin], tmp_path / "others"))
    assert "smallest predicted σ of mass and p6 with" in text
    assert "smallest predicted σ of mass with" in text


@pytest.mark.parametrize(
    ("criterion", "scaling", "name"), [("a", "nominal", "rms"), ("e", "si", "largest")]
)
def test_designs_are_compared_by_the_summary_of_their_criterion(
    folder, twin, tmp_path, criterion, scaling, name
):
    faster = 2 * DesignResult.read(twin).trajectory.omega
    change(twin / "design.json", lambda design: design.update(omega=faster))
    for one in (folder, twin):
        change_design(one, criterion=criterion, scaling=scaling)
    text = _text(compare([folder, twin], tmp_path / "out"))
    found = re.search(rf"all parameters \({name}\); \w+ has ([0-9]+) % of them", text)
    configuration = DesignResult.read(folder).configuration
    evaluator = noise_evaluator(configuration)
    scales = evaluator.robot.scales if scaling == "nominal" else 1.0
    summaries = []
    for one in (folder, twin):
        motion = DesignResult.read(one).trajectory
        prediction = Prediction.of(configuration, motion)
        std = prediction.errors(1e5 / prediction.samples).std[-len(evaluator.names) :] / scales
        summaries.append(np.max(std) if criterion == "e" else np.sqrt(np.mean(std**2)))
    assert int(found[1]) == pytest.approx(100 * max(summaries) / min(summaries), rel=0.02)


def _text(page):
    return " ".join(re.sub(r"<[^>]*>", " ", page).split())
