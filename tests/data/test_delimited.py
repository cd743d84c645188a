"""Text files: names, delimiters, decimal marks, encodings, lines."""

import csv
import io
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimation.data.readers import delimited
from expdesign.configuration import DataSection
from tests.data.recordings import CHANNELS, recording, write_csv


def _text(rec, delimiter=",", decimal="."):
    stream = io.StringIO()
    rec.frame.to_csv(stream, index=False, sep=delimiter, decimal=decimal)
    return stream.getvalue()


def _same(found, rec):
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces, rec.Q)
    assert found.time == pytest.approx(rec.t, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "delimiter", "decimal", "section"),
    [
        ("m.csv", ",", ".", {}),
        ("m.tsv", "\t", ".", {}),
        ("m.tsv", "\t", ",", {"decimal": ",", "delimiter": "\t"}),
        ("m.tsv", ";", ".", {"delimiter": ";"}),
        ("m.tsv", ",", ".", {}),
        ("m.csv", ";", ",", {"delimiter": ";", "decimal": ","}),
        ("m.TXT", "|", ".", {"delimiter": "|"}),
        ("m.csv", " ", ".", {"delimiter": " "}),
    ],
)
def test_delimiters_and_decimal_marks(name, delimiter, decimal, section, tmp_path, rec, read):
    path = tmp_path / name
    path.write_text(_text(rec, delimiter, decimal))
    _same(read(path, **section), rec)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(encoding, newline, tmp_path, rec, read):
    path = tmp_path / "m.csv"
    text = _text(rec).replace("t,", "Zeit für t,", 1).replace("\n", newline)
    path.write_bytes(text.encode(encoding))
    _same(read(path, columns={"t": "Zeit für t"}), rec)


def test_quoted_cells_further_columns_and_blank_lines_at_the_end(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    header, *lines = _text(rec).splitlines()
    quoted = ",".join(f'"{name}"' for name in header.split(","))
    lines = [f'{line},"a, quoted\nnote"' for line in lines]
    path.write_text("\n".join([f"{quoted},note", *lines, "", "  ", ""]))
    _same(read(path), rec)


def test_the_line_of_a_defect_is_that_of_the_editor_after_quoted_line_breaks(
    tmp_path, rec, refused
):
    path = tmp_path / "m.csv"
    header, *lines = _text(rec).splitlines()
    lines = [f'{line},"two\nlines"' for line in lines]
    lines[3] = lines[3].replace(",", ",x", 1)
    path.write_text("\n".join([f"{header},note", *lines]))
    (problem,) = refused(path)
    assert (problem.line, problem.key) == (8, "q1")


@given(order=st.permutations(CHANNELS))
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_order_of_columns_does_not_matter(order, tmp_path, rec, read):
    path = tmp_path / "m.csv"
    rec.frame[list(order)].to_csv(path, index=False)
    _same(read(path), rec)


@given(
    order=st.permutations(range(6)),
    names=st.lists(
        st.text("abcdefgh XYZ_.:/äµ0123456789", min_size=1, max_size=8).map(str.strip),
        min_size=13,
        max_size=13,
        unique=True,
    ).filter(all),
)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_columns_are_mapped_by_name(order, names, tmp_path, rec, read):
    """The struts of the file in another order, under other names."""
    path = tmp_path / "m.csv"
    struts = [f"{kind}{j + 1}" for kind in "qQ" for j in order]
    frame = rec.frame[["t", *struts]]
    mapping = dict(zip(frame.columns, names, strict=True))
    frame.rename(columns=mapping).to_csv(path, index=False)
    _same(read(path, columns=mapping), rec)


def test_numbers_keep_all_their_digits(tmp_path, read, rec):
    path = tmp_path / "m.csv"
    rec.q *= 1 + np.random.default_rng(3).random(rec.q.shape) * 1e-3
    write_csv(path, rec)
    _same(read(path), rec)


def _form(delimiter=",", **positions):
    return delimited._Form(positions, len(positions), delimiter, ".")


def _slow(lines, form):
    return delimited._read_cells(lines, iter(()), form, 2, 0, {})[0]


def test_slow_and_fast_way_agree(rec):
    rows = [line.split(",") for line in _text(rec).splitlines()[1:]]
    form = _form(**{channel: k for k, channel in enumerate(CHANNELS)})
    lines = [",".join(row) for row in rows]
    fast = delimited._read_numbers(lines, form)
    slow = _slow(lines, form)
    assert all(np.array_equal(fast[channel], slow[channel]) for channel in CHANNELS)


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1.0), (" +1.5e-3 ", 1.5e-3), (".5", 0.5), ("2.", 2.0), ("-7E2", -700.0)],
)
def test_numbers(text, number):
    assert _slow([text], _form(t=0))["t"] == number
    assert delimited._read_numbers([text], _form(t=0))["t"] == number


@pytest.mark.parametrize(
    "text",
    ["", "nan", "inf", "-inf", "1e999", "1_0", "0x1F", "1d3", "1,5", "١", "true", "NA", "−1"],
)
def test_no_numbers(text):
    form = _form(";", t=0)
    assert delimited._read_numbers([text, "1"], form) is None
    assert np.isnan(_slow([text or '""', "1"], form)["t"][0])


def test_a_delimiter_that_is_not_there_is_told(tmp_path, rec, refused):
    path = tmp_path / "m.csv"
    path.write_text(_text(rec, ";"))
    (problem,) = refused(path)
    assert "no delimiter ','" in problem.message
    assert "';'" in problem.allowed
    assert problem.line == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\n\n", "the file is empty"),
        (b"\n1,2\n", "the first line names no columns"),
        (b"\x00\x01\x02", "the file is not text"),
        (b"\xff\xfe\x00", "the file is not text"),
    ],
)
def test_files_without_text(content, message, tmp_path, refused):
    path = tmp_path / "m.csv"
    path.write_bytes(content)
    (problem,) = refused(path)
    assert problem.message == message


def test_twenty_thousand_rows_are_read_in_well_under_a_second(tmp_path, read):
    path = tmp_path / "m.csv"
    rec = recording(20_000)
    write_csv(path, rec)
    read(path)
    seconds = []
    for _ in range(3):
        begin = time.process_time()
        found = read(path)
        seconds.append(time.process_time() - begin)
    assert np.array_equal(found.forces, rec.Q)
    assert min(seconds) < 0.6


def test_the_section_of_a_resolved_run_reads_the_same(tmp_path, rec, read):
    """A resolved run file states every default; that does not make a tab a comma."""
    path = tmp_path / "m.tsv"
    path.write_text(_text(rec, "\t"))
    stated = DataSection().model_dump(mode="json")
    _same(read(path, **stated), rec)


@pytest.fixture
def small_blocks(monkeypatch):
    """Let a block have few lines."""
    monkeypatch.setattr(delimited, "BLOCK", 500)


def _cells(text, changes):
    lines = [line.split(",") for line in text.splitlines()]
    for (line, column), cell in changes.items():
        lines[line - 1][column] = cell
    return "\n".join(map(",".join, lines)) + "\n"


def test_blocks_change_nothing(tmp_path, rec, small_blocks):
    """Whatever stands in some of them: quotes, a cell over two lines, an end of DOS."""
    text = _text(rec)
    path = tmp_path / "m.csv"
    path.write_text(text)
    plain = delimited.read(path, DataSection())
    quoted = {(line, 1): f'"{text.splitlines()[line - 1].split(",")[1]}\n"' for line in (9, 31)}
    path.write_bytes(_cells(text, quoted).replace("\n", "\r\n").encode())
    found = delimited.read(path, DataSection())
    assert len(plain) == len(found)
    assert all(np.array_equal(plain.values[channel], found.values[channel]) for channel in CHANNELS)
    assert [found.row_number(row) for row in (6, 7, 8, 29, 30)] == [8, 9, 11, 32, 34]


NOTES = st.text(st.sampled_from('ab ,"\n'), max_size=12)


@given(
    notes=st.lists(NOTES, min_size=1, max_size=30),
    plain=st.booleans(),
    block=st.integers(1, 60),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rows_are_those_of_pythons_csv_wherever_blocks_end(notes, plain, block, tmp_path):
    """Quoted line breaks reach over the ends of blocks, and quotes within a cell are not opened."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)
    writer.writerow([*CHANNELS, "note"])
    for number, note in enumerate(notes):
        writer.writerow([number + column / 16 for column in range(len(CHANNELS))] + [note])
    text = stream.getvalue()
    if plain:  # as someone writes who knows of no quoting: an inch mark in the midst of a cell
        text += ",".join(["0"] * len(CHANNELS)) + ',5" pipe\n'
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(delimited, "BLOCK", block)
        found = delimited.read(path, DataSection())
    reader, rows, begins = csv.reader(io.StringIO(text)), [], []
    next(reader)
    begin = reader.line_num
    for cells in reader:
        rows.append([float(cell) for cell in cells[:-1]])
        begins.append(begin + 1)
        begin = reader.line_num
    table = np.stack([found.values[channel] for channel in CHANNELS], axis=1)
    assert np.array_equal(table, rows)
    assert [found.row_number(row) for row in range(len(found))] == begins


def test_a_quote_that_has_no_end_is_refused(tmp_path, rec, small_blocks, refused):
    """However its row goes on: as one cell, or as cells that all end in another line."""
    header, first, *others = _text(rec).splitlines()
    head = [f"{header},note", f"{first},1"]
    opened = [f'{others[0]},"open', *[f"{line},1" for line in 2000 * others[1:3]]]
    endless = [f'{others[0]},"', *['","' * 21] * 20_000]
    for rest in (opened, endless, [f'{others[0]},"{"x" * 200_000}"']):
        path = tmp_path / "m.csv"
        path.write_text("\n".join(head + rest))
        (problem, *_) = refused(path)
        assert problem.line == 3
    path.write_text("\n".join([f'{header},"{"x" * 200_000}"', *others]))
    (problem,) = refused(path)
    assert problem.line == 1


def test_bad_cells_of_any_block_are_told(tmp_path, rec, small_blocks, refused):
    text = _cells(_text(rec), {(5, 3): "oops", (40, 0): "", (60, 12): "nan"})
    path = tmp_path / "m.csv"
    path.write_text(text)
    found = [(p.line, p.message) for p in refused(path)]
    assert [line for line, _ in found] == [5, 40, 60]
    assert "oops" in found[0][1]


def test_lines_with_other_columns_are_counted_over_all_blocks(tmp_path, rec, small_blocks, refused):
    lines = _text(rec).splitlines()
    for number in range(5, 45, 5):
        lines[number - 1] += ",1"
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines))
    *first, more = refused(path)
    assert [p.line for p in first] == [5, 10, 15, 20, 25]
    assert "3 more" in more.message


def test_blank_lines_count_only_before_text(tmp_path, rec, small_blocks, refused):
    path = tmp_path / "m.csv"
    path.write_text(_text(rec) + "\n" * 3000)
    assert len(delimited.read(path, DataSection())) == len(rec.t)
    lines = _text(rec).splitlines()
    path.write_text("\n".join([*lines[:20], *[""] * 3000, *lines[20:]]))
    *first, more = refused(path)
    assert [p.line for p in first] == [21, 22, 23, 24, 25]
    assert "2995 more" in more.message


def test_a_line_without_end_is_refused(tmp_path, rec, monkeypatch, refused):
    monkeypatch.setattr(delimited, "BLOCK", 500)
    monkeypatch.setattr(delimited, "LONGEST_LINE", 1000)
    lines = _text(rec).splitlines()
    lines[6] += " " * 1000
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines))
    (problem,) = refused(path)
    assert problem.line == 7


def test_of_very_many_texts_the_first_are_told(tmp_path, rec, monkeypatch, refused):
    monkeypatch.setattr(delimited, "_MOST_TEXTS", 2)
    path = tmp_path / "m.csv"
    path.write_text(_cells(_text(rec), {(line, 2): f"no{line}" for line in range(3, 33)}))
    *first, more = refused(path)
    assert [("no" in p.message.split()[0]) for p in first[:2]] == [True, True]
    assert [p.line for p in first] == [3, 4, 5, 6, 7]
    assert "25 more" in more.message
