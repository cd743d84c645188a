"""What the comparison says of models that are right, wrong, or none; and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators import PerturbedMachine, SystematicUncertainty
from estimation.estimators.covariance import EstimatedDeviation
from estimation.feedforward.comparison import compare_feedforward, true_machine
from estimation.feedforward.result import FeedforwardResult
from estimation.identification import estimate_parameters, estimation_result
from expdesign.configuration import ComputationError, InputError, load_run
from expdesign.configuration.noise import DENSITIES
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.term import parameters_of
from expdesign.robot import robot_from
from expdesign.robot.deviation import apply_deviations, as_in_a_file, toleranced_deviations
from tests.estimation.cases import ROBOT, measured, read_estimate, run, trajectory

MOTION = trajectory()
READ = [0.05, -0.05, 0.05, -0.05, 0.05, -0.05]
"""By which share the forces of each actuator are measured too large."""
FOLLOWED = {"motion": "circle", "radius": 0.08, "speed": 1.0, "periods": 1}
EXACT = PerturbedMachine.exact(ROBOT)
SLOW = {"trajectory": {"controller_period": 0.005}}


@pytest.fixture(scope="module")
def heavier():
    """PaLiDA with a fifth more mass and half as much friction again, as a twin's machine."""
    about = load_robot_description("palida").description
    factors = {"p10": 1.2, **{f"r{j}": 1.5 for j in range(1, 7)}}
    values = {name: value * factors.get(name, 1) for name, value in about.parameters.items()}
    return about.model_copy(update={"parameters": values})


@pytest.fixture(scope="module")
def saved(heavier, tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimate")
    true = robot_from(load_run({"name": "n", "robot": heavier}).robot)
    config = run({"estimators": ["gm"]})
    estimation_result(estimate_parameters(config, measured(MOTION, robot=true), MOTION)).write(
        folder
    )
    return read_estimate(folder, ROBOT)


def case(followed=FOLLOWED, **sections):
    return run(feedforward=followed, **{**SLOW, **sections})


@pytest.fixture(scope="module")
def record(saved, heavier):
    return compare_feedforward(case(experiment={"truth": heavier}), saved, None)


def test_the_better_the_model_the_smaller_the_error(record):
    summary = record
    none, nominal, identified, true = (
        summary.case(name) for name in ("none", "nominal", "identified", "true")
    )
    assert summary.machine == "twin"
    assert none.reduction == 1
    assert 1.5 < nominal.reduction < 5 < identified.reduction
    assert true.rms_from_true == 0
    # A thousand samples; benchmarks/feedforward.py has the sixteen thousand of an experiment.
    assert summary.left < 0.08
    assert nominal.rms_from_true > 5 * identified.rms_from_true
    assert summary.integration.change < 1e-3


def test_numbers_are_those_of_the_errors(record):
    summary = record
    for each, tracking in zip(summary.cases, record.tracking, strict=True):
        assert each.rms_struts == pytest.approx(np.sqrt(np.mean(tracking.struts**2)))
        assert each.max_struts == np.abs(tracking.struts).max()
        rows = [row for row in record.rows if row.case == each.case]
        squares = [row.rms**2 for row in rows]
        assert np.sqrt(np.mean(squares)) == pytest.approx(each.rms_struts)
        # The platform is where its struts are.
        assert each.max_position < 5 * each.max_struts


def test_without_noise_the_true_model_leaves_what_sampling_leaves(saved):
    silent = {"length_covariance": (1e-20 * np.eye(6)).tolist()}
    sizes = []
    for step in (0.005, 0.0025):
        config = case(noise=silent, trajectory={"controller_period": step})
        record = compare_feedforward(config, saved, None)
        sizes.append(record.case("true").rms_struts)
        assert {each.case for each in record.cases}.isdisjoint({"nominal"})
    assert sizes[0] < 20e-6
    assert sizes[1] < sizes[0] / 2


def test_a_record_survives_its_folder(record, tmp_path):
    record.write(tmp_path)
    again = FeedforwardResult.read(tmp_path)
    assert again.rows == record.rows
    assert json.dumps(again.as_data(), default=list) == json.dumps(record.as_data(), default=list)
    for one, other in zip(again.tracking, record.tracking, strict=True):
        np.testing.assert_array_equal(one.struts, other.struts)
    (tmp_path / "tables" / "tracking_2.csv").unlink()
    with pytest.raises(InputError, match="tracking_2"):
        FeedforwardResult.read(tmp_path)


def test_cases_that_are_missing_are_told(record, tmp_path):
    record.write(tmp_path)
    path = tmp_path / "feedforward.json"
    data = json.loads(path.read_text())
    data["cases"] = [each for each in data["cases"] if each["case"] != "true"]
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="true"):
        FeedforwardResult.read(tmp_path)


@pytest.mark.parametrize(
    "data", [{"file": "measured.csv"}, {"files": {"lengths": "q.csv", "forces": "Q.csv"}}]
)
def test_of_a_real_machine_one_is_drawn(saved, data):
    config = case(data=data)
    times = np.arange(3.0)
    found, again = (true_machine(config, saved, EXACT, times) for _ in range(2))
    other = true_machine(config.with_section("experiment", seed=7), saved, EXACT, times)
    assert found.kind == "drawn"
    np.testing.assert_array_equal(found.model.values, again.model.values)
    assert np.any(found.model.values != other.model.values)
    scores = (found.model.values - saved.estimate.values) / saved.estimate.std
    assert 0.3 < np.sqrt(np.mean(scores**2)) < 2
    lower = [parameter.lower for parameter in parameters_of(ROBOT.terms)]
    wrong = saved.estimate.values < lower
    assert np.all(wrong | (found.model.values >= lower))


def test_an_estimate_without_any_possible_machine_is_told(saved):
    """Of twenty-one parameters with a bound at zero none is known: few have all signs right."""
    vague = 1e12 * np.eye(len(saved.estimate.values))
    hopeless = replace(saved.estimate, values=np.abs(saved.estimate.values), covariance=vague)
    config = case(data={"file": "measured.csv"})
    with pytest.raises(ComputationError, match="too uncertain"):
        true_machine(config, replace(saved, estimate=hopeless), EXACT, np.arange(3.0))


def test_force_constants_and_cogging_act_in_the_loop(saved):
    """A drive that gives too little: the identified model knows it, if it was measured with it."""
    wrong = {"force_constant": {"common": "10 %"}}
    record = compare_feedforward(case(experiment=wrong), saved, None)
    # The true model's forces are those that the drives have to be told.
    assert record.case("true").reduction > record.case("nominal").reduction
    cogging = {"amplitude": 30, "pitch": "30 mm"}
    disturbed = compare_feedforward(case(experiment={"cogging": cogging}), saved, None)
    assert disturbed.case("true").rms_struts > 2 * record.case("true").rms_struts


def _estimated(chosen, values, response):
    """Return deviations that are known exactly."""
    pairs = zip(chosen, values, strict=True)
    return SystematicUncertainty(
        estimated=True,
        deviations=tuple(replace(EstimatedDeviation.of(*pair), std=0.0) for pair in pairs),
        response=response,
        left=np.zeros((len(chosen), len(chosen))),
    )


@pytest.fixture(scope="module")
def read_wrongly(saved):
    """An estimate that knows all parameters, and the force constants of a machine with others."""
    robot = robot_from(run(tolerances={"force_constant": {"each": "5 %"}}).robot)
    chosen, zeros = toleranced_deviations(robot), np.zeros((len(robot.parameters), len(READ)))
    found = _estimated(chosen, READ, zeros)
    known = replace(saved.estimate, values=robot.parameters, systematic=found)
    return replace(saved, estimate=known)


def test_forces_are_fed_forward_in_the_units_that_the_estimate_found(read_wrongly):
    """A model without any error leaves what the true one does: both know the force constants."""
    wrong = {"force_constant": {"each": READ}}
    tolerances = {"force_constant": {"each": "5 %"}}
    config = case(experiment=wrong, tolerances=tolerances)
    summary = compare_feedforward(config, read_wrongly, None)
    assert summary.case("nominal").rms_from_true > 20e-6
    assert summary.case("identified").rms_from_true < 1e-9


def test_estimated_forces_that_the_robot_lacks_are_fed_forward(saved):
    tolerances = {"terms": {"drive_inertia": "20 kg"}}
    robot = robot_from(run(tolerances=tolerances).robot)
    chosen = toleranced_deviations(robot)
    theta, zeros = np.full(len(chosen), 20.0), np.zeros((len(robot.parameters), len(chosen)))
    found = _estimated(chosen, theta.tolist(), zeros)
    known = replace(
        saved, estimate=replace(saved.estimate, values=robot.parameters, systematic=found)
    )
    machine = apply_deviations(robot, chosen, theta).extended
    truth = as_in_a_file(machine.description).model_copy(update={"tolerances": None})
    config = case(experiment={"truth": truth}, tolerances=tolerances)
    result = compare_feedforward(config, known, None)
    assert result.case("nominal").rms_from_true > 20e-6
    assert result.case("identified").rms_from_true < 1e-9


def test_a_machine_that_is_drawn_has_the_force_constants_of_the_estimate(read_wrongly):
    found = read_wrongly.estimate.systematic
    machine = PerturbedMachine.of(ROBOT, found.deviations, found.values)
    drawn = true_machine(case(data={"file": "measured.csv"}), read_wrongly, machine, np.arange(3.0))
    np.testing.assert_allclose(drawn.gains, 1 + np.tile(READ, (3, 1)))


def test_a_loop_that_is_unstable_is_told(saved):
    """By a filter that lags behind, of a machine strong enough to be thrown out of its motion."""
    strong, slow = {"limits": {"actuator_force": 1e6}}, {"filter": 0.5, "integral": 0}
    with pytest.raises(ComputationError, match=r"feedforward\.bandwidth"):
        compare_feedforward(case(FOLLOWED | slow | {"periods": 20}, **strong), saved, None)


@pytest.mark.parametrize(
    ("section", "others", "key"),
    [
        ({"integral": 8.0}, {}, "feedforward.integral"),
        ({"bandwidth": "30 Hz"}, {}, "feedforward.bandwidth"),
        ({"motion": "line"}, {}, "feedforward.poses"),
        ({"motion": "design", "mirror": "xz"}, {}, "feedforward.mirror"),
        ({"motion": "file"}, {}, "feedforward.motion"),
        ({}, {"experiment": {"compliance": 1e-7}}, "experiment.compliance"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_configuration(section, others, key):
    with pytest.raises(InputError) as caught:
        case(section, **others)
    assert [problem.key for problem in caught.value.problems] == [key]


def test_a_spectrum_says_nothing_beyond_its_sampling(tmp_path):
    rows = [("frequency", *DENSITIES), (0, *[1e-12] * 6), (500, *[1e-12] * 6)]
    path = tmp_path / "spectrum.csv"
    path.write_text("\n".join(",".join(map(str, row)) for row in rows), encoding="utf-8")
    noise = {"length_spectrum": str(path)}
    for step in (0.001, 0.002):
        assert case(noise=noise, trajectory={"controller_period": step}).run.feedforward
    with pytest.raises(InputError) as caught:
        case(noise=noise, trajectory={"controller_period": 0.0005})
    assert [each.key for each in caught.value.problems] == ["trajectory.controller_period"]


def test_too_long_a_simulation_is_refused(saved):
    with pytest.raises(InputError) as caught:
        compare_feedforward(case(FOLLOWED | {"periods": 10**7}), saved, None)
    assert caught.value.problems[0].key == "feedforward.periods"
