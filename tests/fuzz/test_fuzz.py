"""Inputs changed at random, some of each kind: used or refused, in few words, nothing half done.

`make soak ARGS=inputs` tries them by the thousand, with bounds on time and memory; the same seed
and number make the same input there and here.
"""

import copy
import os

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimation.data.formats import FileFormat
from tests.blank_figures import blank_figures
from tests.data.forked import load_forked
from tests.fuzz.mutation import HOSTILE, at, places
from tests.fuzz.oracle import BrokenError, command, judge, whole
from tests.fuzz.targets import _robots, _runs, attempt, seeds_text

pytestmark = pytest.mark.slow

COUNTS = {
    "run": 60,
    "robot": 60,
    "measurement": 100,
    "table": 60,
    "record": 40,
    "report": 4,
    "markup": 3,
    "machine": 50,
    "binary": 20,
}
SEED = int(os.environ.get("EXPDESIGN_FUZZ_SEED", "0"))


@pytest.mark.parametrize("name", COUNTS)
def test_inputs_that_are_nearly_right(name, tmp_path, monkeypatch):
    monkeypatch.setattr(FileFormat, "_load_apart", load_forked)
    options = {"quick": True} if name == "machine" else {}
    with blank_figures():
        for number in range(COUNTS[name]):
            folder = tmp_path / str(number)
            folder.mkdir()
            try:
                attempt(name, SEED, number, folder, **options)
            except Exception as error:
                error.add_note(
                    f"the input is in {folder}; again with {seeds_text(name, SEED, number)}"
                )
                raise


VALUES = st.recursive(
    st.one_of(
        st.sampled_from([h for h in HOSTILE if not isinstance(h, list | dict)]),
        st.integers(),
        st.floats(),
        st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=7), st.dictionaries(st.text(max_size=6), inner, max_size=3)
    ),
    max_leaves=8,
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data(), value=VALUES)
def test_any_value_at_any_key(tmp_path_factory, data, value):
    """What hypothesis finds it also makes small."""
    robot = data.draw(st.booleans())
    content = copy.deepcopy(data.draw(st.sampled_from(_robots() if robot else _runs())))
    *inside, key = data.draw(st.sampled_from(list(places(content))))
    at(content, inside)[key] = value
    folder = tmp_path_factory.getbasetemp() / "any-value"
    folder.mkdir(exist_ok=True)
    run = {"name": "fuzz", "robot": "robot.yaml"} if robot else content
    (folder / "robot.yaml").write_text(yaml.safe_dump(content if robot else {}))
    (folder / "run.yaml").write_text(yaml.safe_dump(run))
    command("check", folder / "run.yaml")


def test_the_oracle_can_fail(tmp_path):
    for status, output, error in (
        (3, "", "error"),
        (1, "", "Traceback (most recent call last)"),
        (2, "", ""),
        (2, "", "error\n" * 1000),
        (2, "", "x" * 100_000),
        (0, "canary-7fd1c0", ""),
    ):
        with pytest.raises(BrokenError):
            judge(status, output, error)
    judge(0, "much\n" * 1000, "")
    judge(2, "", "error: what is wrong\n")
    (tmp_path / ".run.yaml.x1").touch()
    with pytest.raises(BrokenError):
        whole(tmp_path)
