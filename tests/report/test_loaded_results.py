"""Results of a run folder in Python, in a program that did none of the stages."""

import subprocess
import sys

import pytest

import expdesign
from expdesign.configuration import InputError

SHOWN = """
import sys, expdesign
for name, result in expdesign.load_results(sys.argv[1]).items():
    print(name, "|", repr(result).splitlines()[0], "|", len(result.view.tables))
    result.view.facts, list(result.view.figures), result._repr_html_()
"""


def test_every_result_shows_itself(whole):
    command = [sys.executable, "-c", SHOWN, str(whole)]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = dict(line.split(" | ", 1) for line in shown.splitlines())
    assert {"design", "estimate", "validate"} <= set(found)
    for name, text in found.items():
        sentence, tables = text.split(" | ")
        # A title and a verdict, not the class and an address.
        assert not sentence.startswith("<"), name
        assert ": " in sentence, name
        assert int(tables) > 0, name
    assert found["estimate"].startswith("Estimate: ")


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(InputError, match="no results"):
        expdesign.load_results(tmp_path)
