"""A result of a stage: every kind of place is written and read by the annotations of the fields."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pytest

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem
from expdesign.runfolder import (
    Column,
    Matrix,
    MissingFileError,
    Numbered,
    RowTable,
    StageResult,
    Table,
    Text,
    described,
    strutwise,
)


@dataclass(frozen=True)
class Check:
    key: Annotated[str, described("", "of the limit", name="limit")]
    value: Annotated[float, described("m", "worst value")]


@dataclass(frozen=True)
class NamedCheck(Check):
    note: Annotated[str, described("", "a note")]


@dataclass(frozen=True, eq=False)
class Samples:
    time: Annotated[Array, Column("t", "s", "time")]
    forces: Annotated[Array, strutwise("Q", "N", "force")]


@dataclass(frozen=True, eq=False)
class Pictures:
    samples: Annotated[Samples, Table("tables/picture.csv")]
    checks: Annotated[tuple[Check, ...], Table("tables/picture_checks.csv")]


def _noted(result):
    return RowTable("tables/noted.csv", result.WRITTEN_BY, NamedCheck if result.noted else Check)


@dataclass(frozen=True, eq=False, kw_only=True)
class Swing(StageResult):
    FILE: ClassVar[str] = "swing.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign swing`"

    rate: Annotated[float, described("rad/s", "base frequency", name="omega")]
    names: Annotated[tuple[str, ...], described("", "of the parameters")]
    recordings: Annotated[int, described("1", "number of recordings")]
    noted: Annotated[bool, described("", "whether checks have notes")] = False
    checks: Annotated[
        tuple[Check, ...],
        Table("tables/checks.csv", rows_of=("key",), as_in=("limits",), some=True),
    ]
    pairs: Annotated[
        tuple[NamedCheck, ...],
        Table("tables/pairs.csv", rows_of=("key", "note"), as_in=("kinds", "names")),
    ]
    samples: Annotated[Samples, Table("samples.csv")]
    spare: Annotated[Samples | None, Table("spare.csv", optional=True)] = None
    cells: Annotated[tuple[Check, ...], Table("tables/cells.csv", optional=True)] = ()
    motions: Annotated[
        dict[int, Samples], Table("tables/motion.csv", numbered="numbers", optional=True)
    ]
    tracking: Annotated[tuple[Samples, ...], Table("tables/tracking.csv", numbered="numbers")]
    rows: Annotated[tuple[tuple[Check, ...], ...], Table("tables/rows.csv", numbered="numbers")]
    pictures: Annotated[tuple[Pictures, ...], Numbered("numbers")]
    information: Annotated[Array, Matrix("tables/f.csv", "SI", "F", names="names")]
    covariances: Annotated[
        dict[str, Array],
        Matrix("tables/c.csv", "SI", "C", names="names", by=Column("kind", "", "ls or gm")),
    ]
    notes: Annotated[tuple[Check, ...], Table("tables/noted.csv", form=_noted)]
    text: Annotated[str | None, Text("swing.yaml", "a block")] = None
    listed: Annotated[
        tuple[Check, ...], described("", "a key and a table"), Table("tables/listed.csv")
    ] = ()

    @property
    def numbers(self) -> tuple[int | None, ...]:
        return (None,) if self.recordings == 1 else tuple(range(1, self.recordings + 1))

    @property
    def kinds(self) -> tuple[str, ...]:
        return ("ls", "gm")

    @property
    def limits(self) -> Annotated[dict[str, float], described("m", "worst values by limit")]:
        return {check.key: check.value for check in self.checks}

    @property
    def squares(
        self,
    ) -> Annotated[
        tuple[Check, ...], Table("tables/squares.csv", rows_of=("key",), as_in=("limits",))
    ]:
        return tuple(Check(check.key, check.value**2) for check in self.checks)

    def contradictions(self) -> Iterator[Problem]:
        if np.any(np.diff(self.samples.time) <= 0):
            yield Problem("the times do not increase", Path("samples.csv"), key="column t")
        if self.rate <= 0:
            yield Problem("not positive", key="omega")


def _samples(start):
    time = np.array([start, start + 0.1 + 0.2])
    return Samples(time, np.arange(12.0).reshape(2, 6) / 3)


def _swing(recordings=1, **changes):
    checks = (Check("tilt", 0.1 + 0.2), Check("alpha", 1 / 3))
    pairs = [NamedCheck(kind, 1.0, name) for kind in ("ls", "gm") for name in ("a", "b")]
    values = {
        "rate": 0.1 + 0.2,
        "names": ("a", "b"),
        "recordings": recordings,
        "checks": checks,
        "pairs": tuple(pairs),
        "samples": _samples(0.0),
        "motions": {recordings: _samples(1.0)},
        "tracking": tuple(map(_samples, range(recordings))),
        "rows": (checks,) * recordings,
        "pictures": tuple(Pictures(_samples(n), checks[:1]) for n in range(recordings)),
        "information": np.array([[1, 1 / 3], [1 / 3, 2]]),
        "covariances": {"ls": np.eye(2), "gm": np.eye(2) / 3},
        "notes": checks[:1],
    }
    return Swing(**values | changes)


def _same(one, other):
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, Samples | Pictures | Swing):
        return all(_same(vars(one)[name], vars(other)[name]) for name in vars(one))
    return one == other


@pytest.mark.parametrize("recordings", [1, 2])
def test_a_result_comes_back_with_every_digit(tmp_path, recordings):
    made = _swing(recordings)
    written = made.write(tmp_path)
    assert {*written} == {path for path in tmp_path.rglob("*") if path.is_file()}
    assert _same(made, Swing.read(tmp_path))
    assert (tmp_path / "tables/tracking_2.csv").is_file() == (recordings == 2)
    assert not (tmp_path / "tables/cells.csv").exists()
    data = json.loads((tmp_path / "swing.json").read_text(encoding="utf-8"))
    assert data["format"] == 1
    assert data["omega"] == 0.1 + 0.2
    assert data["limits"] == made.limits
    assert "checks" not in data


def test_optional_files_and_columns_that_depend_on_a_key(tmp_path):
    check = Check("tilt", 1.0)
    note = NamedCheck("tilt", 1.0, "far")
    changes = {"spare": _samples(2.0), "cells": (check,), "text": "noise: 1\n", "listed": (check,)}
    made = _swing(**changes, noted=True, notes=(note,))
    made.write(tmp_path)
    found = Swing.read(tmp_path)
    assert _same(made, found)
    assert found.notes == (note,)
    for name in ("spare.csv", "tables/cells.csv", "swing.yaml", "tables/listed.csv"):
        (tmp_path / name).unlink()
    found = Swing.read(tmp_path)
    assert (found.spare, found.cells, found.text) == (None, (), None)
    assert found.listed == (check,)


@pytest.mark.parametrize(
    ("file", "line"), [("tables/checks.csv", 2), ("tables/squares.csv", 2), ("tables/pairs.csv", 3)]
)
def test_rows_that_contradict_the_keys_are_refused(tmp_path, file, line):
    _swing().write(tmp_path)
    path = tmp_path / file
    lines = path.read_text(encoding="utf-8").splitlines()
    del lines[line - 1]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        Swing.read(tmp_path)
    (problem,) = caught.value.problems
    assert (problem.file, problem.line) == (path, line)
    assert "swing.json" in problem.allowed


def test_names_of_a_matrix_that_contradict_the_keys_are_refused(tmp_path):
    _swing().write(tmp_path)
    path = tmp_path / "tables/c.csv"
    path.write_text(path.read_text(encoding="utf-8").replace("gm,b", "gm,c"), encoding="utf-8")
    with pytest.raises(InputError, match=r"c\.csv.*not the parameters of swing\.json"):
        Swing.read(tmp_path)


def test_contradictions_are_reported_with_their_file(tmp_path):
    _swing(rate=-1.0, samples=Samples(np.zeros(2), np.zeros((2, 6)))).write(tmp_path)
    with pytest.raises(InputError) as caught:
        Swing.read(tmp_path)
    assert [(problem.file, problem.key) for problem in caught.value.problems] == [
        (tmp_path / "samples.csv", "column t"),
        (tmp_path / "swing.json", "omega"),
    ]


@pytest.mark.parametrize("value", [None, [], {"tilt": "steep"}])
def test_derived_keys_are_checked(tmp_path, value):
    _swing().write(tmp_path)
    path = tmp_path / "swing.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**data, "limits": value}), encoding="utf-8")
    with pytest.raises(InputError, match="limits"):
        Swing.read(tmp_path)


def test_missing_files_are_reported_with_the_command_that_writes_them(tmp_path):
    with pytest.raises(MissingFileError, match="expdesign swing"):
        Swing.read(tmp_path)
    _swing(2).write(tmp_path)
    (tmp_path / "tables/tracking_2.csv").unlink()
    with pytest.raises(MissingFileError, match="tracking_2"):
        Swing.read(tmp_path)
    assert Swing.known(tmp_path) is None
