"""Results in a run folder: the values read are those written, and errors name file and place."""

import json
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
import pytest

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.runfolder import (
    MAY_BE_EMPTY,
    ArrayTable,
    Column,
    JsonFile,
    MatrixTable,
    MissingFileError,
    Numbers,
    OpenNumber,
    RowTable,
    described,
)
from expdesign.runfolder.fields import field_columns


@dataclass(frozen=True)
class Part:
    name: Annotated[str, described("", "whose")]
    size: Annotated[OpenNumber, described("m", "how long", name="length")]
    place: Annotated[int | None, MAY_BE_EMPTY, described("1", "which")]
    kept: Annotated[bool, described("", "whether")]


@dataclass(frozen=True, eq=False)
class Motion:
    time: Annotated[Array, Column("t", "s", "time")]
    pose: Annotated[Array, Column("x", "m", "there"), Column("y", "m", "up")]


@dataclass(frozen=True, eq=False)
class Result(JsonFile):
    FILE: ClassVar[str] = "result.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign try`"
    omega: Annotated[float, described("rad/s", "frequency")]
    values: Annotated[Numbers, described("m", "where")]
    parts: Annotated[dict[str, Part], described("", "by name")]
    best: Annotated[int | None, described("1", "which")] = None


PARTS = RowTable("tables/parts.csv", "`expdesign try`", Part)
MOTION = ArrayTable("motion.csv", "`expdesign try`", Motion)
MATRIX = MatrixTable(
    "tables/matrix.csv",
    "`expdesign try`",
    (Column("row", "", "of the matrix"),),
    Column("<parameter>", "SI", "its column"),
)
ROWS = (Part("a", 0.1 + 0.2, 3, True), Part("", float("nan"), None, False))


def _result():
    return Result(0.1 + 0.2, np.array([[1.0, 1 / 3]]), {"a": ROWS[0], "b": ROWS[1]})


def test_a_json_file_comes_back_with_every_digit(tmp_path):
    (path,) = _result().write(tmp_path)
    assert json.loads(path.read_text(encoding="utf-8"))["format"] == 1
    for found in (Result.read(tmp_path), Result.read(path)):
        assert found.omega == 0.1 + 0.2
        np.testing.assert_array_equal(found.values, [[1.0, 1 / 3]])
        assert found.parts["a"] == ROWS[0]
        assert np.isnan(found.parts["b"].size)
        assert found.best is None
    assert [column.name for _, (column,) in field_columns(Result)] == [
        "omega",
        "values",
        "parts",
        "best",
    ]


@pytest.mark.parametrize(
    ("change", "key", "word"),
    [
        (lambda data: data.pop("omega"), "omega", "missing"),
        (lambda data: data.update(values=[[1], [1, 2]]), "values", "numbers"),
        (lambda data: data.update(values=["a"]), "values", "numbers"),
        (lambda data: data["parts"]["a"].update(size="long"), "parts.a.size", "long"),
        (lambda data: data.update(format=3), "format", "newer"),
        (lambda data: data.update(format="two"), "format", "'two' is not a format number"),
        (lambda data: data.update(format=0), "format", "earlier"),
        (lambda data: data.pop("format"), "format", "earlier"),
    ],
)
def test_a_wrong_value_is_reported_with_its_key(tmp_path, change, key, word):
    (path,) = _result().write(tmp_path)
    data = json.loads(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Result.read(tmp_path)
    (problem,) = caught.value.problems
    assert (problem.file, problem.key) == (path, key)
    assert word in problem.message


def test_a_table_of_another_version_is_refused(tmp_path):
    PARTS.write(tmp_path, ROWS)
    columns = tmp_path / "columns.json"
    data = json.loads(columns.read_text(encoding="utf-8"))
    for number, word in ((5, "newer"), (0, "earlier version; run it again")):
        data["formats"][PARTS.file] = number
        columns.write_text(json.dumps(data), encoding="utf-8")
        with pytest.raises(InputError, match=word):
            PARTS.read(tmp_path)


def test_unknown_keys_are_ignored(tmp_path):
    data = {"format": 1, "omega": 2.5, "values": [], "parts": {}, "unheard_of": 1}
    (tmp_path / "result.json").write_text(json.dumps(data), encoding="utf-8")
    assert Result.read(tmp_path).omega == 2.5


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "3", "\udcff", '{"format": 1, "omega": Infinity, "values": []}', "[" * 9999],
)
def test_a_file_that_is_not_json_is_named(tmp_path, text):
    path = tmp_path / "result.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError) as caught:
        Result.read(tmp_path)
    assert {problem.file for problem in caught.value.problems} == {path}


def test_a_missing_file_is_reported_with_the_command_that_writes_it(tmp_path):
    for read in (Result.read, PARTS.read, MOTION.read, MATRIX.read):
        with pytest.raises(MissingFileError, match="expdesign try"):
            read(tmp_path)


def test_tables_come_back_with_every_digit(tmp_path):
    written = [*PARTS.write(tmp_path, ROWS), *PARTS.numbered(2).write(tmp_path, ())]
    motion = Motion(np.array([0.0, 0.1 + 0.2]), np.array([[1, 2], [1 / 3, 4]]))
    written += MOTION.write(tmp_path, motion)
    labels = (("a",), ("b",))
    written += MATRIX.write(tmp_path, (labels, ("a", "b"), np.array([[1, 1 / 3], [0, 2]])))
    assert {path.relative_to(tmp_path).as_posix() for path in written} == {
        *(table.file for table in (PARTS, PARTS.numbered(2), MOTION, MATRIX)),
        "columns.json",
    }
    first, second = PARTS.read(tmp_path)
    assert first == ROWS[0]
    assert (second.name, second.place, second.kept) == ("", None, False)
    assert np.isnan(second.size)
    assert PARTS.numbered(2).read(tmp_path) == ()
    np.testing.assert_array_equal(MOTION.read(tmp_path).time, motion.time)
    np.testing.assert_array_equal(MOTION.read(tmp_path).pose, motion.pose)
    keys, names, matrix = MATRIX.read(tmp_path)
    assert (keys, names) == ((("a",), ("b",)), ("a", "b"))
    np.testing.assert_array_equal(matrix, [[1, 1 / 3], [0, 2]])


def test_the_columns_of_every_table_are_described(tmp_path):
    PARTS.write(tmp_path, ROWS)
    MATRIX.write(tmp_path, ((("a",),), ("a",), np.eye(1)))
    told = json.loads((tmp_path / "columns.json").read_text(encoding="utf-8"))
    assert told["formats"] == {PARTS.file: 1, MATRIX.file: 1}
    assert told[PARTS.file][1] == {"name": "length", "unit": "m", "meaning": "how long"}
    assert [column["name"] for column in told[MATRIX.file]] == ["row", "<parameter>"]


@pytest.mark.parametrize(
    ("table", "text", "line", "column"),
    [
        (PARTS, "name,length,place,kept\na,1,1,True\na,long,1,True\n", 3, "length"),
        (PARTS, "name,length,place,kept\na,1,half,True\n", 2, "place"),
        (MOTION, "t,x,y\n0,1,2\n1,,2\n", 3, "x"),
        (MOTION, "t,x,y\n0,1,inf\n", 2, "y"),
    ],
)
def test_a_wrong_cell_is_reported_with_line_and_column(tmp_path, table, text, line, column):
    path = tmp_path / table.file
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        table.read(tmp_path)
    (problem,) = caught.value.problems
    assert (problem.file, problem.line, problem.key) == (path, line, f"column {column}")


@pytest.mark.parametrize("row", ["1,2", "1,2,3,4"])
def test_a_row_that_is_too_short_or_too_long_is_reported_with_its_line(tmp_path, row):
    (tmp_path / "motion.csv").write_text(f"t,x,y\n0,1,2\n{row}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        MOTION.read(tmp_path)
    (problem,) = caught.value.problems
    assert (problem.line, problem.allowed) == (3, "3, as many as columns")


def test_missing_columns_are_named(tmp_path):
    (tmp_path / "motion.csv").write_text("t,x\n0,1\n", encoding="utf-8")
    with pytest.raises(InputError, match="y"):
        MOTION.read(tmp_path)


def test_a_field_without_a_description_is_a_type_error(tmp_path):
    @dataclass(frozen=True)
    class Bare:
        number: float

    with pytest.raises(TypeError, match="number"):
        RowTable("bare.csv", "", Bare).write(tmp_path, [Bare(1.0)])


@dataclass(frozen=True, eq=False)
class Chosen(JsonFile):
    FILE: ClassVar[str] = "chosen.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign try`"
    count: Annotated[int | float, described("1", "whole, or not")]
    parts: Annotated[tuple[Part | float, ...], described("", "parts, or their lengths")]


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        ({"count": "many"}, ["count"]),
        ({"parts": [1.0, "short"]}, ["parts[2]"]),
        ({"count": [], "parts": {}}, ["count", "parts"]),
    ],
)
def test_a_value_of_several_kinds_is_reported_once_under_its_key(changes, keys, tmp_path):
    data = {"format": 1, "count": 1, "parts": [1.0]} | changes
    (tmp_path / Chosen.FILE).write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Chosen.read(tmp_path)
    assert [problem.key for problem in caught.value.problems] == keys
