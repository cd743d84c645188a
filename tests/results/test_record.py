import json
import pickle

import numpy as np
import pytest

from expdesign.configuration import InputError
from results import DesignRecord, MissingFileError, RunFolderError, design_figures

FILES = [
    "run.yaml",
    "design.json",
    "trajectory.csv",
    "tables/convergence.csv",
    "tables/limits.csv",
    "tables/parameters.csv",
    "tables/eigenvalues.csv",
]


def edit(path, function):
    path.write_text(function(path.read_text(encoding="utf-8")), encoding="utf-8")


def edit_json(path, **changes):
    edit(path, lambda text: json.dumps(json.loads(text) | changes))


def test_record_holds_what_the_files_say(run):
    record = DesignRecord.load(run.folder)
    assert record.robot.name == "palida"
    assert record.summary.criterion_value == 97.25
    assert record.summary.best_start == 1
    assert record.summary.warnings == ("made up",)
    np.testing.assert_array_equal(record.summary.mu, run.trajectory.mu)
    np.testing.assert_array_equal(record.motion.time, run.numbers("trajectory.csv", "t")[:, 0])
    np.testing.assert_array_equal(
        record.motion.force, run.numbers("trajectory.csv", *(f"Q{j}" for j in range(1, 7)))
    )
    assert record.motion.period == pytest.approx(run.trajectory.period, rel=1e-12)
    assert [trace.kind for trace in record.traces] == ["random", "random", "hop"]
    assert [trace.is_hop for trace in record.traces] == [False, False, True]
    assert [check.key for check in record.checks][:2] == ["actuator_force", "tilt"]
    assert record.checks[1].row == ""
    assert record.precision.names == record.robot.parameter_names
    np.testing.assert_array_equal(record.precision.nominal, record.robot.parameters)
    assert record.spectrum.nominal is not None


def test_home_joints_are_where_the_inverse_kinematics_says(run):
    record = DesignRecord.load(run.folder)
    lengths = np.linalg.norm(record.home_joints() - record.robot.geometry.base_joints, axis=1)
    np.testing.assert_allclose(lengths, record.robot.inverse_kinematics(record.robot.home))


@pytest.mark.parametrize("name", FILES)
def test_missing_file_is_named(run, name):
    (run.folder / name).unlink()
    with pytest.raises(MissingFileError, match="missing") as caught:
        design_figures(run.folder)
    assert caught.value.path == run.folder / name
    assert isinstance(caught.value, RunFolderError)
    assert not (run.folder / "figures").exists()


def test_errors_survive_pickling(tmp_path):
    for error in (MissingFileError(tmp_path), RunFolderError(tmp_path, "wrong")):
        copy = pickle.loads(pickle.dumps(error))
        assert (type(copy), copy.path, str(copy)) == (type(error), tmp_path, str(error))


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".csv")])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a,b\n1,2\n"])
def test_file_that_is_no_such_table(run, name, content):
    (run.folder / name).write_bytes(content)
    with pytest.raises(RunFolderError) as caught:
        DesignRecord.load(run.folder)
    assert caught.value.path == run.folder / name


def test_cell_that_is_no_number_is_told_with_its_line(run):
    path = run.folder / "tables/eigenvalues.csv"
    lines = path.read_text().splitlines()
    lines[3] = "3,many,1"
    path.write_text("\n".join(lines))
    with pytest.raises(RunFolderError, match=r"line 4, column eigenvalue: .* not 'many'"):
        DesignRecord.load(run.folder)


@pytest.mark.parametrize("cell", ["", "nan", "inf"])
def test_motion_must_be_finite(run, cell):
    path = run.folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    lines[2] = ",".join([*lines[2].split(",")[:-1], cell])
    path.write_text("\n".join(lines))
    with pytest.raises(RunFolderError, match="line 3, column Q6"):
        DesignRecord.load(run.folder)


def test_time_must_increase(run):
    path = run.folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]))
    with pytest.raises(RunFolderError, match="increasing times"):
        DesignRecord.load(run.folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"omega": "fast"}, "omega: expected a finite number, not 'fast'"),
        ({"omega": None}, "omega: expected a finite number"),
        ({"harmonics": 2.0}, "harmonics: expected a whole number"),
        ({"harmonics": 3}, "mu: expected 6 × 3 finite numbers"),
        ({"lambda0": [1, 2]}, "lambda0: expected 6 finite numbers"),
        ({"criterion": 1}, "criterion: expected a text"),
        ({"predicted_std": []}, "predicted_std: expected a mapping"),
        ({"predicted_std": {}}, "the key predicted_std.experiment is missing"),
    ],
)
def test_wrong_summary_is_told_with_its_key(run, changes, message):
    edit_json(run.folder / "design.json", **changes)
    with pytest.raises(RunFolderError, match=message):
        DesignRecord.load(run.folder)


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_summary_that_is_no_mapping(run, text):
    (run.folder / "design.json").write_text(text)
    with pytest.raises(RunFolderError, match=r"design\.json"):
        DesignRecord.load(run.folder)


def test_singular_design_has_no_value(run):
    edit_json(run.folder / "design.json", log_det_information=None, criterion_value=None)
    summary = DesignRecord.load(run.folder).summary
    assert summary.criterion_value is None
    assert summary.log_det_information is None


def test_wrong_run_file_is_a_configuration_error(run):
    edit(run.folder / "run.yaml", lambda text: text.replace("trajectory:", "trajectorie:"))
    with pytest.raises(InputError, match="trajector"):
        DesignRecord.load(run.folder)


def test_spectrum_without_the_second_scaling(run):
    path = run.folder / "tables/eigenvalues.csv"
    edit(path, lambda text: "\n".join(line.rsplit(",", 1)[0] for line in text.splitlines()))
    assert DesignRecord.load(run.folder).spectrum.nominal is None


def test_rows_of_a_start_are_put_in_the_order_of_their_iterations(run):
    path = run.folder / "tables/convergence.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *reversed(rows)]))
    traces = DesignRecord.load(run.folder).traces
    assert [trace.start for trace in traces] == [0, 1, 2]
    assert all(np.all(np.diff(trace.iteration) == 1) for trace in traces)
    assert traces[0].stages[0] == "blunt"
    assert traces[0].stages[-1] == "sharp"
