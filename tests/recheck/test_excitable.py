"""What motions within the limits tell, against analysis, other states and a motion."""

import numpy as np
import pytest

import expdesign.recheck.excitable
from expdesign.configuration import load_run
from expdesign.information.fisher import (
    SingularInformationError,
    information_matrix,
    parameter_covariance,
    weak_directions,
)
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.library import robot_files
from expdesign.recheck.excitable import best_std, excitable, random_states, structural_base
from expdesign.robot import LimitModel, load_robot, robot_from
from tests.estimation.cases import trajectory
from tests.payload import MASS, REGROUPED, described, with_payload

STRIBECK = {"stribeck": {"velocity": 1e9}}


def _robot(source, **sections):
    return robot_from(load_run({"name": "n", "robot": source, **sections}).robot)


@pytest.mark.parametrize("name", ["palida", "rubin"])
def test_random_states_keep_every_limit(name):
    robot = load_robot(name)
    states = np.concatenate(random_states(robot, 150), axis=1)
    assert states.shape == (150, 18)
    assert np.all(LimitModel.of(robot).violations(states) <= 0)
    # Every coordinate, rate and acceleration moves, and far: limits are reached.
    assert np.all(np.ptp(states, axis=0) > 0)
    assert np.max(LimitModel.of(robot).violations(states)) > -0.05
    again = np.concatenate(random_states(robot, 150), axis=1)
    np.testing.assert_array_equal(again, states)
    other = np.concatenate(random_states(robot, 150, seed=1), axis=1)
    assert not np.any(other[:-1] == states[:-1])


@pytest.mark.parametrize("name", sorted(robot_files()))
def test_robots_that_ship_against_other_states(name):
    robot = load_robot(name)
    rng = np.random.default_rng(3)
    length = np.mean(robot.inverse_kinematics(robot.home))
    size = np.repeat([0.1 * length, 0.2], 3)
    pose, rate, acceleration = (k * size * rng.normal(size=(400, 6)) for k in (0.5, 2.0, 10.0))
    stacked = robot.regressor(robot.home + pose, rate, acceleration).reshape(-1, 24)
    rank = np.linalg.matrix_rank(stacked / np.linalg.norm(stacked, axis=0), tol=1e-9)
    assert len(structural_base(robot).base) == rank


def test_a_payload_is_what_the_platform_carries():
    base = structural_base(with_payload())
    assert base.regrouped == (MASS,)
    found = {name: base.members(name)[MASS] for name in base.combined}
    assert found == pytest.approx(REGROUPED, rel=1e-8)
    (sentence,) = base.sentences()
    assert MASS in sentence
    assert "p10" in sentence


def test_what_the_robot_file_states_keeps_its_name():
    """Of two columns that are one, the parameter without a nominal value goes."""
    for values, gone in (({}, "s"), ({"r1": 0.0, **{f"s{j}": 2.0 for j in range(1, 7)}}, "s")):
        base = structural_base(_robot(described("palida", STRIBECK, **values)))
        expected = {f"{gone}{j}" for j in range(1, 7)}
        if "r1" in values:
            expected = (expected - {"s1"}) | {"r1"}
        assert set(base.regrouped) == expected
        for name in base.regrouped:
            (into,) = base.into(name)
            assert into[1:] == name[1:]
            assert base.members(into) == pytest.approx({name: 1.0})


def test_no_force_shows_what_gravity_would():
    weightless = described("palida") | {"gravity": [0, 0, 0]}
    base = structural_base(_robot(weightless))
    assert base.regrouped == ("p4",)
    assert base.into("p4") == ()


def test_only_what_is_asked_for_is_judged():
    robot = _robot(described("palida", STRIBECK))
    asked = tuple(name for name in robot.parameter_names if name not in ("r2", "s3", "p1"))
    base = structural_base(robot, asked)
    assert base.names == asked
    assert base.regrouped == ("s1", "s4", "s5", "s6")


def test_of_hardly_any_states_nothing_is_said(monkeypatch):
    robot = _robot(described("palida", STRIBECK))
    few = random_states(robot, 40)
    monkeypatch.setattr(expdesign.recheck.excitable, "random_states", lambda *_: few)
    found = excitable(robot)
    assert found.base.regrouped == ()
    assert found.beyond_noise(robot, 1.0) == {}


def test_an_error_tells_what_shows():
    base = structural_base(_robot(described("palida", STRIBECK)))
    error = SingularInformationError(weak_directions(base), structural=True)
    assert error.unexcited == base.regrouped
    assert error.shows == tuple(base.text(name) for name in base.combined)
    assert error.details["shows"] == list(error.shows)


# --- what noise lets be known ---------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_no_motion_is_better_than_the_best(seed):
    robot = load_robot("palida")
    motion = trajectory(seed=seed)
    sample = motion.sample(motion.sample_times(300))
    within = LimitModel.of(robot).violations(np.concatenate(sample, axis=1))
    kept = np.all(within <= 0, axis=1)
    assert np.count_nonzero(kept) > 100
    regressors = robot.regressor(*(part[kept] for part in sample))
    F = information_matrix(regressors, robot.description.noise.force_covariance)
    std = np.sqrt(np.diag(parameter_covariance(F, robot.parameter_names)))
    assert np.all(std * np.sqrt(np.count_nonzero(kept)) > excitable(robot).best_std)


def test_of_two_forces_the_best_is_known():
    """Of columns that are apart, the best is to measure each where it is largest."""
    rng = np.random.default_rng(0)
    sizes = rng.uniform(0.2, 1, (1000, 2))
    sizes[0] = 1.0
    white = np.zeros((1000, 6, 2))
    white[:, 0, 0], white[:, 1, 1] = 3 * sizes[:, 0], 5 * sizes[:, 1]
    np.testing.assert_allclose(best_std(white), [1 / 3, 1 / 5], rtol=1e-2)


def test_what_noise_hides_is_told_with_its_share():
    robot = load_robot("rubin")
    found = excitable(robot)
    few, many = found.beyond_noise(robot, 100), found.beyond_noise(robot, 1e6)
    assert set(many) < set(few)
    assert {"p1", "p2"} <= set(many)
    for name, share in many.items():
        assert share > 2 * IDENTIFIABLE
        assert few[name] == pytest.approx(100 * share)
    assert found.beyond_noise(robot, 1e20) == {}
