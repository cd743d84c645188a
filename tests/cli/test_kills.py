"""A run that is killed again and again comes to the same end as one that is left alone."""

import json
import signal

import pytest

from expdesign.runfolder.lock import LOCK, Holder
from tests.killed_runs import contents, ended_at, ended_in_copy, stages, untrue

STAGES = ["design", "experiment", "montecarlo", "estimate", "validate"]
MOMENTS = (
    # What it was about to write, for the n-th time; the signal; how many stages are done then.
    (("design.json", 1), signal.SIGKILL, 0),
    # The manifest does not know yet that columns.json has grown.
    (("measurement.csv", 1), signal.SIGKILL, 1),
    (("repetitions.jsonl", 2), signal.SIGTERM, 2),
    (("estimate.json", 1), signal.SIGKILL, 3),
    # In the midst of saving: that is completed.
    (("validation.json", 1), signal.SIGTERM, 5),
)


@pytest.mark.slow
def test_a_run_that_is_killed_in_every_stage(expdesign, tiny, few_limits, tmp_path):
    sections = {
        "robot": few_limits,
        "design": {"smoothing": [0.4], "max_iterations": 4},
        "montecarlo": {"repetitions": 3, "estimators": ["ls"]},
        "estimate": {"estimators": ["ls"]},
        "validate": [{"motion": "circle", "periods": 3}],
        "export": [{"format": "xps-pvt", "segment": 0.02, "tolerance": 2e-4, "scale": 0.3}],
        "report": {"figures": ["svg"]},
    }
    file, folder, alone = tmp_path / "run.yaml", tmp_path / "out", tmp_path / "alone"
    file.write_text(json.dumps(tiny(**sections)), encoding="utf-8")
    # After it the copies of this process have all at hand; the last life is a process of its own.
    status, _, messages = expdesign("run", file, "--out", alone)
    assert status == 0, messages
    for moment, number, done in MOMENTS:
        life = ended_in_copy(moment, number, ("run", file, "--out", folder))
        killed = number == signal.SIGKILL
        assert life.returncode == (-number if killed else 1), life.stderr
        assert "Traceback" not in life.stderr
        hidden = {path.name for path in folder.rglob(".*")}
        assert len(hidden - {LOCK, Holder.FILE}) == killed
        assert killed or not hidden
        assert set(untrue(folder)) <= {"columns.json"}
        kept = stages(folder) if (folder / "manifest.json").exists() else {}
        assert [name for name, status in kept.items() if status == "done"] == STAGES[:done]
    last = ended_at(None, number, ("run", file, "--out", folder, "--json"))
    assert last.returncode == 0, last.stderr
    assert json.loads(last.stdout)["stages"].keys() >= {"design", "export", "report"}
    for name in STAGES:
        assert json.loads(last.stdout)["stages"][name]["resumed"], name
    assert untrue(folder) == []
    found, wanted = contents(folder), contents(alone)
    assert found.keys() == wanted.keys()
    for name, content in wanted.items():
        assert found[name] == content, name
