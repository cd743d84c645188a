"""Recordings of the twin are read with the section `data` that wrote them."""

import numpy as np
import pytest

from estimation.data.reading import read_measurement
from estimation.twin import Twin
from estimation.twin.truth import write_measurement
from expdesign.configuration import InputError, load_run
from tests.estimation.cases import trajectory

Q = [f"q{j}" for j in range(1, 7)]
F = [f"Q{j}" for j in range(1, 7)]
TWO = {"lengths": "lengths.csv", "forces": "forces.csv"}
MOTION = trajectory()


def _written(data, path):
    run = {"experiment": {"periods": 2, "sampling": "200 Hz"}, "data": data}
    configuration = load_run({"name": "case", "robot": "palida", **run})
    made = Twin.of(configuration, MOTION).measurement(1)
    write_measurement(made, path, configuration)
    return made, read_measurement(path, configuration.run.data, configuration.robot)


@pytest.mark.parametrize(
    "data",
    [
        {"header": {"before": 3}},
        {"header": {"after": 2}, "delimiter": ";", "decimal": ","},
        {"header": {"names": ["t", *Q, *F]}},
        {
            "header": {"before": 1, "after": 1, "names": ["row", *F, "Zeit", *Q]},
            "columns": {"t": "Zeit"},
            "units": {"q": "mm", "t": "ms"},
        },
        {"sampling": "200 Hz"},
        {"files": TWO},
        {"files": TWO, "columns": {"t": "a", "tQ": "b"}},
    ],
)
def test_a_recording_is_read_with_the_section_that_wrote_it(data, tmp_path):
    made, found = _written(data, tmp_path / "measurement.csv")
    for channel in ("time", "lengths", "forces"):
        np.testing.assert_allclose(getattr(found, channel), getattr(made, channel), atol=1e-12)
    names = (tmp_path / "measurement.csv").read_text().split("\n", 1)[0]
    assert ("sampling" in data) <= (not names.startswith("t,"))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"sampling": "100 Hz"}, "allowed: experiment.sampling, 200 Hz"),
        (
            {"files": TWO, "columns": {**dict(zip(Q, F, strict=True)), **{f: f for f in F}}},
            "where 'Q1' is both",
        ),
    ],
)
def test_a_section_of_other_files_is_refused(data, words, tmp_path):
    with pytest.raises(InputError) as refused:
        _written(data, tmp_path / "measurement.csv")
    assert words in str(refused.value)
