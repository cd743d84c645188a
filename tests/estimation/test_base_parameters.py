"""Estimates of base parameters: the forces stay, and combinations do not tell what is held."""

import numpy as np
import pytest

from estimation.estimators import Knowledge, UnidentifiableError
from estimation.identification import estimate
from estimation.identification.record import EstimateRecord
from expdesign.configuration import InputError, load_run
from expdesign.robot import robot_from
from tests.estimation.cases import measured, trajectory
from tests.payload import described

STRIBECK = {"stribeck": {"velocity": 1e9}}
TRUTH = {f"s{j}": 2.0 + j for j in range(1, 7)}
MOTION = trajectory()


def _run(values=None, **section):
    robot = described("palida", STRIBECK, **(values or {}))
    section = {"estimators": ["gm"], "harmonics": 2, "noise": "given", **section}
    return load_run({"name": "n", "robot": robot, "estimate": section})


@pytest.fixture(scope="module")
def machine():
    return robot_from(_run(TRUTH).robot)


@pytest.fixture(scope="module")
def data(machine):
    return measured(MOTION, robot=machine)


def _combinations(found, name="gm"):
    one = found.estimates[name]
    rows = found.knowledge.inseparable(found.robot, one.values, one.covariance)
    return {row.parameter: row for row in rows}


def test_without_it_the_error_says_what_shows(data):
    with pytest.raises(UnidentifiableError) as caught:
        estimate(_run(), data, MOTION)
    assert set(caught.value.names) == {f"s{j}" for j in range(1, 7)}
    assert set(caught.value.shows) == {f"r{j} + s{j}" for j in range(1, 7)}
    assert "estimate.parameters" in str(caught.value)


def test_combinations_do_not_depend_on_what_is_held(data, machine):
    wanted = ["ls", "gm", "ml"]
    near = estimate(_run(parameters="base", estimators=wanted), data, MOTION)
    far = estimate(
        _run({f"s{j}": 40.0 for j in range(1, 7)}, parameters="base", estimators=wanted),
        data,
        MOTION,
    )
    states = MOTION.sample(MOTION.sample_times(50))
    for name in wanted:
        one, other = near.estimates[name], far.estimates[name]
        first, second = _combinations(near, name), _combinations(far, name)
        assert set(first) == {f"r{j}" for j in range(1, 7)}
        for key, row in first.items():
            assert row.value == pytest.approx(second[key].value, rel=1e-5)
            assert row.std == pytest.approx(second[key].std, rel=1e-5)
            assert np.isnan(row.std_alone)
            k = machine.parameter_names.index(key)
            assert row.std == pytest.approx(one.std[k])
        np.testing.assert_array_equal(one.values[24:], 0.0)
        np.testing.assert_array_equal(other.values[24:], 40.0)
        np.testing.assert_allclose(
            machine.actuator_forces(*states, one.values),
            machine.actuator_forces(*states, other.values),
            atol=1e-4,
        )


def test_what_is_fixed_is_known_and_takes_no_part(data):
    found = estimate(_run(parameters="base", fixed={"s1": TRUTH["s1"], "r2": 5.0}), data, MOTION)
    assert set(_combinations(found)) == {f"r{j}" for j in (3, 4, 5, 6)}
    free = dict(zip(found.knowledge.names, found.knowledge.free, strict=True))
    assert free["r1"]
    assert free["s2"]
    assert not free["s1"]
    assert not free["r2"]
    assert not free["s3"]


def test_standard_deviations_of_combinations_cover(machine):
    """Errors over σ of six combinations in 40 experiments; the friction held is far from true."""
    run = _run(parameters="base")
    errors = []
    for seed in range(40):
        rows = _combinations(estimate(run, measured(MOTION, seed, robot=machine), MOTION))
        truth = dict(zip(machine.parameter_names, machine.parameters, strict=True))
        errors.append(
            [
                (row.value - truth[name] - truth[name.replace("r", "s")]) / row.std
                for name, row in rows.items()
            ]
        )
    scores = np.array(errors)
    assert scores.shape == (40, 6)
    # Four standard errors of mean and of standard deviation, of 40 draws each.
    np.testing.assert_array_less(np.abs(scores.mean(axis=0)), 4 / np.sqrt(40))
    np.testing.assert_allclose(scores.std(axis=0), 1, atol=4 / np.sqrt(80))
    assert scores.std() == pytest.approx(1, abs=4 / np.sqrt(480))


@pytest.mark.parametrize(
    ("section", "key", "refused"),
    [
        ({"prior": {"s2": {"std": 1.0}}}, "estimate.prior.s2", True),
        ({"bounds": {"r3": [0, 10]}}, "estimate.bounds.r3", True),
        ({"prior": {"p10": {"std": 1.0}}, "bounds": {"v1": [0, 100]}}, "", False),
    ],
)
def test_priors_of_what_is_not_estimated_alone(section, key, refused):
    run = _run(parameters="base", **section)
    robot = robot_from(run.robot)
    if not refused:
        assert Knowledge.of(robot, run.run.estimate).bounded
        return
    with pytest.raises(InputError) as caught:
        Knowledge.of(robot, run.run.estimate)
    (problem,) = caught.value.problems
    assert problem.key == key


def test_a_prior_tells_apart_what_no_force_does(data):
    prior = {f"s{j}": {"value": TRUTH[f"s{j}"], "std": 0.5} for j in range(1, 7)}
    found = estimate(_run(prior=prior), data, MOTION)
    std = dict(zip(found.knowledge.names, found.estimates["gm"].std, strict=True))
    for j in range(1, 7):
        assert std[f"s{j}"] == pytest.approx(0.5, rel=1e-6)


def test_the_record_has_the_combinations_after_reading(data, tmp_path):
    found = estimate(_run(parameters="base"), data, MOTION)
    EstimateRecord.of(found).write(tmp_path)
    rows = EstimateRecord.read(tmp_path).base_parameters
    by_name = {row.parameter: row for row in rows}
    for name, row in _combinations(found).items():
        assert f"s{name[1:]}" in by_name[name].regrouped
        assert by_name[name].std <= row.std * (1 + 1e-9)
        assert np.isnan(by_name[name].std_alone)
    assert (tmp_path / "tables/estimate_combinations.csv").read_text(encoding="utf-8").count(
        "\n"
    ) == 1 + len(rows)
