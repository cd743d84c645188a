"""Text files: names, delimiters, decimal marks, encodings, lines."""

import io
import time
from pathlib import Path

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


def _slow(lines, positions, delimiter):
    return delimited._slow(
        lines, positions, delimiter, ".", width=len(positions), path=Path("m.csv")
    )[0]


def test_slow_and_fast_way_agree(rec):
    rows = [line.split(",") for line in _text(rec).splitlines()[1:]]
    positions = {channel: k for k, channel in enumerate(CHANNELS)}
    lines = [",".join(row) for row in rows]
    fast = delimited._fast(lines, positions, ",", ".")
    slow = _slow(lines, positions, ",")
    assert all(np.array_equal(fast[channel], slow[channel]) for channel in CHANNELS)


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1.0), (" +1.5e-3 ", 1.5e-3), (".5", 0.5), ("2.", 2.0), ("-7E2", -700.0)],
)
def test_numbers(text, number):
    positions = {"t": 0}
    assert _slow([text], positions, ",")["t"] == number
    assert delimited._fast([text], positions, ",", ".")["t"] == number


@pytest.mark.parametrize(
    "text",
    ["", "nan", "inf", "-inf", "1e999", "1_0", "0x1F", "1d3", "1,5", "١", "true", "NA", "−1"],
)
def test_no_numbers(text):
    positions = {"t": 0}
    assert delimited._fast([text, "1"], positions, ";", ".") is None
    assert np.isnan(_slow([text or '""', "1"], positions, ";")["t"][0])


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
        (b"\x00\x01\x02", "the file is no text"),
        (b"\xff\xfe\x00", "the file is no text"),
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
