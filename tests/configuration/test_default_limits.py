"""Rotations that nobody bounds stay near home, unless that is lifted; what was resolved before that
was so keeps what it had.
"""

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml

HOME = [0, 0, -0.654, "2 deg", "-3 deg", "10 deg"]
EVERY = {"phi": (-28, 32), "theta": (-33, 27), "psi": (-20, 40)}
FREE = (-np.inf, np.inf)
PSI = {"psi": ["-5 deg", "70 deg"]}
NONE = "none"


@pytest.fixture
def turned(robot_mapping):
    """Make a run of PaLiDA, turned at home, with rotation limits of robot and run."""

    def run(own=None, of_the_run=None, **keys):
        limits = {"tilt": "30 deg"} | ({} if own is None else {"rotation": own})
        mapping = {"name": "n", "robot": robot_mapping | {"home": HOME, "limits": limits}, **keys}
        return mapping | ({} if of_the_run is None else {"limits": {"rotation": of_the_run}})

    return run


def _rotation(configuration):
    """Return the bounds, deg, and which of them are there by default."""
    limit = configuration.robot.limits.get("rotation")
    if limit is None:
        return None, ()
    ends = np.degrees([limit.lower, limit.upper]).T.round(9).tolist()
    return dict(zip(limit.labels, map(tuple, ends), strict=True)), limit.by_default


@pytest.mark.parametrize(
    ("own", "of_the_run", "bounds", "by_default"),
    [
        (None, None, EVERY, ("phi", "theta", "psi")),
        (PSI, None, EVERY | {"psi": (-5, 70)}, ("phi", "theta")),
        (None, PSI, EVERY | {"psi": (-5, 70)}, ("phi", "theta")),
        (PSI, {"phi": ["-1 deg", "1 deg"]}, {**EVERY, "phi": (-1, 1), "psi": (-5, 70)}, ("theta",)),
        (NONE, None, None, ()),
        (PSI, NONE, None, ()),
        # What the run gives counts, and what the robot has lifted stays so.
        (NONE, PSI, {"phi": FREE, "theta": FREE, "psi": (-5, 70)}, ()),
        ({"psi": NONE}, None, EVERY | {"psi": FREE}, ("phi", "theta")),
        (PSI, {"psi": NONE}, EVERY | {"psi": FREE}, ("phi", "theta")),
        (dict.fromkeys(EVERY, NONE), None, None, ()),
    ],
)
def test_what_limits_the_rotation(turned, tmp_path, own, of_the_run, bounds, by_default):
    made = load_run(turned(own, of_the_run))
    found, assumed = _rotation(made)
    assert assumed == by_default
    assert (found is None) == (bounds is None)
    for name in bounds or ():
        assert found[name] == pytest.approx(bounds[name], abs=1e-9)
    # Resolved it is stated, whatever it is.
    file = tmp_path / "run.yaml"
    file.write_text(resolved_yaml(made), encoding="utf-8")
    again = load_run(file)
    assert _rotation(again) == (found, ())
    assert again.run == made.run
    assert _rotation(load_run({"name": "m", "robot": made.run.robot.model_dump()})) == (found, ())


@pytest.mark.parametrize("own", ["no", [-1, 1], {"phi": "nothing"}, {"phi": None}, {}])
def test_what_does_not_lift_it(turned, own):
    with pytest.raises(InputError) as caught:
        load_run(turned(own))
    (problem,) = caught.value.problems
    assert problem.key == "robot.limits.rotation"
    assert NONE in problem.allowed


def test_other_limits_have_no_default_to_lift(turned):
    run = turned()
    run["limits"] = {"position": NONE, "tilt": NONE}
    with pytest.raises(InputError) as caught:
        load_run(run)
    assert [problem.key for problem in caught.value.problems] == ["limits.position", "limits.tilt"]
