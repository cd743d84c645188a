"""`sweep:`: which grids there are, and what their points are."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.design import MOST_DESIGNS, path_units
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.schema import LONGEST_NAME
from expdesign.configuration.several_runs import resolved_cell

LIMITS = load_robot_description("palida").limits


def run(**sections):
    return {"name": "run", "robot": "palida", **sections}


def problems(**sections):
    with pytest.raises(InputError) as error:
        load_run(run(**sections))
    return error.value.problems


def resolved(configuration):
    """What a run says without its name."""
    return configuration.run.model_dump(exclude={"name"})


VALUES = {
    "trajectory.harmonics": st.integers(1, 12),
    "trajectory.frequency": st.sampled_from([0.25, "0.5 Hz", [0.2, 0.4], ["100 mHz", 0.3]]),
    "design.criterion": st.sampled_from(["d", "a", "e", "condition"]),
    "design.seed": st.integers(0, 10**6),
    "experiment.sampling": st.sampled_from([100, "200 Hz", "1 kHz"]),
    "limits.strut_speed": st.sampled_from([1, "1500 mm/s", [-1, 2]]),
    "limits.actuator_force": st.sampled_from([200, "0.21 kN", [200, 201, 202, 203, 204, 205]]),
    "limits.position.z": st.sampled_from([[-0.7, -0.6], ["-0.7 m", "-55 cm"]]),
    "limits.reserve": st.sampled_from([0, "5 %", 0.1]),
}
GRIDS = st.dictionaries(st.sampled_from(sorted(VALUES)), st.none(), min_size=1, max_size=3).flatmap(
    lambda paths: st.fixed_dictionaries(
        {
            path: st.lists(VALUES[path], min_size=1, max_size=3, unique_by=json.dumps)
            for path in paths
        }
    )
)


def written(sweep, place):
    """Return a run file with values where their paths say."""
    data = run(design={})
    for path, k in zip(sweep, place, strict=True):
        section, *keys, last = path.split(".")
        target = data.setdefault(section, {})
        for key in keys:
            target = target.setdefault(key, {})
        value = sweep[path][k]
        single = path == "trajectory.frequency" and not isinstance(value, list)
        target[last] = [value, value] if single else value
    return data


@given(GRIDS)
@settings(max_examples=30)
def test_a_point_is_the_run_with_its_values_in_place(sweep):
    points = load_run(run(sweep=sweep)).grid
    places = list(np.ndindex(*(len(values) for values in sweep.values())))
    assert len(points) == len(places)
    for point, place in zip(points, places, strict=True):
        assert point.values == {p: sweep[p][k] for p, k in zip(sweep, place, strict=True)}
        alone = load_run(written(sweep, place))
        assert resolved(point.configuration) == resolved(alone)
        assert point.configuration.run.stages == alone.run.stages
        assert not point.configuration.grid
    assert len({point.name for point in points}) == len(points)


@given(GRIDS)
@settings(max_examples=30)
def test_the_resolved_run_has_the_same_points(sweep):
    sections = {"limits": {"tilt": "15 deg"}, "trajectory": {"samples": 100}, "design": {}}
    one = load_run(run(sweep=sweep, **sections))
    text = resolved_yaml(one)
    other = load_run(_parsed(text))
    assert resolved_yaml(other) == text
    for first, second in zip(one.grid, other.grid, strict=True):
        assert resolved_yaml(first.configuration) == resolved_yaml(second.configuration)
        assert first.name == second.name


def _parsed(text):
    from ruamel.yaml import YAML

    return YAML(typ="safe").load(text)


def test_another_value_leaves_the_names_of_the_others():
    few, many = (
        {
            point.name: point.values
            for point in load_run(run(sweep={"design.seed": seeds, "design.starts": [1, 2]})).grid
        }
        for seeds in ([3, 5], [1, 3, 4, 5])
    )
    assert few.items() <= many.items()


def test_names_are_short_and_apart():
    sweep = {
        "limits.position": [{"z": [-0.7, -0.6 - 0.001 * k], "x": [-0.1, 0.1]} for k in range(3)],
        "design.parameters": [["p1"], ["p1", "p2"], "all"],
        # Both become the same letters.
        "limits.strut_speed": ["1 m/s", "1m/s"],
    }
    points = load_run({**run(sweep=sweep), "name": "n" * 60}).grid
    names = [point.configuration.run.name for point in points]
    assert len(set(names)) == len(points) == 18
    assert max(map(len, names)) <= LONGEST_NAME


@pytest.mark.parametrize(
    ("path", "wrong", "meant"),
    [
        ("trajectory.harmonix", "trajectory.harmonix", "trajectory.harmonics"),
        ("harmonics", "harmonics", "trajectory.harmonics"),
        ("limits.actuator_forces", "limits.actuator_forces", "limits.actuator_force"),
        ("limits.position.zz", "limits.position.zz", "limits.position.z"),
        ("workers", "workers", None),
    ],
)
def test_a_path_that_is_none(path, wrong, meant):
    (problem,) = problems(sweep={path: [1]})
    assert problem.key == f"sweep.{wrong}"
    assert meant in (None, problem.nearest)


def test_the_number_of_designs_is_bounded():
    (problem,) = problems(sweep={"design.seed": list(range(MOST_DESIGNS + 1))})
    assert problem.key == "sweep.design.seed"
    (problem,) = problems(sweep={"design.seed": list(range(100)), "design.hops": [1, 2, 3]})
    assert "100 · 3 = 300 designs" in problem.message


def test_the_value_to_blame_is_named_wherever_it_is_seen():
    sweep = {"design.criterion": ["d", "a"], "trajectory.harmonics": [3, 60]}
    (problem,) = problems(sweep=sweep)
    assert problem.key == "sweep.trajectory.harmonics[2]"
    assert "trajectory.samples: 200 samples are too few" in problem.message


def test_values_that_do_not_fit_each_other():
    sweep = {"trajectory.harmonics": [5, 60], "trajectory.samples": [100, 300]}
    (problem,) = problems(sweep=sweep)
    assert problem.key == "sweep"
    assert "trajectory.harmonics 60, trajectory.samples 100" in problem.message


def test_what_stands_in_the_file_is_told_by_its_line(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("name: a\nrobot: palida\nsweep:\n  design.criterion:\n  - d\n  - x\n")
    with pytest.raises(InputError) as error:
        load_run(file)
    (problem,) = error.value.problems
    assert (problem.file, problem.line) == (file, 6)


@given(factor=st.floats(0.5, 1.5), key=st.sampled_from(["strut_speed", "tilt", "strut_clearance"]))
@settings(max_examples=30)
def test_a_bound_is_multiplied(factor, key):
    base = LIMITS[key]
    (point,) = load_run(run(sweep={f"limits.{key}.scale": [factor]})).grid
    limit = point.configuration.robot.limits[key]
    np.testing.assert_allclose(limit.lower, factor * base.lower, rtol=1e-12)
    np.testing.assert_allclose(limit.upper, factor * base.upper, rtol=1e-12)
    assert resolved_cell(f"limits.{key}.scale", point) == json.dumps(factor)


@given(factor=st.floats(0.7, 1.2))
@settings(max_examples=30)
def test_a_range_is_widened_about_its_middle(factor):
    base = LIMITS["strut_length"]
    (point,) = load_run(run(sweep={"limits.strut_length.scale": [factor]})).grid
    limit = point.configuration.robot.limits["strut_length"]
    np.testing.assert_allclose(limit.lower + limit.upper, base.lower + base.upper, rtol=1e-12)
    np.testing.assert_allclose(limit.range, factor * base.range, rtol=1e-9)


def test_the_runs_own_limits_are_scaled():
    sweep = {"limits.strut_speed.scale": [0.5]}
    (point,) = load_run(run(limits={"strut_speed": 1}, sweep=sweep)).grid
    assert point.configuration.robot.limits["strut_speed"].upper[0] == 0.5
    # Widths that follow from the limit follow it here, too.
    assert point.configuration.run.design.smoothing == (0.2, 0.05, 0.025)


def test_a_component_beside_those_that_are_lifted():
    sweep = {"limits.rotation.psi": [["-10 deg", "10 deg"], "none"]}
    points = load_run(run(limits={"rotation": "none"}, sweep=sweep)).grid
    limit = points[0].configuration.robot.limits["rotation"]
    assert list(limit.upper) == [math.inf, math.inf, math.radians(10)]
    assert "rotation" not in points[1].configuration.robot.limits
    assert [resolved_cell("limits.rotation.psi", point) for point in points] == [
        json.dumps([-math.radians(10), math.radians(10)]),
        "none",
    ]


def test_cells_are_in_si_units():
    sweep = {
        "trajectory.frequency": ["200 mHz", ["0.1 Hz", 0.3]],
        "limits.actuator_force": ["0.2 kN"],
        "limits.reserve": ["5 %"],
    }
    points = load_run(run(sweep=sweep)).grid
    cells = [[resolved_cell(path, point) for path in sweep] for point in points]
    assert cells == [["0.2", "200.0", "0.05"], ["[0.1, 0.3]", "200.0", "0.05"]]
    units = path_units()
    assert [units[path] for path in sweep] == ["Hz", "N", "1"]
    assert units["design.criterion"] == ""
    assert units["trajectory.controller_period"] == "s"
    assert units["design.smoothing"] == "m/s"
