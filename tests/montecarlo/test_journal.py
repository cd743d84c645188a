"""The journal: exact, whole lines only, of one study only."""

import json
from operator import attrgetter

import numpy as np
import pytest

from estimation.montecarlo.result import Repetition, RepetitionEstimate
from expdesign.runfolder.journal import Journal


def journal_of(path, inputs):
    return Journal(path, inputs, Repetition, attrgetter("number"))


def repetition(number, freedom=720.0):
    rng = np.random.default_rng(number)
    return Repetition(
        number,
        5,
        freedom,
        {
            "gm": RepetitionEstimate(*rng.uniform(size=(3, 24)), True, 1),
            "ml": RepetitionEstimate(error="no pose has the measured lengths"),
        },
    )


def same(first, second):
    assert (first.number, first.harmonics, first.freedom) == (
        second.number,
        second.harmonics,
        second.freedom,
    )
    for name in ("gm", "ml"):
        a, b = first.outcomes[name], second.outcomes[name]
        assert (a.converged, a.iterations, a.error) == (b.converged, b.iterations, b.error)
        for x, y in ((a.values, b.values), (a.std, b.std), (a.widths, b.widths)):
            np.testing.assert_array_equal(x, y)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "montecarlo" / "repetitions.jsonl"


def fill(path, numbers, inputs="a"):
    journal = journal_of(path, inputs)
    for number in numbers:
        journal.add(repetition(number))
    return journal


def test_every_digit_comes_back(path):
    fill(path, [3, 1])
    again = journal_of(path, "a")
    assert set(again.done) == {1, 3}
    for number, found in again.done.items():
        same(found, repetition(number))


def test_a_given_noise_has_no_end_of_freedom(path):
    journal_of(path, "a").add(repetition(1, np.inf))
    assert journal_of(path, "a").done[1].freedom == np.inf
    for line in path.read_text(encoding="utf-8").splitlines():
        json.loads(line, parse_constant=pytest.fail)


def test_nothing_is_written_before_there_is_something(path):
    journal_of(path, "a")
    assert not path.parent.exists()


@pytest.mark.parametrize("cut", [1, 20, 300])
def test_a_line_that_a_crash_cut_is_done_again(path, cut):
    fill(path, [1, 2, 3])
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    journal = journal_of(path, "a")
    assert set(journal.done) == {1, 2}
    journal.add(repetition(3))
    assert path.read_bytes() == whole


def test_a_line_that_is_none_ends_what_counts(path):
    fill(path, [1, 2])
    path.write_bytes(path.read_bytes() + b'{"number": 3}\n' + b"\xff\n")
    assert set(journal_of(path, "a").done) == {1, 2}


def test_a_journal_of_other_inputs_is_replaced_by_the_first_that_is_done(path):
    fill(path, [1, 2])
    before = path.read_bytes()
    journal = journal_of(path, "b")
    assert journal.done == {}
    assert path.read_bytes() == before
    journal.add(repetition(7))
    assert set(journal_of(path, "b").done) == {7}
    assert journal_of(path, "a").done == {}
