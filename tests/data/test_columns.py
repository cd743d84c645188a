"""Which column is which channel."""

from pathlib import Path

import pytest

from estimation.data.table import RecordedColumn, header_column, pick_columns
from expdesign.configuration import InputError
from tests.data.recordings import CHANNELS

FILE = Path("m.csv")


def _columns(*texts):
    return [header_column(text, place) for place, text in enumerate(texts)]


def _problems(columns, names):
    with pytest.raises(InputError) as caught:
        pick_columns(columns, names, FILE, 1)
    return caught.value.problems


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("q1", "q1", None),
        (" q1 [mm] ", "q1", "mm"),
        ("q1[mm]", "q1", "mm"),
        ("Q1 (kN)", "Q1", "kN"),
        ("Weg 1 [µm]", "Weg 1", "µm"),
        ("F[1]", "F[1]", None),
        ("F(2)", "F(2)", None),
        ("n [-]", "n", None),
        ("n []", "n", None),
        ("[mm]", "[mm]", None),
    ],
)
def test_units_in_headers(text, name, unit):
    column = header_column(text, 0)
    assert (column.text, column.name, column.unit) == (text.strip(), name, unit)


def test_names_of_the_channels_are_the_default():
    picked = pick_columns(_columns(*CHANNELS[::-1], "other"), {}, FILE)
    assert {channel: column.text for channel, column in picked.items()} == {
        channel: channel for channel in CHANNELS
    }


def test_period_is_taken_when_it_is_there_and_missed_when_it_is_named():
    assert "period" in pick_columns(_columns(*CHANNELS, "period"), {}, FILE)
    (problem,) = _problems(_columns(*CHANNELS), {"period": "turn"})
    assert problem.message == "there is no column 'turn' for period"


def test_full_name_before_the_one_without_unit():
    columns = _columns("q1 [mm]", "q1", *CHANNELS[2:], "t")
    assert pick_columns(columns, {}, FILE)["q1"].text == "q1"
    assert pick_columns(columns, {"q1": "q1 [mm]"}, FILE)["q1"].text == "q1 [mm]"


def test_a_file_without_any_channel_is_refused_once():
    (problem,) = _problems(_columns("parameter", "unit", "value"), {})
    assert problem.message.startswith("this is not a recording, or its columns have other names")
    assert "'parameter', 'unit', 'value'" in problem.allowed
    assert "init-data" in problem.allowed


def test_a_missing_column_names_the_nearest_and_what_is_there():
    (problem,) = _problems(_columns(*CHANNELS[:-1], "Weg_3"), {"Q6": "Weg3"})
    assert problem.message == "there is no column 'Weg3' for Q6"
    assert (problem.file, problem.line, problem.key) == (FILE, 1, "Weg3")
    assert problem.nearest == "Weg_3"
    assert "'Weg_3'" in problem.allowed


def test_a_missing_column_of_a_file_without_another_one_says_so():
    (problem,) = _problems(_columns(*CHANNELS[:-1]), {"Q6": "Weg6"})
    assert "none is left" in problem.allowed


def test_the_nearest_column_is_one_that_is_free():
    """A length must not be offered the force of the same strut."""
    (problem,) = _problems(_columns(*(c for c in CHANNELS if c != "q3"), "q_3"), {})
    assert problem.nearest == "q_3"


def test_time_by_another_name_is_offered():
    (problem,) = _problems(_columns("Time", *CHANNELS[1:]), {})
    assert (problem.key, problem.nearest) == ("t", "Time")


def test_every_missing_column_is_told():
    problems = _problems(_columns("t"), {})
    assert [problem.key for problem in problems] == list(CHANNELS[1:])


def test_long_lists_are_cut():
    (problem,) = _problems(_columns(*CHANNELS[:-1], *(f"x{k}" for k in range(100))), {})
    assert problem.allowed.endswith("and 70 more")


def test_a_name_that_occurs_twice_is_no_choice():
    problems = _problems(_columns(*CHANNELS, "q2"), {})
    assert problems[0].message == "2 columns have the name of q2"
    (problem,) = _problems(_columns("q1 [mm]", "q1 [in]", *CHANNELS[2:], "t"), {})
    assert problem.message == "several columns could be q1"
    assert "'q1 [mm]', 'q1 [in]'" in problem.allowed


def test_one_column_cannot_be_two_channels():
    """A mapping that swaps two struts but forgets one of them."""
    (problem,) = _problems(_columns(*CHANNELS), {"q1": "q2"})
    assert problem.message == "one column for both q1 and q2"
    assert problem.key == "q2"


def test_names_in_groups_are_enough_when_unique():
    columns = [RecordedColumn(f"rec.{c}", c, short=c) for c in CHANNELS]
    assert pick_columns(columns, {}, FILE)["q4"].text == "rec.q4"
    problems = _problems([*columns, RecordedColumn("set.q4", "other", short="q4")], {})
    assert "'rec.q4', 'set.q4'" in problems[0].allowed


def test_a_file_without_columns():
    assert "the file has none" in _problems([], {})[0].message


def test_names_with_control_codes_are_shown_harmlessly():
    problems = _problems(_columns("\x1b[2Jq1", *CHANNELS[2:], "t"), {})
    assert "\\x1b[2Jq1" in problems[0].allowed
    assert str(problems[0]).isprintable()
