"""Estimates of base parameters: the forces stay, and combinations do not tell what is held."""

import numpy as np
import pytest

from estimation.estimators import ParameterPriors, UnidentifiableError
from estimation.identification import estimate_parameters, estimation_result, prepare_experiment
from estimation.identification.estimation import run_estimators
from estimation.identification.result import EstimationResult
from estimation.uncertainty.consistency import consistent_estimate
from expdesign.configuration import InputError, load_run
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as FILE
from expdesign.robot import load_robot, robot_from
from tests.estimation.cases import made_up, measured, trajectory
from tests.payload import PLACE, described, with_payload

STRIBECK = {"stribeck": {"velocity": 1e9}}
TRUTH = {f"s{j}": 2.0 + j for j in range(1, 7)}
MOTION = trajectory()


@pytest.fixture(scope="module", autouse=True)
def consistency_draws():
    """Draw as many as an estimate does: these tests are about them."""


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
    rows = found.priors.inseparable_combinations(found.robot, one.values, one.covariance)
    return {row.parameter: row for row in rows}


def test_without_it_the_error_says_what_shows(data):
    with pytest.raises(UnidentifiableError) as caught:
        estimate_parameters(_run(), data, MOTION)
    assert set(caught.value.names) == {f"s{j}" for j in range(1, 7)}
    assert set(caught.value.shows) == {f"r{j} + s{j}" for j in range(1, 7)}
    assert "estimate.parameters" in str(caught.value)


@pytest.mark.slow
def test_combinations_do_not_depend_on_what_is_held(data, machine):
    wanted = ["ls", "gm", "ml"]
    near = estimate_parameters(_run(parameters="base", estimators=wanted), data, MOTION)
    far = estimate_parameters(
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
    found = estimate_parameters(
        _run(parameters="base", fixed={"s1": TRUTH["s1"], "r2": 5.0}), data, MOTION
    )
    assert set(_combinations(found)) == {f"r{j}" for j in (3, 4, 5, 6)}
    free = dict(zip(found.priors.names, found.priors.free, strict=True))
    assert free["r1"]
    assert free["s2"]
    assert not free["s1"]
    assert not free["r2"]
    assert not free["s3"]


@pytest.mark.slow
def test_standard_deviations_of_combinations_cover(machine):
    """Errors over σ of six combinations in 40 experiments; the friction held is far from true."""
    run = _run(parameters="base")
    robot = robot_from(run.robot)
    knowledge, errors = ParameterPriors.of(robot, run.run.estimate), []
    for seed in range(40):
        recording = measured(MOTION, seed, robot=machine)
        experiment = prepare_experiment(run, robot, recording, MOTION)
        found = run_estimators(robot, [experiment], knowledge, ("gm",))["gm"]
        rows = {
            row.parameter: row
            for row in knowledge.inseparable_combinations(robot, found.values, found.covariance)
        }
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
        assert ParameterPriors.of(robot, run.run.estimate).has_bounds
        return
    with pytest.raises(InputError) as caught:
        ParameterPriors.of(robot, run.run.estimate)
    (problem,) = caught.value.problems
    assert problem.key == key


def test_a_prior_tells_apart_what_no_force_does(data):
    prior = {f"s{j}": {"value": TRUTH[f"s{j}"], "std": 0.5} for j in range(1, 7)}
    found = estimate_parameters(_run(prior=prior), data, MOTION)
    std = dict(zip(found.priors.names, found.estimates["gm"].std, strict=True))
    for j in range(1, 7):
        assert std[f"s{j}"] == pytest.approx(0.5, rel=1e-6)


def test_the_record_has_the_combinations_after_reading(data, tmp_path):
    found = estimate_parameters(_run(parameters="base"), data, MOTION)
    estimation_result(found).write(tmp_path)
    tables = EstimationResult.read(tmp_path).base_parameters
    rows = [row for table in tables.values() for row in table]
    by_name = {row.parameter: row for row in rows}
    for name, row in _combinations(found).items():
        assert f"s{name[1:]}" in by_name[name].regrouped
        assert by_name[name].std <= row.std * (1 + 1e-9)
        assert np.isnan(by_name[name].std_alone)
    assert (tmp_path / "tables/estimate_combinations.csv").read_text(encoding="utf-8").count(
        "\n"
    ) == 1 + len(rows)


def _bodies_of(values, held):
    """Return an estimate with values of all parameters, held ones as given, and what is near it."""
    robot = robot_from(_run(held).robot)
    knowledge = ParameterPriors.of(robot, _run(held, parameters="base").run.estimate)
    std = np.where(knowledge.free, 0.02 * robot.scales, 0.0)
    estimate = made_up(values, std)
    return robot, estimate, consistent_estimate(robot, estimate, knowledge)


FAR = {f"s{j}": 30.0 for j in range(1, 7)}


def _thick(robot, friction, held):
    """Return parameters of struts with some thickness, with r_j + s_j and s_j as given."""
    named = dict(zip(robot.parameter_names, robot.parameters.tolist(), strict=True))
    named |= {"p1": 0.3, "p2": 0.9, "p3": 1.0, "p5": -0.5, "p9": 0.5}
    named |= {f"r{j}": friction[j - 1] - held for j in range(1, 7)}
    named |= {f"s{j}": held for j in range(1, 7)}
    return np.array([named[name] for name in robot.parameter_names])


def test_combinations_that_bodies_have_are_consistent_whatever_is_held():
    """Held far from true they make r negative, which says nothing: only r + s does."""
    robot = robot_from(_run(FAR).robot)
    values = _thick(robot, [5.0, 7.0, 9.0, 11.0, 13.0, 50.0], 30.0)
    _, estimate, near = _bodies_of(values, FAR)
    assert (near.distance, near.p, near.active) == (0, 1, ())
    assert near.realisable
    assert not near.significant
    assert set(near.exchanged) >= {f"s{j}" for j in range(1, 6)}
    assert robot.realisable.bodies(near.vector) is not None
    free = estimate.std > 0
    np.testing.assert_allclose(near.moved[free], 0, atol=1e-4)
    states = MOTION.sample(MOTION.sample_times(50))
    np.testing.assert_allclose(
        robot.actuator_forces(*states, near.vector),
        robot.actuator_forces(*states, values),
        atol=1e-6,
    )
    # What no condition asks for stays as it is held.
    k = robot.parameter_names.index("s6")
    assert near.vector[k] == pytest.approx(30.0, abs=0.1)


def test_what_the_forces_tell_is_still_doubted():
    """One σ, or forty, of a parameter that is estimated alone, beside combinations as far off."""
    robot = robot_from(_run(FAR).robot)
    for sigmas in (1.0, 40.0):
        found = []
        for held in (0.0, 30.0):
            values = _thick(robot, [5.0] * 6, held)
            k = robot.parameter_names.index("v3")
            values[k] = -sigmas * 0.02 * robot.scales[k]
            near = _bodies_of(values, {f"s{j}": held for j in range(1, 7)})[2]
            assert near.distance == pytest.approx(sigmas, rel=1e-4)
            assert near.moved[k] == pytest.approx(sigmas, rel=1e-4)
            assert near.active == ("v3",)
            assert near.significant == (sigmas == 40)
            found.append(near)
        one, other = found
        assert one.p == pytest.approx(other.p, abs=0.02)
        np.testing.assert_allclose(one.spread, other.spread, rtol=1e-3)


def test_distances_are_those_of_the_machine_without_what_regroups():
    """Where s may have either sign every s takes up what r lacks: r + s has no condition at all."""
    plain = load_robot("palida")
    robot = robot_from(_run(FAR).robot)
    rng = np.random.default_rng(5)
    place = [robot.parameter_names.index(name) for name in plain.parameter_names]
    base = _thick(robot, [5.0] * 6, 30.0)
    for _ in range(2):
        values = base.copy()
        values[place] += 0.5 * plain.scales * rng.standard_normal(len(place))
        alone = values[place].copy()
        for j in range(1, 7):
            alone[plain.parameter_names.index(f"r{j}")] = 50.0
        expected = consistent_estimate(
            plain,
            made_up(alone, 0.02 * plain.scales),
            ParameterPriors.of(plain, load_run({"name": "n", "robot": "palida"}).run.estimate),
        )
        near = _bodies_of(values, FAR)[2]
        assert expected.distance > 1
        assert near.distance == pytest.approx(expected.distance, rel=1e-4)


def test_the_identified_robot_keeps_the_combinations(data, tmp_path):
    """With `consistent` the file has bodies' values, and the forces of the nearest estimate."""
    files = {}
    for held in (0.0, 30.0):
        run = _run({f"s{j}": held for j in range(1, 7)}, parameters="base", consistent=True)
        folder = tmp_path / str(held)
        folder.mkdir()
        found = estimate_parameters(run, data, MOTION)
        record = estimation_result(found)
        record.write(folder)
        keys = EstimationResult.read(folder).best_estimator.consistent
        np.testing.assert_array_equal(keys.moved, found.consistent["gm"].moved)
        assert not keys.significant
        files[held] = load_robot(folder / FILE)
        assert not [text for text in files[held].description.warnings if "inconsistent" in text]
    states = MOTION.sample(MOTION.sample_times(50))
    near, far = (robot.actuator_forces(*states) for robot in files.values())
    np.testing.assert_allclose(near, far, atol=1e-3)


@pytest.fixture(scope="module")
def identified(data, tmp_path_factory):
    """A machine whose r and s an earlier estimate knows apart, by priors, and tolerances moved."""
    prior = {f"{'r' if j < 4 else 's'}{j}": {"value": 3.0, "std": 0.5} for j in range(1, 7)}
    prior |= {"s2": {"value": 4.0, "std": 2.0}}
    folder = tmp_path_factory.mktemp("identified")
    section = {"estimators": ["gm"], "harmonics": 2, "noise": "given", "prior": prior}
    run = {"name": "n", "robot": described("palida", STRIBECK), "estimate": section}
    run["tolerances"] = {"force_constant": {"common": 0.02}}
    estimation_result(estimate_parameters(run, data, MOTION)).write(folder)
    return folder / FILE


@pytest.mark.slow
@pytest.mark.parametrize("fixed", [{}, {"s1": 2.0, "p10": 16.4}])
def test_an_earlier_estimate_is_a_prior_of_combinations(identified, machine, fixed):
    """With all parameters, which the earlier estimate tells apart, the combinations are the same.

    A machine whose s are written otherwise, as bodies may ask for, has the same combinations.
    """
    second = measured(MOTION, 1, robot=machine)
    known = load_robot(identified).description.description
    told = known.identification.model_copy(
        update={"unconstrained": tuple(known.parameters.values())}
    )
    moved = {name: 9.0 if name[0] == "s" else value for name, value in known.parameters.items()}
    other = known.model_copy(update={"parameters": moved, "identification": told})
    wanted = ["ls", "gm", "ml"]
    section = {"estimators": wanted, "harmonics": 2, "noise": "given", "fixed": fixed}

    def after(robot, parameters):
        options = section | {"prior_from": "robot", "parameters": parameters}
        return estimate_parameters(
            {"name": "n", "robot": robot, "estimate": options}, second, MOTION
        )

    whole = after(known, "all")
    for robot in (known, other):
        base = after(robot, "base")
        matrix = base.priors.regrouping
        assert set(_combinations(base)) >= {f"r{j}" for j in range(2, 7)}
        free = base.priors.free
        for name in wanted:
            one, all_of_it = base.estimates[name], whole.estimates[name]
            std = one.std[free]
            np.testing.assert_allclose(
                (matrix @ one.values)[free] / std,
                (matrix @ all_of_it.values)[free] / std,
                atol=1e-3,
            )
            for key in ("covariance_random", "covariance_systematic"):
                expected = matrix @ getattr(all_of_it, key) @ matrix.T
                np.testing.assert_allclose(
                    getattr(one, key)[np.ix_(free, free)] / np.multiply.outer(std, std),
                    expected[np.ix_(free, free)] / np.multiply.outer(std, std),
                    atol=1e-4,
                )


@pytest.mark.parametrize(
    ("estimated", "refused"), [(["p10", "m_payload"], True), (["p10"], False), ([], False)]
)
def test_an_earlier_estimate_that_knows_some_combination_exactly_is_refused(estimated, refused):
    """A payload of which alone is known how sure it is moves ten combinations by one number."""
    robot, names = described("palida", {"payload": PLACE}), with_payload().parameter_names
    values = with_payload().parameters.tolist()
    variance = [4.0 * (name in estimated) for name in names]
    robot |= {"platform": "general", "parameters": dict(zip(names, values, strict=True))}
    robot["identification"] = {
        "run": "n",
        "estimator": "gm",
        "verdict": "accepted",
        "parameters": names,
        "covariance_random": np.diag(variance).tolist(),
        "covariance_systematic": np.zeros((len(names),) * 2).tolist(),
    }
    section = EstimateSection(prior_from="robot", parameters="base")
    machine = robot_from(load_run({"name": "n", "robot": robot}).robot)
    if refused:
        with pytest.raises(InputError, match="base") as caught:
            ParameterPriors.of(machine, section)
        assert caught.value.problems[0].key == "estimate.prior_from"
        return
    found = np.diag(ParameterPriors.of(machine, section).precision)
    assert list(found[found > 0]) == pytest.approx([0.25] * len(estimated))


def test_a_prior_that_held_a_parameter_elsewhere_is_refused(data, tmp_path):
    """It found r1 beside the s1 that it held, and says nothing of r1 beside another one."""
    estimation_result(estimate_parameters(_run(parameters="base"), data, MOTION)).write(tmp_path)
    robot = load_robot(tmp_path / FILE)
    for value, refused in ((0.0, False), (10.0, True)):
        section = EstimateSection(prior_from="robot", parameters="base", fixed={"s1": value})
        if not refused:
            assert not ParameterPriors.of(robot, section).free[robot.parameter_names.index("s1")]
            continue
        with pytest.raises(InputError, match="s1") as caught:
            ParameterPriors.of(robot, section)
        assert caught.value.problems[0].key == "estimate.fixed.s1"
