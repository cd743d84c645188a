"""The run that most tests use: PaLiDA with two harmonics, designed in seconds."""

import copy

from ruamel.yaml import YAML
from typer.testing import CliRunner

from expdesign.cli.app import app

_TINY = {
    "name": "tiny",
    "robot": "palida",
    "trajectory": {
        "harmonics": 2,
        "frequency": [0.2, 0.6],
        "samples": 24,
        "controller_period": 0.01,
    },
    "design": {
        "starts": 1,
        "seed": 0,
        "search": "restarts",
        "smoothing": [0.4, 0.2],
        "max_iterations": 10,
    },
    "experiment": {"sampling": 100, "periods": 3},
    "workers": 1,
}


def tiny_run(**changes):
    """Return the run as a mapping; keywords change sections."""
    found = copy.deepcopy(_TINY)
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(found.get(key, {}), dict):
            found[key] = {**found.get(key, {}), **value}
        else:
            found[key] = value
    return found


def run_every_stage(folder, *, title="tiny", design=None):
    """Make a run folder with every stage by the command line.

    `design`, if given, is the design, which is not searched again.
    """
    run = tiny_run(
        description=f"All stages of {title}",
        experiment={"seed": 3},
        estimate={"estimators": ["gm", "ml"]},
        validate=[{"motion": "circle", "periods": 3}],
        montecarlo={"repetitions": 3, "estimators": ["ls"]},
        report={"title": f"Report of {title}", "figures": ["svg"]},
    )
    if design is not None:
        design.write(folder)
        del run["design"]
    file = folder.parent / "run.yaml"
    with file.open("w", encoding="utf-8") as stream:
        YAML(typ="safe").dump(run, stream)
    found = CliRunner().invoke(app, ["run", str(file), "--out", str(folder)])
    assert found.exit_code == 0, (found.output, found.exception)
