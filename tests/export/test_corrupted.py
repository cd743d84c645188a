"""The check catches files that are not what the design asks for."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from expdesign.configuration import export_section
from expdesign.export.definition import TableError
from expdesign.export.exporting import ExportError, export_table, file_name
from expdesign.export.formats import table_formats
from expdesign.export.read_back import read_back
from tests.export.motions import task
from tests.export.test_formats import EXPORTS, section

pytestmark = pytest.mark.slow

TEXT = [key for key in EXPORTS if "mat" not in key and "mcap" not in key]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a maker of good files; each is written once."""
    folder, made = tmp_path_factory.mktemp("written"), {}

    def write(key):
        if key not in made:
            asked = section(key)
            path = folder / key.replace(" ", "-") / file_name(asked)
            made[key] = export_table(asked, task(), path)
        return made[key]

    return write


def checked(made, content, tmp_path):
    path = tmp_path / made.path.name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_back(path, made.settings)


def middle(lines):
    """Return the number of a row with six numbers in the middle of the file."""
    return next(
        k for k in range(len(lines) // 2, len(lines)) if sum(c.isdigit() for c in lines[k]) > 30
    )


@pytest.mark.parametrize("key", EXPORTS)
def test_a_good_file_passes_again(key, written, tmp_path):
    made = written(key)
    again = checked(made, made.path.read_bytes(), tmp_path)
    assert not again.failures


def _nan(line):
    head, _, tail = line.rpartition(".")
    return f"{head.rstrip('-0123456789')}nan{tail.lstrip('0123456789')}"


def _short(line):
    for mark in (",", "\t", " "):
        if mark in line.strip():
            return line[: line.rstrip().rindex(mark)]
    raise AssertionError(line)


def _wrong_digit(line):
    # The first decimal of a number, or the first digit of a whole one.
    k = re.search(r"\.\d|(?<=,)\d", line[len(line) // 2 :]).end() - 1 + len(line) // 2
    return f"{line[:k]}{(int(line[k]) + 4) % 10}{line[k + 1 :]}"


@pytest.mark.parametrize("damage", [_nan, _short, _wrong_digit])
@pytest.mark.parametrize("key", TEXT)
def test_a_damaged_row(key, damage, written, tmp_path):
    made = written(key)
    lines = made.path.read_text().splitlines()
    k = middle(lines)
    before = lines[k]
    lines[k] = damage(before)
    assert lines[k] != before
    found = checked(made, "\n".join(lines) + "\n", tmp_path)
    assert found.failures
    assert found.failures[0]


@pytest.mark.parametrize("key", TEXT)
def test_a_missing_row(key, written, tmp_path):
    made = written(key)
    lines = made.path.read_text().splitlines()
    del lines[middle(lines)]
    assert checked(made, "\n".join(lines) + "\n", tmp_path).failures


@pytest.mark.parametrize("key", TEXT)
def test_a_file_that_ends_early(key, written, tmp_path):
    made = written(key)
    text = made.path.read_text()
    assert checked(made, text[: len(text) // 2], tmp_path).failures
    assert checked(made, "", tmp_path).failures


@pytest.mark.parametrize("key", ["xps-pvt", "linuxcnc-strut", "pi-wave", "csv", "pvt-csv"])
def test_swapped_columns(key, written, tmp_path):
    made = written(key)
    mark = {"linuxcnc-strut": " ", "pi-wave": "\t"}.get(key, ",")
    first, second = (3, 5) if key == "pvt-csv" else (1, 3)
    lines = []
    for number, line in enumerate(made.path.read_text().splitlines()):
        cells = line.split(mark)
        if line[0] != "#" and not (number == 0 and "csv" in key):
            cells[first], cells[second] = cells[second], cells[first]
        lines.append(mark.join(cells))
    found = checked(made, "\n".join(lines) + "\n", tmp_path)
    assert any("apart" in failure for failure in found.failures), found.failures


def test_a_missing_feed(written, tmp_path):
    made = written("linuxcnc-gcode")
    lines = made.path.read_text().splitlines()
    k = middle(lines)
    lines[k] = lines[k].partition(" F")[0]
    (failure,) = checked(made, "\n".join(lines) + "\n", tmp_path).failures
    assert failure == (
        f"the file cannot be read: line {k + 1}: F word missing, wrong or twice in a G93 G1 move"
    )


def test_gathered_rounding(tmp_path, monkeypatch):
    """Displacements that are rounded one by one end somewhere else, however many the digits."""
    form = table_formats()["xps-pvt"]

    def careless(path, rows, settings):
        displacements = np.diff(rows.position, axis=0)
        times = np.diff(rows.times)
        with path.open("w") as stream:
            for dt, moved, rate in zip(times, displacements, rows.rate[1:], strict=True):
                pairs = zip(moved, rate, strict=True)
                cells = [f"{dt:.8f}", *(f"{x:.8f}" for pair in pairs for x in pair)]
                stream.write(", ".join(c.replace("-0.00000000", "0.00000000") for c in cells))
                stream.write("\n")

    asked = export_section(format="xps-pvt")
    good = export_table(asked, task("linuxcnc", 12), tmp_path / "good.trj")
    assert good.check.row_error <= 1
    formats = {"xps-pvt": replace(form, write=careless)}
    monkeypatch.setattr("expdesign.export.exporting.table_formats", lambda: formats)
    with pytest.raises(ExportError, match="half units of its last digit apart") as caught:
        export_table(asked, task("linuxcnc", 12), tmp_path / "bad.trj")
    (apart,) = re.findall(r"([\d.]+) half units", caught.value.message)
    assert float(apart) > 1.5
    assert [path.name for path in tmp_path.iterdir()] == ["good.trj"]


def test_too_few_digits_leave_nothing(tmp_path):
    asked = export_section(format="xps-pvt", digits=2, segment="5 ms")
    with pytest.raises(ExportError, match="µm from the design"):
        export_table(asked, task(), tmp_path / "bad.trj")
    assert not list(tmp_path.iterdir())


def test_too_long_segments(tmp_path):
    with pytest.raises(ExportError, match="more than the tolerance of 1 µm"):
        export_table(
            export_section(format="xps-pvt", segment="80 ms"), task(), tmp_path / "bad.trj"
        )


def test_other_columns_of_a_matrix(written, tmp_path):
    made = written("mat")
    data = {k: v for k, v in loadmat(made.path).items() if not k.startswith("__")}
    data["command"][:, [1, 2]] = data["command"][:, [2, 1]]
    path = tmp_path / "swapped.mat"
    savemat(path, data)
    assert read_back(path, made.settings).failures
    data["command"][:, [1, 2]] = data["command"][:, [2, 1]]
    data["command"][7, 3] = np.nan
    savemat(path, data)
    (failure,) = read_back(path, made.settings).failures
    assert failure == "the file cannot be read: row 8: the position is not a finite number"


@pytest.mark.parametrize("key", ["mat", "ros2 mcap"])
def test_damaged_binary_files(key, written, tmp_path):
    made = written(key)
    content = made.path.read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"no such file" * 20):
        found = checked(made, damaged, tmp_path)
        assert found.failures[0].startswith("the file cannot be read")


@pytest.mark.parametrize("size", [b"\xff" * 8, b"\xff" * 7 + b"\x7f"])
def test_a_bag_whose_sizes_are_damaged(size, tmp_path):
    """Sizes of records are 64 bits; no byte of the bag leads to anything but a refusal."""
    asked = section("ros2 mcap", segment="20 ms", tolerance="5 mm")
    made = export_table(asked, task(), tmp_path / "bag" / file_name(asked))
    content, read = made.path.read_bytes(), table_formats()["ros2"].read
    path, refused = tmp_path / made.path.name, 0
    for place in (*range(8, 60), *range(len(content) - 60, len(content) - 8)):
        path.write_bytes(content[:place] + size + content[place + 8 :])
        try:
            read(path, made.settings)
        except TableError:
            refused += 1
    assert refused > 20


def test_segments_of_ones_own_keep_the_limits(tmp_path):
    """A segment time that is given may leave the design, but no limit."""
    asked = export_section(format="xps-pvt", segment="40 ms", tolerance="1 mm")
    check = export_table(asked, task(), tmp_path / "file.trj").check
    assert check.acceleration_error_share > 1e-3
    assert max(limit.violation for limit in check.limits) <= 1e-3
