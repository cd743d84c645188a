"""Files of one run folder that contradict each other: refused at the row or key, by each record."""

import json

import pytest

from estimation.identification.result import EstimationResult
from estimation.montecarlo.result import MonteCarloResult
from estimation.twin.truth import Truth
from estimation.validation.validate import ValidationResult
from expdesign.cli.app import app, run
from expdesign.configuration import InputError
from expdesign.experiment import DesignResult

TABLES = (
    (DesignResult, "tables/limits.csv", "limit"),
    (DesignResult, "tables/parameters.csv", "parameter"),
    (DesignResult, "tables/eigenvalues.csv", "index"),
    (EstimationResult, "estimates.csv", "parameter"),
    (MonteCarloResult, "tables/montecarlo.csv", "parameter"),
    (ValidationResult, "tables/validation.csv", "actuator"),
)


def _problem(record, folder):
    with pytest.raises(InputError) as caught:
        record.read(folder)
    return caught.value.problems[0]


def _change_lines(path, change):
    lines = path.read_text(encoding="utf-8").splitlines()
    change(lines)
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def _change(path, *place, to):
    data = json.loads(path.read_text(encoding="utf-8"))
    holder = data
    *inside, key = place
    for each in inside:
        holder = holder[each]
    holder[key] = to(holder[key])
    path.write_text(json.dumps(data), encoding="utf-8")


def _swap(lines):
    lines[2], lines[3] = lines[3], lines[2]


@pytest.mark.parametrize(("record", "file", "column"), TABLES)
@pytest.mark.parametrize(
    "change", [lambda lines: lines.pop(2), lambda lines: lines.insert(2, lines[1]), _swap]
)
def test_another_row_is_told_by_line_and_column(record, file, column, change, folder):
    _change_lines(folder / file, change)
    problem = _problem(record, folder)
    assert (problem.file, problem.line, problem.key) == (folder / file, 3, f"column {column}")
    assert problem.allowed


@pytest.mark.parametrize(("record", "file"), [each[:2] for each in TABLES])
def test_rows_that_are_missing_at_the_end_are_told_there(record, file, folder):
    lines = (folder / file).read_text(encoding="utf-8").splitlines()
    _change_lines(folder / file, lambda found: found.pop())
    problem = _problem(record, folder)
    assert (problem.file, problem.line) == (folder / file, len(lines))
    assert str(len(lines) - 1) in problem.allowed


@pytest.mark.parametrize(("record", "file"), [each[:2] for each in TABLES])
def test_rows_beyond_the_last_are_told_there(record, file, folder):
    lines = (folder / file).read_text(encoding="utf-8").splitlines()
    _change_lines(folder / file, lambda found: found.append(found[-1]))
    problem = _problem(record, folder)
    assert (problem.file, problem.line) == (folder / file, len(lines) + 1)
    assert str(len(lines) - 1) in problem.allowed


def _shorter(entries):
    return entries[:-1]


ESTIMATE, MONTECARLO = "estimate.json", "montecarlo.json"


@pytest.mark.parametrize(
    ("record", "file", "place", "key"),
    [
        (EstimationResult, ESTIMATE, ("estimators", "gm", "covariance"), None),
        (EstimationResult, ESTIMATE, ("estimators", "ml", "covariance_forces"), None),
        (EstimationResult, ESTIMATE, ("cramer_rao_covariance",), None),
        (EstimationResult, ESTIMATE, ("diagnostics", "experiments"), None),
        (MonteCarloResult, MONTECARLO, ("bound_covariance",), None),
        (Truth, "truth.json", ("force_covariance",), None),
        (Truth, "truth.json", ("length_covariance",), None),
        (
            EstimationResult,
            ESTIMATE,
            ("recordings", 0, "noise", "force_covariance"),
            "recordings[1].noise.force_covariance",
        ),
        (
            ValidationResult,
            "validation.json",
            ("motions", 0, "diagnostics", "experiments"),
            "motions[1].diagnostics.experiments",
        ),
        (
            ValidationResult,
            "validation.json",
            ("motions", 0, "diagnostics", "experiments", 0, "lack_of_fit", "f"),
            "motions[1].diagnostics.experiments[1].lack_of_fit.f",
        ),
    ],
)
def test_another_number_of_entries_is_told_by_its_key(record, file, place, key, folder):
    _change(folder / file, *place, to=_shorter)
    problem = _problem(record, folder)
    assert (problem.file, problem.key) == (folder / file, key or ".".join(place))


@pytest.mark.parametrize(
    ("record", "file", "place"),
    [
        (EstimationResult, ESTIMATE, ("best",)),
        (EstimationResult, ESTIMATE, ("fixed",)),
        (MonteCarloResult, MONTECARLO, ("parameters",)),
        (MonteCarloResult, MONTECARLO, ("identified",)),
    ],
)
def test_an_unknown_name_is_told_by_its_key(record, file, place, folder):
    data = json.loads((folder / file).read_text(encoding="utf-8"))
    unknown = "nobody" if isinstance(data[place[0]], str) else ["nobody"]
    _change(folder / file, *place, to=lambda _: unknown)
    problem = _problem(record, folder)
    assert (problem.file, problem.key) == (folder / file, place[0])
    assert "nobody" in problem.message


@pytest.mark.parametrize(
    ("record", "file", "place", "key"),
    [
        (Truth, "truth.json", ("force_covariance", 2, 2), "force_covariance"),
        (
            EstimationResult,
            ESTIMATE,
            ("estimators", "ml", "covariance", 2, 2),
            "estimators.ml.covariance[3][3]",
        ),
    ],
)
def test_a_negative_variance_is_told_by_its_key(record, file, place, key, folder):
    _change(folder / file, *place, to=lambda variance: -variance)
    problem = _problem(record, folder)
    assert (problem.file, problem.key) == (folder / file, key)


def test_a_value_that_is_missing_is_told_by_its_key(folder):
    path = folder / ESTIMATE
    _change(path, "estimators", "gm", "values", to=lambda values: dict([*values.items()][1:]))
    problem = _problem(EstimationResult, folder)
    assert (problem.file, problem.key) == (path, "estimators.gm.values")
    assert "p1" in problem.message


def test_a_json_file_with_fewer_parameters_than_its_table_is_no_match(folder):
    for place in ("parameters", "identified"):
        _change(folder / MONTECARLO, place, to=_shorter)
    problem = _problem(MonteCarloResult, folder)
    assert problem.file == folder / "tables/montecarlo.csv"


@pytest.mark.parametrize("file", ["estimates.csv", "truth.json"])
def test_a_report_of_them_ends_in_words(file, folder, capsys):
    (folder / "report.html").unlink()
    if file == "truth.json":
        _change(folder / file, "length_covariance", to=_shorter)
    else:
        _change_lines(folder / file, lambda lines: lines.pop(40))
    assert run(app, ["report", str(folder)]) == 2
    assert file in capsys.readouterr().err
    assert not (folder / "report.html").exists()


def test_a_folder_of_an_earlier_version_is_refused_in_one_sentence(folder, capsys):
    path = folder / "design.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["format"]
    path.write_text(json.dumps(data), encoding="utf-8")
    assert run(app, ["report", str(folder)]) == 2
    assert "made by an earlier version; run it again" in " ".join(capsys.readouterr().err.split())
