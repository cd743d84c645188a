"""Two runs with the same seeds: the same tables, byte by byte, for one worker and for two."""

import json

import pytest
from ruamel.yaml import YAML

STAGES = {
    "design": {"starts": 2, "search": "restarts", "smoothing": [0.4], "max_iterations": 4},
    "experiment": {"seed": 3},
    "montecarlo": {"repetitions": 3, "estimators": ["ls", "ml"]},
    "estimate": {},
    "validate": [{"motion": "circle", "periods": 3}],
    "report": {"figures": ["svg"]},
}


@pytest.fixture
def folders(tiny, few_limits, tmp_path, monkeypatch, expdesign):
    """Return the run folders of one worker and of two; where they were made looks the same."""
    made = []
    for workers in (1, 2):
        place = tmp_path / f"{workers}"
        place.mkdir()
        monkeypatch.chdir(place)
        with (place / "run.yaml").open("w", encoding="utf-8") as stream:
            YAML(typ="safe").dump(tiny(**STAGES, robot=few_limits, workers=workers), stream)
        for command in (("run", "run.yaml"), ("noise", "run.yaml")):
            status, out, error = expdesign(*command)
            assert status == 0, (command, out, error)
        made.append(place / "runs" / "tiny")
    return made


def without_times(value):
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if not k.endswith("seconds")}
    return [without_times(v) for v in value] if isinstance(value, list) else value


@pytest.mark.slow
def test_tables_are_the_same_bytes(folders):
    one, two = folders
    tables = {path.relative_to(one) for path in one.rglob("*.csv")}
    assert tables == {path.relative_to(two) for path in two.rglob("*.csv")}
    names = {table.name for table in tables}
    wanted = {"trajectory", "measurement", "estimates", "starts", "montecarlo", "validation"}
    assert {f"{name}.csv" for name in wanted} <= names
    assert "noise_covariance.csv" in names
    for table in sorted(tables):
        content = (one / table).read_bytes()
        assert content == (two / table).read_bytes(), table
        assert b"seconds" not in content.partition(b"\n")[0], table
    for name in ("design", "truth", "montecarlo", "estimate", "validation"):
        documents = [
            json.loads((place / f"{name}.json").read_text(encoding="utf-8")) for place in folders
        ]
        for document in documents:
            # Where it stands is not what it says.
            document.pop("estimate", None)
            for recording in document.get("recordings", ()):
                recording.pop("source")
        assert without_times(documents[0]) == without_times(documents[1]), name
