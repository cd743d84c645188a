import json
from dataclasses import astuple

import numpy as np
import pytest

from expdesign.configuration import InputError
from expdesign.experiment import DesignResult
from expdesign.runfolder import MissingFileError
from expdesign.solver.phases import Iteration
from results.figures.design import traces

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
    record = DesignResult.read(run.folder)
    assert record.robot.name == "palida"
    assert record.criterion_value == 97.25
    assert record.solver.best_start == 1
    assert record.warnings == ("made up",)
    np.testing.assert_array_equal(record.mu, run.trajectory.mu)
    np.testing.assert_array_equal(record.motion.time, run.numbers("trajectory.csv", "t")[:, 0])
    np.testing.assert_array_equal(
        record.motion.force, run.numbers("trajectory.csv", *(f"Q{j}" for j in range(1, 7)))
    )
    assert record.motion.period == pytest.approx(run.trajectory.period, rel=1e-12)
    assert len(record.iterations) == 19 + 20 + 21
    assert [check.key for check in record.checks][:2] == ["actuator_force", "tilt"]
    assert record.checks[1].row == ""
    assert tuple(p.name for p in record.parameters) == record.robot.parameter_names
    assert [p.nominal for p in record.parameters] == record.robot.parameters.tolist()


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(run, name):
    (run.folder / name).unlink()
    with pytest.raises(MissingFileError, match="expdesign design") as caught:
        DesignResult.read(run.folder)
    assert caught.value.path == run.folder / name


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".csv")])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a,b\n1,2\n"])
def test_file_that_is_no_such_table(run, name, content):
    (run.folder / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        DesignResult.read(run.folder)
    assert {problem.file for problem in caught.value.problems} == {run.folder / name}


def test_cell_that_is_no_number_is_told_with_its_line(run):
    path = run.folder / "tables/eigenvalues.csv"
    lines = path.read_text().splitlines()
    lines[3] = "3,many,1"
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"csv:4: column eigenvalue: .*many"):
        DesignResult.read(run.folder)


@pytest.mark.parametrize("cell", ["", "nan", "inf"])
def test_motion_must_be_finite(run, cell):
    path = run.folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    lines[2] = ",".join([*lines[2].split(",")[:-1], cell])
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match="csv:3: column Q6"):
        DesignResult.read(run.folder)


def test_time_must_increase(run):
    path = run.folder / "trajectory.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, lines[1]]))
    with pytest.raises(InputError, match="do not increase"):
        DesignResult.read(run.folder)


def test_singular_design_has_no_value(run):
    edit_json(run.folder / "design.json", log_det_information=None, criterion_value=None)
    summary = DesignResult.read(run.folder)
    assert np.isnan(summary.criterion_value)
    assert np.isnan(summary.log_det_information)


def test_wrong_run_file_is_a_configuration_error(run):
    edit(run.folder / "run.yaml", lambda text: text.replace("trajectory:", "trajectorie:"))
    with pytest.raises(InputError, match="trajector"):
        DesignResult.read(run.folder)


def test_parameters_that_are_not_those_of_the_information(run):
    edit(run.folder / "tables/information.csv", lambda text: text.replace("p1,", "p99,"))
    with pytest.raises(InputError, match=r"information\.csv"):
        DesignResult.read(run.folder)


def test_iterations_are_put_in_their_order():
    points = [(2, "hop", "sharp", 1), (0, "random", "sharp", 2), (0, "random", "blunt", 1)]
    found = traces([Iteration(*point, 1.0, 0.1) for point in points])
    assert [(trace.start, trace.phases) for trace in found] == [
        (0, ("blunt", "sharp")),
        (2, ("sharp",)),
    ]
    np.testing.assert_array_equal(found[0].iteration, [1, 2])


def test_what_is_written_is_read(tiny_result, tmp_path):
    """The record of a result and that of its folder are the same, to the last digit."""
    made = tiny_result
    made.write(tmp_path / "first")
    found = DesignResult.read(tmp_path / "first")
    found.write(tmp_path / "second")
    # NaN, of what is not proved or has no tolerance, is not equal to itself.
    for rows in ("checks", "parameters"):
        np.testing.assert_equal(
            *([astuple(row) for row in getattr(one, rows)] for one in (found, made))
        )
    assert found.solver == made.solver
    assert found.predicted_std == made.predicted_std
    np.testing.assert_array_equal(found.trajectory.vector(), made.trajectory.vector())
    np.testing.assert_array_equal(found.motion.force, made.motion.force)
    np.testing.assert_array_equal(found.information, made.information)
    for path in (tmp_path / "first").rglob("*"):
        same = tmp_path / "second" / path.relative_to(tmp_path / "first")
        if path.suffix == ".json":
            assert json.loads(path.read_text()) == json.loads(same.read_text())
        elif path.is_file():
            assert path.read_bytes() == same.read_bytes(), path.name
