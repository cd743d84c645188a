"""Every defect is told with its file, column and row."""

import h5py
import numpy as np
import pytest

from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import load_robot
from tests.data.recordings import recording, write_csv, write_hdf5


@pytest.fixture
def csv(tmp_path, rec):
    """Write the recording with some cells and lines changed; line 1 is the header."""
    path = tmp_path / "m.csv"

    def write(cells=(), frame=None, lines=None):
        (rec.frame if frame is None else frame).to_csv(path, index=False)
        text = path.read_text().splitlines()
        header = text[0].split(",")
        for line, column, content in cells:
            row = text[line - 1].split(",")
            row[header.index(column)] = content
            text[line - 1] = ",".join(row)
        for line, content in (lines or {}).items():
            text[line - 1] = content
        path.write_text("\n".join(text) + "\n")
        return path

    return write


def _places(problems):
    return [(problem.line, problem.key) for problem in problems]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("abc", "'abc' is not a finite number"),
        ("0.7.1", "'0.7.1' is not a finite number"),
        ("NaN", "'NaN' is not a finite number"),
        ("-inf", "'-inf' is not a finite number"),
        ("1e999", "'1e999' is not a finite number"),
        ("#N/A", "'#N/A' is not a finite number"),
        ("", "the cell is empty"),
        ("  ", "the cell is empty"),
        ("\x1b[31m0.7", "'\\x1b[31m0.7' is not a finite number"),
    ],
)
@pytest.mark.parametrize(("line", "column"), [(2, "t"), (17, "q3"), (61, "Q6")])
def test_cells_that_are_no_numbers(content, message, line, column, csv, refused):
    problems = refused(csv([(line, column, content)]))
    assert _places(problems) == [(line, column)]
    assert problems[0].message == message


def test_the_message_as_the_user_sees_it(csv, read):
    path = csv([(17, "q3", "abc")])
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value) == f"{path}:17: q3: 'abc' is not a finite number"


def test_a_decimal_comma_is_recognised(tmp_path, rec, refused, read):
    path = tmp_path / "m.csv"
    rec.frame.to_csv(path, index=False, sep=";", decimal=",")
    assert refused(path, delimiter=";")[0].allowed == "numbers, or data.decimal: ','"
    rec.frame.to_csv(path, index=False, sep=";")
    problems = refused(path, delimiter=";", decimal=",")
    assert problems[0].allowed == "numbers, or data.decimal: '.'"
    assert _places(problems)[:2] == [(2, "t"), (2, "q1")]
    read(path, delimiter=";")


def test_many_cells_are_summed_up(csv, refused):
    problems = refused(csv([(line, "q1", "x") for line in range(10, 30)]))
    assert _places(problems[:-1]) == [(line, "q1") for line in range(10, 15)]
    assert problems[-1].message == "15 more cells are not finite numbers"


def test_columns_that_nobody_asked_for_may_hold_anything(csv, rec, read):
    frame = rec.frame
    frame["note"] = "x"
    frame.loc[3, "note"] = np.nan
    assert np.array_equal(read(csv(frame=frame)).lengths, rec.q)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty line"),
        ("0.018,0.7", "the line has 2 columns, the header has 13"),
        ("0.018" + ",1" * 13, "the line has 14 columns, the header has 13"),
        ("x", "the line has 1 column, the header has 13"),
    ],
)
def test_lines_of_another_length(content, message, csv, refused):
    (problem,) = refused(csv(lines={20: content}))
    assert (problem.line, problem.message) == (20, message)


def test_a_recording_that_breaks_off(tmp_path, rec, refused):
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    path.write_text(path.read_text()[:-60])
    (problem,) = refused(path)
    assert problem.line == 61


def test_missing_column(csv, rec, refused):
    (problem,) = refused(csv(frame=rec.frame.rename(columns={"q3": "q_3"})))
    assert (problem.line, problem.key, problem.nearest) == (1, "q3", "q_3")


def test_too_few_rows(tmp_path, refused, read, palida):
    path = tmp_path / "m.csv"
    write_csv(path, recording(23))
    (problem,) = refused(path)
    assert problem.message == "23 rows of data, but the robot has 24 parameters"
    assert problem.allowed == "at least 24 rows"
    write_csv(path, recording(24))
    assert len(read(path)) == 24
    path.write_text(path.read_text().splitlines()[0])
    assert "0 rows of data" in refused(path)[0].message


@pytest.mark.parametrize("time", ["uniform", "stamped"])
def test_the_same_time_twice(time, csv, refused):
    (problem,) = refused(csv([(30, "t", "0.027")]), time=time)
    assert (problem.line, problem.key) == (30, "t")
    assert problem.message == "the same time as line 29: 0.027 s, then 0.027 s"


@pytest.mark.parametrize("time", ["uniform", "stamped"])
def test_time_that_goes_back(time, csv, refused):
    (problem,) = refused(csv([(30, "t", "0.0255")]), time=time)
    assert (problem.line, problem.key) == (30, "t")
    assert problem.message == "time goes back from line 29: 0.027 s, then 0.0255 s"


@pytest.mark.parametrize("time", ["uniform", "stamped"])
@pytest.mark.parametrize(("first", "count"), [(1, 7), (20, 7), (40, 19)])
def test_many_lost_samples(time, first, count, csv, rec, refused):
    frame = rec.frame.drop(range(first, first + count))
    (problem,) = refused(csv(frame=frame), time=time)
    assert (problem.line, problem.key) == (first + 2, "t")
    assert problem.message.startswith(
        f"a gap of {count} sample{'s' if count > 1 else ''} after line {first + 1}: "
    )
    assert "data.start, data.end" in problem.allowed


@pytest.mark.parametrize("time", ["uniform", "stamped"])
@pytest.mark.parametrize(("first", "count"), [(1, 1), (20, 1), (20, 5), (58, 1)])
def test_a_few_lost_samples_are_counted(time, first, count, csv, rec, read):
    frame = rec.frame.drop(range(first, first + count))
    found = read(csv(frame=frame), time=time)
    assert found.lost == count
    assert found.time == pytest.approx(frame["t"].to_numpy(), abs=1e-12)
    assert found.step == pytest.approx(1e-3, rel=1e-9)
    assert found.places.tolist() == frame.index.tolist()
    assert sum("missing" in warning for warning in found.warnings) == 1


def test_time_that_is_not_uniform(csv, rec, refused, read):
    frame = rec.frame
    frame.loc[33, "t"] += 0.00003
    (problem,) = refused(csv(frame=frame))
    assert (problem.line, problem.key) == (35, "t")
    assert problem.message.startswith("time is not uniform: 2.9")
    assert "data.time: stamped, or a time_tolerance above 0.029" in problem.allowed
    found = read(csv(frame=frame), time_tolerance=0.04)
    assert found.jitter == pytest.approx(0.0295, abs=1e-3)
    assert np.diff(found.time) == pytest.approx(found.step, rel=1e-9)


def test_jitter_within_the_tolerance_is_fitted_and_reported(csv, rec, read):
    frame = rec.frame
    frame["t"] += 1e-3 * np.random.default_rng(0).uniform(-0.008, 0.008, len(frame))
    found = read(csv(frame=frame))
    assert 0.005 < found.jitter < 0.01
    assert found.time == pytest.approx(rec.t, abs=4e-6)
    assert np.diff(found.time) == pytest.approx(found.step, rel=1e-9)


def test_stamps_that_jitter_are_used_as_they_are(csv, rec, read, refused):
    frame = rec.frame
    frame["t"] += 1e-3 * np.random.default_rng(0).uniform(-0.3, 0.3, len(frame))
    path = csv(frame=frame)
    assert "time is not uniform" in refused(path)[0].message
    found = read(path, time="stamped")
    assert np.array_equal(found.time, frame["t"])
    assert found.stamped
    assert 0.2 < found.jitter < 0.4
    assert found.step == pytest.approx(1e-3, rel=0.02)


def test_rows_before_the_trigger_are_left_out_with_what_is_wrong_in_them(csv, rec, read, refused):
    path = csv([(3, "t", "0.5"), (4, "q1", "x"), (5, "Q2", "")])
    assert len(refused(path)) == 2
    path = csv([(4, "q1", "x"), (5, "Q2", "")])
    found = read(path, start="10 ms")
    assert np.array_equal(found.lengths, rec.q[10:])
    assert found.time == pytest.approx(rec.t[10:], abs=1e-12)


def test_rows_after_the_trigger_keep_their_lines(csv, refused):
    assert _places(refused(csv([(40, "q1", "x")]), start="10 ms")) == [(40, "q1")]


def test_a_trigger_after_the_end(csv, refused):
    (problem,) = refused(csv(), start=10)
    assert problem.message == "no rows at or after data.start, 10 s"
    assert problem.allowed == "the file has 0 to 0.059 s"


def test_rows_from_the_end_on_are_left_out_with_what_is_wrong_in_them(csv, rec, read, refused):
    path = csv([(4, "q1", "x"), (50, "Q2", ""), (52, "t", "1")])
    assert _places(refused(path, start="10 ms", end="49 ms")) == [(50, "Q2")]
    found = read(path, start="10 ms", end="48 ms")
    # Line 50 is sample 48: the end itself is the first that does not count.
    assert np.array_equal(found.lengths, rec.q[10:48])
    assert np.array_equal(read(path, start="10 ms", end="48.005 ms").lengths, rec.q[10:48])
    assert np.array_equal(read(csv(), end=10).lengths, rec.q)


def test_an_end_before_the_first_row(csv, refused):
    (problem,) = refused(csv(), end="-1 ms")
    assert problem.message == "no rows before data.end, -0.001 s"


def test_an_end_before_the_start(csv, read):
    with pytest.raises(ValueError, match="is not after the start"):
        read(csv(), start="20 ms", end="20 ms")


def test_a_trigger_that_leaves_too_few_rows(csv, refused):
    (problem,) = refused(csv(), start="40 ms")
    assert problem.message == "20 rows of data, but the robot has 24 parameters"


def test_period_column(csv, rec, read, refused):
    frame = rec.frame
    frame["period"] = np.arange(len(frame)) // 20 + 1
    found = read(csv(frame=frame))
    assert found.period.dtype == np.int64
    assert np.array_equal(found.period, frame["period"])
    (problem,) = refused(csv([(12, "period", "1.5")], frame=frame))
    assert (problem.line, problem.key) == (12, "period")
    assert problem.message == "1.5 is not a period number"
    (problem,) = refused(csv([(52, "period", "1")], frame=frame))
    assert (problem.line, problem.message) == (52, "period 1 after period 3")


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "mm"), (1e2, "cm"), (1 / 0.0254, "in"), (1e6, "µm"), (1e-3, "km")]
)
def test_lengths_in_another_unit(factor, unit, csv, rec, refused, read):
    rec.q *= factor
    path = csv()
    problems = refused(path)
    assert _places(problems) == [(2, f"q{j}") for j in range(1, 7)]
    assert f"it would fit if the file were in {unit}: data.units: {{q: {unit}}}" in str(problems[0])
    assert problems[0].allowed == "0.45 to 0.95 m, palida.yaml: limits.strut_length"
    assert read(path, units={"q": unit}).lengths == pytest.approx(rec.q / factor)


def test_zeros_without_a_unit_are_taken_for_metres_and_said(csv, rec, refused, read):
    zeros = np.median(rec.q, axis=0).round(3)
    rec.q -= zeros
    problems = refused(csv(), offset=(1e3 * zeros).tolist())
    for one, zero in zip(problems, zeros.tolist(), strict=True):
        number = f"{1e3 * zero:.4g}"
        assert (
            f"data.offset is {number} m, and the length would fit with {number} mm" in one.message
        )
    assert read(csv(), offset=[f"{1e3 * zero} mm" for zero in zeros]).lengths == pytest.approx(
        rec.q + zeros
    )


def test_right_zeros_are_not_blamed_for_the_unit_of_the_file(csv, rec, refused):
    zeros = np.median(rec.q, axis=0).round(3)
    # One length at its zero fits with a zero in any unit.
    rec.q = 1e3 * (rec.q - zeros + 1e-3)
    problems = refused(csv(), offset=zeros.tolist())
    assert "it would fit if the file were in mm: data.units: {q: mm}" in problems[0].message


def test_the_hint_counts_from_the_unit_that_was_stated(csv, rec, refused):
    problems = refused(csv(), units={"q": "mm"})
    assert "it would fit if the file were in m:" in problems[0].message


def test_lengths_of_no_unit(csv, rec, refused):
    rec.q *= 0.1
    rec.q[:] += 0.1
    problems = refused(csv())
    assert len(problems) == 6
    assert problems[0].message.startswith("strut 1 is around 0.1")
    assert problems[0].message.endswith(" m long, out of this robot's range")


@pytest.mark.parametrize("step", [0, 1e-9, 40.0])
def test_rows_of_a_second_source_without_forces(step, csv, rec, refused, read):
    """Unless zeros are forces at rest that a coarse sensor rounds."""
    if step:
        rec.Q = step * np.round(rec.Q / step)
    rec.Q[4:56:5] = 0
    if step > 1:
        assert np.array_equal(read(csv()).forces, rec.Q)
        return
    (problem,) = refused(csv())
    assert (problem.line, problem.key) == (6, "Q1")
    assert problem.message == "all forces are zero here and in 10 other rows between the others"


def test_one_wild_length(csv, refused, read):
    problems = refused(csv([(44, "q5", "1.6")]))
    assert _places(problems) == [(44, "q5")]
    assert problems[0].message == "strut 5 is 1.6 m long, far out of this robot's range"
    assert _places(refused(csv([(44, "q5", "-0.7")]))) == [(44, "q5")]
    # an outlier is for the estimator
    assert read(csv([(44, "q5", "1.0")])).lengths[42, 4] == 1.0


def test_a_robot_without_length_limits_has_the_scale_of_its_home_pose(csv, rec, read):
    description = load_robot_description("palida")
    bare = type(description)(
        **{
            name: getattr(description, name)
            for name in description.__dataclass_fields__
            if name != "limits"
        },
        limits={},
    )
    path = csv()
    assert np.array_equal(read_measurement(path, DataSection(), bare).lengths, rec.q)
    with pytest.raises(InputError, match="half to twice the lengths at home"):
        read_measurement(path, DataSection(units={"q": "in"}), bare)


def test_the_robot_may_be_the_one_that_computes(csv, rec):
    found = read_measurement(csv(), DataSection(), load_robot("palida"))
    assert np.array_equal(found.lengths, rec.q)


@pytest.mark.usefixtures("forked")
def test_rows_of_binary_files_are_samples(tmp_path, rec, refused):
    path = tmp_path / "m.h5"
    rec.Q[16, 2] = np.nan
    rec.q[20, 0] = np.inf
    write_hdf5(path, rec)
    problems = refused(path)
    assert [(problem.key, problem.message) for problem in problems] == [
        ("recording/Q3, sample 17", "NaN"),
        ("recording/q1, sample 21", "an infinite value"),
    ]


@pytest.mark.usefixtures("forked")
def test_columns_of_different_lengths(tmp_path, rec, refused):
    path = tmp_path / "m.h5"
    write_hdf5(path, rec)
    with h5py.File(path, "r+") as file:
        del file["recording/Q3"]
        file["recording/Q3"] = np.zeros(50)
    (problem,) = refused(path)
    assert problem.key == "recording/Q3"
    assert problem.message == "the column has 50 samples, 'recording/t' has 60"


def test_nothing_is_written(csv, tmp_path, refused):
    path = csv([(17, "q3", "abc")])
    before = path.read_bytes()
    refused(path)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == before
