"""Recordings of voltages and duty cycles: the damping of the motors is known within tolerances."""

import numpy as np
import pandas as pd
import pytest

from estimation.data.reading import read_measurement
from estimation.identification import estimate_parameters
from estimation.identification.estimate import identified_robot
from estimation.montecarlo.study import Workbench
from estimation.twin import Twin
from estimation.twin.machine import machine_within_tolerances
from estimation.twin.truth import write_measurement
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.configuration.run import robot_yaml
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.plan import Prediction
from expdesign.robot.deviation import MOTOR_EFFECTS
from tests.estimation.cases import ROBOT, measured, trajectory

K, R = 90.0, 2.0
DAMPING = K**2 / R
MOTOR = {"force_constant": "90 N/A", "resistance": "2 ohm"}


def _run(motor, data, estimators=("gm", "ml"), noise="auto", **changes):
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    palida |= {"drive": {"motor": motor} if motor else "direct", **changes}
    section = {"estimators": list(estimators), "noise": noise, "harmonics": 2}
    return load_run({"name": "case", "robot": palida, "data": data, "estimate": section})


def _log(folder, supply=None, **noise):
    """Write duty cycles (or voltages without a supply) of a motion; return file and measurement."""
    motion = trajectory()
    data = measured(motion, **noise, length_scale=1e-4)
    states = motion.sample(data.time)
    speed = ROBOT.strut_motion(states.pose, states.rate, states.acceleration).length_rate
    voltage = (data.forces + DAMPING * speed) * R / K
    table = {"t": data.time}
    table |= {f"q{j + 1}": data.lengths[:, j] for j in range(6)}
    share = 1.0 if supply is None else 100 / supply(data.time)
    table |= {f"Q{j + 1}": voltage[:, j] * share for j in range(6)}
    if supply is not None:
        table["battery [mV]"] = 1e3 * supply(data.time)
    file = folder / "log.csv"
    pd.DataFrame(table).to_csv(file, index=False, float_format="%.17g")
    return file, data


def _sagging(times):
    return 48 - 4 * np.sin(3 * times) ** 2


def test_a_log_of_duty_cycles_gives_the_estimate_of_its_forces(tmp_path):
    file, forces = _log(tmp_path, _sagging)
    run = _run(MOTOR, {"units": {"Q": "%"}, "columns": {"U": "battery"}})
    voltages = read_measurement(file, run.run.data, run.robot)
    assert voltages.back_emf == (DAMPING,) * 6
    found, expected = (
        estimate_parameters(*each) for each in ((run, voltages), (_run(None, {}), forces))
    )
    # Maximum likelihood takes what these forces show of the motion, too.
    for name, share in ("gm", 0.005), ("ml", 0.05):
        values = dict(zip(found.priors.names, found[name].values, strict=True))
        for row in (one for one in expected.rows if one.estimator == name):
            assert values[row.parameter] == pytest.approx(row.value, abs=share * row.std)
        assert {values[f"e{j}"] for j in range(1, 7)} == {DAMPING}
    # The file of the robot is that of the machine without its amplifiers.
    file.with_name("identified.yaml").write_text(
        robot_yaml(identified_robot(found, None)), encoding="utf-8"
    )
    again = load_robot_description(file.with_name("identified.yaml"))
    assert again.parameter_names == ROBOT.parameter_names
    assert again.description.identification.parameters == ROBOT.parameter_names


@pytest.mark.parametrize(
    ("name", "number"),
    [("constant", None), ("resistance", 3), ("supply", 5)],
)
def test_an_error_of_a_motor_changes_the_estimate_by_its_response(tmp_path, name, number):
    file, _ = _log(tmp_path, force_scale=1e-4)
    tolerances = {key: {"common": "2 %", "each": "1 %"} for key in ("constant", "resistance")}
    tolerances["supply"] = tolerances["constant"]
    error, key = 1e-4, {"constant": "force_constant"}.get(name, name)
    wrong = 1 + error * (np.ones(6) if number is None else np.eye(6)[number - 1])
    data, motor = {"units": {"Q": "V"}}, {"force_constant": [K] * 6, "resistance": [R] * 6}
    late = dict(motor)
    if name == "supply":
        scaled = data | {"scale": {"Q": wrong.tolist()}}
    else:
        scaled, late[key] = data, (wrong * motor[key]).tolist()
    stated = {"estimators": ["gm"], "noise": "given", "tolerances": {"motor": tolerances}}
    run = _run(motor, data, **stated)
    before, after = (
        estimate_parameters(each, read_measurement(file, each.run.data, each.robot))
        for each in (run, _run(late, scaled, **stated))
    )
    known, before, after = before.priors.names, before["gm"], after["gm"]
    names = [one.name for one in before.systematic.deviations]
    place = names.index(f"motor_{name}" if number is None else f"motor_{name}_{number}")
    free = [k for k, n in enumerate(known) if not n.startswith("e")]
    moved, response = after.values - before.values, before.systematic.response[:, place] * error
    scale = error * np.maximum(np.abs(before.values), 1e-3)
    np.testing.assert_allclose((moved / scale)[free], (response / scale)[free], rtol=5e-4)


@pytest.mark.parametrize(
    "section",
    [
        {"units": {"Q": "V"}},
        {"units": {"Q": "%", "U": "mV"}, "columns": {"U": "battery"}},
        {
            "units": {"t": "ms", "q": "mm", "Q": "kN"},
            "columns": {"q1": "first"},
            "order": {"Q": [1, 5, 3, 4, 2, 6]},
            "sign": {"Q": [1, 1, -1, 1, 1, 1]},
            "offset": {"q": "home", "Q": [1, 0, 0, 0, 0, 0]},
            "delimiter": ";",
            "decimal": ",",
        },
    ],
)
def test_the_twin_writes_the_recording_that_its_run_reads(section, tmp_path):
    run = _run(MOTOR | {"supply": "48 V"}, section)
    made = Twin.of(run, trajectory()).measurement()
    write_measurement(made, tmp_path / "measurement.csv", run)
    read = read_measurement(tmp_path / "measurement.csv", run.run.data, run.robot)
    assert read.back_emf == made.back_emf
    assert (made.back_emf is None) == ("kN" in section["units"].values())
    for name in ("time", "lengths", "forces"):
        np.testing.assert_allclose(getattr(read, name), getattr(made, name), rtol=1e-9, atol=1e-9)


def test_a_drawn_machine_has_motors_of_its_own():
    shares = {key: {"common": "2 %", "each": "1 %"} for key in MOTOR_EFFECTS}
    run = _run(MOTOR, {"units": {"Q": "V"}}, tolerances={"motor": shares})
    count = 3 * 7
    draws = np.random.default_rng(3).normal(size=count)
    found = Twin.of(machine_within_tolerances(run, draws).configuration, trajectory())
    scale = np.concatenate([[0.02], np.full(6, 0.01)])
    constant, resistance, supply = (one[0] + one[1:] for one in draws.reshape(3, 7) * scale)
    states = trajectory().sample(found.grid.times)
    speed = ROBOT.strut_motion(states.pose, states.rate, states.acceleration).length_rate
    forces = ROBOT.actuator_forces(states.pose, states.rate, states.acceleration)
    damping = DAMPING * np.exp(resistance - 2 * constant)
    gain = np.exp(constant - resistance) * (1 + np.expm1(supply))
    np.testing.assert_allclose(found.forces, gain * (forces + damping * speed), atol=1e-6)


def test_the_prediction_for_voltages_is_that_of_the_estimate():
    """Force constants are those of the motors, and do not count twice."""
    shares = {key: {"common": "2 %", "each": "1 %"} for key in MOTOR_EFFECTS}
    tolerances = {"motor": shares, "force_constant": {"common": "20 %"}}
    run = _run(MOTOR, {"units": {"Q": "V"}}, ("gm",), noise="given", tolerances=tolerances)
    run = run.with_section("experiment", periods=5, sampling=200.0)
    evaluator = noise_evaluator(run)
    predicted = Prediction.of(run, trajectory()).errors(5).std[-len(evaluator.names) :]
    twin = Twin.of(run, trajectory())
    found = estimate_parameters(run, twin.measurement(), trajectory())
    std = {row.parameter: row.std for row in found.rows}
    expected = [std[name] for name in evaluator.names]
    np.testing.assert_allclose(predicted, expected, rtol=0.15)
    assert predicted[evaluator.names.index("p10")] < 0.05 * 16.307


def test_a_study_of_voltages_has_its_bound():
    run = _run(MOTOR, {"units": {"Q": "V"}}, noise="given")
    run = run.with_section("experiment", periods=3, sampling=200.0)
    run = run.with_section("montecarlo", estimators=("gm",))
    bench = Workbench.of(run, trajectory())
    bound = np.sqrt(np.diag(bench.bound()))
    truth = bench.twin.truth.values_of(bench.robot.parameter_names)
    error = np.array(bench.repeat(1).outcomes["gm"].values) - truth
    free = bound > 0
    assert sum(free) == len(ROBOT.parameter_names)
    assert np.all(error[~free] == 0)
    assert np.sqrt(np.mean((error[free] / bound[free]) ** 2)) < 2


@pytest.mark.slow
def test_intervals_of_estimates_from_duty_cycles_cover(known_channels):
    """Machines drawn from the tolerances of their motors."""
    shares = {key: {"common": "2 %", "each": "1 %"} for key in MOTOR_EFFECTS}
    motor, data = MOTOR | {"supply": "48 V"}, {"units": {"Q": "%"}}
    case = _run(motor, data, ("ml",), tolerances={"motor": shares})
    case = case.with_section("experiment", periods=5, sampling=200.0)
    held = []
    for seed in range(20):
        draw = np.random.default_rng([7, seed]).normal(size=21)
        machine = machine_within_tolerances(case, draw).configuration
        recording = Twin.of(machine, trajectory(), seed=seed).measurement(1)
        found = estimate_parameters(case, recording, trajectory())
        truth = dict(zip(ROBOT.parameter_names, ROBOT.parameters, strict=True))
        own = [name in truth for name in found.priors.names]
        names = [name for name in found.priors.names if name in truth]
        errors = found["ml"].values[own] - [truth[name] for name in names]
        widths = (interval_widths(found["ml"].freedom) * found["ml"].std)[own]
        held.append(np.mean(np.abs(errors) < widths))
    assert abs(np.mean(held) - 0.95) < 3 * np.std(held) / np.sqrt(len(held))
