"""Machines drawn from tolerances."""

import pickle

import numpy as np
import pytest
import yaml

from estimation.kinematics import signs_along
from estimation.measurement_model import HarmonicMotion
from estimation.twin import Twin
from estimation.twin.machine import draw_machine
from expdesign.configuration import load_run, resolved_yaml
from expdesign.robot import Robot
from tests.columns import deviation_forces, deviation_lengths
from tests.twin.examples import motion

TOLERANCES = {
    "base_joints": "0.3 mm",
    "platform_joints": [[0, 0, 1e-3]] + [[0, 0, 0]] * 5,
    "strut_length": [1e-4, 0, 0, 0, 0, 2e-4],
    "force_constant": {"common": "2 %", "each": "1 %"},
    "gravity": "0.5 deg",
    "delay": "0.2 ms",
    "clock": "20 ppm",
}
DRAWS = 400


def configuration(tolerances=TOLERANCES, **experiment):
    given = {"periods": 2, "sampling": 50, **experiment}
    return load_run({"name": "n", "robot": "palida", "tolerances": tolerances, "experiment": given})


def drawn(seed=0, **more):
    return draw_machine(configuration(**more), np.random.default_rng(seed))


def spread(values):
    """Return root mean squares over the draws; known to 1/√(2 · 400), 3.5 %."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def test_everything_is_off_by_its_tolerance():
    start = configuration()
    rng = np.random.default_rng(1)
    machines = [draw_machine(start, rng).configuration for _ in range(DRAWS)]
    close = {"rtol": 5 / np.sqrt(2 * DRAWS)}
    base = spread([m.truth.base_joints - start.robot.base_joints for m in machines])
    np.testing.assert_allclose(base, 3e-4, **close)
    platform = spread([m.truth.platform_joints - start.robot.platform_joints for m in machines])
    np.testing.assert_allclose(platform[0, 2], 1e-3, **close)
    assert np.count_nonzero(platform) == 1
    up = np.array([0, 0, -1])
    tilts = [np.linalg.norm(np.cross(m.truth.gravity / 9.81, up)) for m in machines]
    np.testing.assert_allclose(spread(tilts), np.sqrt(2) * np.radians(0.5), **close)
    sections = [m.run.experiment for m in machines]
    for name, expected in (
        ("delay", 2e-4),
        ("clock", 2e-5),
        ("strut_length", [1e-4, 0, 0, 0, 0, 2e-4]),
    ):
        np.testing.assert_allclose(spread([getattr(s, name) for s in sections]), expected, **close)
    np.testing.assert_allclose(spread([s.force_constant.common for s in sections]), 0.02, **close)
    each = spread([s.force_constant.each for s in sections])
    np.testing.assert_allclose(each, 0.01, **close)


def test_a_lacking_term_is_drawn_as_a_term_of_the_machine():
    terms = {"load_friction": "1 %", "stribeck": {"std": 2, "velocity": 0.05}}
    start = configuration({"terms": terms})
    rng = np.random.default_rng(4)
    machines = [draw_machine(start, rng) for _ in range(DRAWS)]
    values = np.array([machine.values for machine in machines])
    np.testing.assert_allclose(spread(values), [2.0] * 6 + [0.01] * 6, rtol=5 / np.sqrt(2 * DRAWS))
    truth = machines[0].configuration.truth
    assert [truth.parameters[f"mu{j}"] for j in range(1, 7)] == values[0, 6:].tolist()
    assert truth.constants == (0.05,)
    again = load_run(yaml.safe_load(resolved_yaml(machines[0].configuration)))
    assert again.truth.parameters == truth.parameters
    assert again.run == machines[0].configuration.run
    with_term = Twin.of(machines[0].configuration, motion())
    assert np.abs(with_term.forces - Twin.of(start, motion()).forces).max() > 0.5


def test_it_is_what_the_twin_measures():
    found = drawn()
    twin = Twin.of(found.configuration, motion())
    truth = twin.truth
    np.testing.assert_array_equal(truth.machine.base_joints, found.configuration.truth.base_joints)
    assert truth.parameters == dict(configuration().robot.parameters)
    assert truth.disturbances["delay"] == found.configuration.run.experiment.delay
    by_name = dict(zip((d.name for d in found.deviations), found.values, strict=True))
    assert by_name["delay"] == truth.disturbances["delay"]
    assert by_name["strut_length_6"] == truth.disturbances["strut_length"][5]
    # The robot that the estimator knows stays.
    np.testing.assert_array_equal(
        found.configuration.robot.base_joints, configuration().robot.base_joints
    )
    again = pickle.loads(pickle.dumps(found.configuration))
    np.testing.assert_array_equal(Twin.of(again, motion()).lengths, twin.lengths)


def test_what_is_measured_moves_as_the_columns_of_the_tolerances_say():
    """Two derivations of the same: the machine as it is drawn, and derivatives of the graph."""
    small = {
        "base_joints": "3 um",
        "platform_joints": "3 um",
        "strut_length": "3 um",
        "force_constant": {"common": "100 ppm", "each": "20 ppm"},
        "gravity": "0.0003 deg",
        "delay": "20 us",
        "low_pass": {"lengths": "5 us"},
        "clock": "2 ppm",
    }
    found = drawn(3, tolerances=small)
    plain = Twin.of(configuration({}), motion())
    moved = Twin.of(found.configuration.with_section("experiment", follows="platform"), motion())
    robot, times = Robot(configuration({}).robot), plain.grid.times
    along = HarmonicMotion.of(motion())
    signs = signs_along(robot, along.at(times), np.zeros((len(times), 18)))
    chosen = found.deviations
    assert len(chosen) == 18 + 18 + 6 + 7 + 2 + 1 + 6 + 1
    assert all(
        value >= 0 for one, value in zip(chosen, found.values, strict=True) if one.lower == 0
    )
    forces = deviation_forces(robot, along, times, signs, robot.parameters, chosen)
    lengths = deviation_lengths(robot, along, times, chosen)
    off_length = moved.lengths - plain.lengths
    most = 2e-3 * np.abs(off_length).max()
    np.testing.assert_allclose(off_length, lengths @ found.values, atol=most)
    off, expected = moved.forces - plain.forces, forces @ found.values
    np.testing.assert_allclose(off, expected, atol=2e-3 * np.abs(expected).max())
    # Every kind of entry is large enough to be seen in this.
    for group in {each.group for each in chosen}:
        own = [k for k, each in enumerate(chosen) if each.group == group]
        seen = [np.abs(c[..., own] @ found.values[own]).max() for c in (forces, lengths)]
        assert seen[0] > 0.02 * np.abs(expected).max() or seen[1] > 0.02 * np.abs(off_length).max()


def test_it_stands_in_the_run_that_is_written(tmp_path):
    robot = load_run("palida").run.robot.model_dump(exclude_none=True)
    robot["terms"] = [*robot["terms"], {"stribeck": {"velocity": 0.05}}]
    more = TOLERANCES | {"terms": {"stribeck": {"velocity": 0.01}}}
    given = {"name": "n", "robot": robot, "tolerances": more, "experiment": {"periods": 1}}
    found = draw_machine(load_run(given), np.random.default_rng(6)).configuration
    assert found.truth.constants != (0.05,)
    (tmp_path / "run.yaml").write_text(resolved_yaml(found), encoding="utf-8")
    again = load_run(tmp_path / "run.yaml")
    assert again.run == found.run
    for name in ("base_joints", "platform_joints", "gravity", "alpha_axes"):
        np.testing.assert_array_equal(getattr(again.truth, name), getattr(found.truth, name))
    assert again.truth.constants == found.truth.constants


def test_it_comes_to_what_the_run_states():
    stated = {"delay": 1e-3, "strut_length": 5e-3, "force_constant": {"common": 0.5, "drift": 0.1}}
    plain, more = (drawn(**e).configuration.run.experiment for e in ({}, stated))
    assert more.delay == pytest.approx(plain.delay + 1e-3)
    np.testing.assert_allclose(more.strut_length, np.add(plain.strut_length, 5e-3))
    both = 1.5 * (1 + plain.force_constant.common) - 1
    assert more.force_constant.common == pytest.approx(both)
    assert more.force_constant.drift == (0.1,) * 6


def test_it_is_drawn_about_the_machine_that_the_run_states():
    robot = load_run("palida").run.robot.model_dump(exclude_none=True)
    joints = np.array(robot["base_joints"]) + 0.01
    other = robot | {"name": "other", "base_joints": joints.tolist()}
    found = drawn(truth=other).configuration
    assert found.truth.name == "other"
    assert 0 < np.abs(found.truth.base_joints - joints).max() < 2e-3


def test_without_tolerances_it_is_the_robot():
    found = drawn(tolerances={})
    assert found.deviations == ()
    plain = Twin.of(configuration({}), motion())
    np.testing.assert_array_equal(Twin.of(found.configuration, motion()).forces, plain.forces)
