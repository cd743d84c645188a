"""Filters and delays of single channels: the response, and estimates from filtered forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.data.reading import read_measurement
from estimation.data.sensors import SensorResponse
from estimation.diagnostics.finding import Status
from estimation.diagnostics.gain_drift import gain_drift
from estimation.diagnostics.linearisation import linearise
from estimation.diagnostics.noise_tests import noise_tests
from estimation.estimators import PerturbedMachine
from estimation.identification import estimate_parameters
from estimation.identification.calibration import apply_calibration
from estimation.identification.estimate import estimate
from estimation.identification.periods import leave_out_ramps
from estimation.identification.recording import (
    check_recording,
    fold_measurement,
    prepare_experiment,
)
from estimation.processing.period import find_settled_window
from estimation.twin import Twin
from estimation.twin.truth import write_measurement
from expdesign.configuration import InputError
from expdesign.configuration.estimate import DataSection
from expdesign.robot import robot_from
from expdesign.robot.deviation import toleranced_deviations
from tests.estimation.cases import ROBOT, STEP, run
from tests.estimation.cases import trajectory as palida_motion

_FINER = 40
"""Steps of the simulated filter within a step of the recording."""


def _response(**section: Any) -> SensorResponse:
    found = SensorResponse.of(DataSection.model_validate(section), "Q")
    assert found is not None
    return found


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("zero_phase", [False, True])
def test_a_periodic_signal_passes_the_filter_as_in_a_simulation_with_fine_steps(
    order: int, zero_phase: bool
) -> None:
    samples, step = 400, 1e-3
    fine = np.arange(samples * _FINER) * step / _FINER
    wave = np.sin(2 * np.pi * fine / 0.4) + np.cos(2 * np.pi * 7 * fine / 0.4)
    sections = signal.butter(order, 60.0, fs=_FINER / step, output="sos")
    passing = signal.sosfiltfilt if zero_phase else signal.sosfilt
    settled = passing(sections, np.tile(wave, 3))[len(wave) : 2 * len(wave)]
    low_pass = {"low_pass": "60 Hz", "order": order, "zero_phase": zero_phase}
    sensors = _response(filter={"Q2": low_pass})
    series = np.repeat(wave[::_FINER, None], 6, axis=1)
    recorded = sensors.apply(series, step)
    assert np.allclose(recorded[:, 1], settled[::_FINER], atol=2e-5)
    assert np.allclose(recorded[:, [0, 2]], series[:, [0, 2]], atol=1e-12)
    assert np.allclose(sensors.undo(recorded, step), series, atol=1e-11)


@pytest.mark.parametrize("zero_phase", [False, True])
def test_gains_have_a_floor_however_steep_the_filter(zero_phase: bool) -> None:
    low_pass = {"low_pass": "100 Hz", "order": 8, "zero_phase": zero_phase}
    gains = np.abs(_response(filter={"Q": low_pass}).lines(1000, 1e-4))
    assert np.min(gains) == pytest.approx(1e-4)


def test_filters_follow_the_channels_of_the_file_and_delays_the_struts() -> None:
    delays = ["1 ms", *["0 ms"] * 5]
    sensors = _response(
        filter={"Q": {"low_pass": "50 Hz"}, "Q1": {"low_pass": "10 Hz"}},
        order=[2, 1, 3, 4, 5, 6],
        delay={"forces": delays},
    )
    assert [each and each.low_pass for each in sensors.filters] == [50, 10, 50, 50, 50, 50]
    assert np.allclose(np.diff(sensors.delays[:2]), -1e-3)
    assert SensorResponse.of(run(data={"delay": {"forces": "1 ms"}}).run.data, "Q") is None


def _record_filtered(file: Path, tau: float, late: Sequence[float]) -> None:
    """Write a recording whose forces pass a first-order filter, simulated in fine steps."""
    motion, rng = palida_motion(), np.random.default_rng(3)
    noise = ROBOT.description.noise
    assert noise is not None
    fine = np.arange(round(motion.period / STEP) * _FINER) * STEP / _FINER
    sections = signal.butter(1, 1 / (2 * np.pi * tau), fs=_FINER / STEP, output="sos")
    forces = np.empty((len(fine), 6))
    for actuator, delay in enumerate(late):
        force = ROBOT.actuator_forces(*motion.sample(fine - delay))[:, actuator]
        forces[:, actuator] = signal.sosfilt(sections, np.tile(force, 3))[len(fine) : 2 * len(fine)]
    times = np.arange(10 * len(fine) // _FINER) * STEP

    def draw(covariance: Array) -> Array:
        return rng.multivariate_normal(np.zeros(6), covariance, len(times))

    lengths = ROBOT.inverse_kinematics(motion.sample(times).pose) + draw(noise.length_covariance)
    forces = np.tile(forces[::_FINER], (10, 1)) + draw(noise.force_covariance)
    write_measurement(Measurement(times, lengths, forces, STEP), file)


def test_known_filters_and_delays_of_the_forces_leave_no_bias(tmp_path: Path) -> None:
    tau, late = 4e-3, [0.0, 3e-3, 0.0, 0.0, 6e-3, 0.0]
    _record_filtered(tmp_path / "m.csv", tau, late)
    known = {
        "filter": {"Q": {"low_pass": 1 / (2 * np.pi * tau)}},
        "delay": {"forces": [f"{1e3 * each} ms" for each in late]},
    }
    distances = {}
    for name, data in (("unknown", {}), ("known", known)):
        case = run(data=data)
        recording = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
        result = estimate(case, recording, palida_motion())
        for estimator in ("ls", "gm", "ml"):
            found = result[estimator]
            error = np.array(list(found.values.values())) - ROBOT.parameters
            covariance = np.array(found.covariance)
            distances[name, estimator] = error @ np.linalg.solve(covariance, error) / len(error)
        assert result.diagnostics is not None
        doubtful = result.diagnostics.verdict.status is not Status.ACCEPTED
        assert doubtful == (name == "unknown")
    for (name, _), distance in distances.items():
        assert distance > 4 if name == "unknown" else distance < 2.5, distances


def test_the_noise_behind_a_known_filter_is_tested_as_it_was_recorded(tmp_path: Path) -> None:
    tau = 20e-3
    _record_filtered(tmp_path / "m.csv", tau, [0.0] * 6)
    case = run(data={"filter": {"Q": {"low_pass": 1 / (2 * np.pi * tau)}}})
    data = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
    filtered = prepare_experiment(case, ROBOT, data, palida_motion())
    channels, every = filtered.recording.forces, np.ones(len(ROBOT.parameters), dtype=bool)
    part = linearise(ROBOT, filtered, ROBOT.parameters, every, filtered.fitted.motion)
    # The same recording without any filter, which leaves the residuals that were recorded.
    values = channels.as_recorded(channels.values)
    periods = data.forces.reshape(-1, *values.shape)
    recorded = replace(channels, values=values, periods=periods, response=None)
    recording, noise = replace(filtered.recording, forces=recorded), filtered.noise.as_white()
    plain = replace(filtered, recording=recording, noise=noise)
    one, other = (
        noise_tests(each.recording, each.noise, part.force_rows, None) for each in (plain, filtered)
    )
    seen, found = one.whiteness.force_noise, other.whiteness.force_noise
    assert seen is not None
    assert found is not None
    assert np.allclose(found.autocorrelation, seen.autocorrelation, atol=1e-9)
    assert found.statistic == pytest.approx(seen.statistic)
    expected = gain_drift(plain, part, 0.01)
    assert gain_drift(filtered, part, 0.01).scale == pytest.approx(expected.scale, rel=1e-4)


def test_unknown_delays_of_single_channels_are_estimated() -> None:
    # A jump of dry friction between two samples is no derivative of a delay.
    about = ROBOT.description
    smooth = {name: 0.0 if name[0] == "r" else value for name, value in about.parameters.items()}
    robot = about.description.model_copy(update={"parameters": smooth})
    late = {"forces": [0.8e-3, -0.5e-3, 0, 0, 1e-3, 0], "lengths": [0, 0, 1.5e-4, 0, 0, -1e-4]}
    case = run(
        robot=robot,
        experiment={"sampling": "500 Hz", "channel_delay": late},
        tolerances={"channel_delay": {"forces": "0.7 ms", "lengths": "0.1 ms"}},
        noise={"force_std": ["1 N"] * 6, "length_std": ["10 um"] * 6},
    )
    data = Twin.of(case, palida_motion(), seed=5).measurement(1)
    found = estimate_parameters(case, data, palida_motion()).estimates
    ml, gm = found["ml"], found["gm"]
    assert ml.systematic is not None
    std = np.array([one.std for one in ml.systematic.deviations])
    assert np.all(std[:6] < 2.1e-4)
    truth = np.array([*late["forces"], *late["lengths"]])
    assert np.mean(((ml.systematic.values - truth) / std) ** 2) < 2
    for each in (ml, gm):
        error = each.values - np.array(list(smooth.values()))
        assert np.mean((error / each.std) ** 2) < 2
    # GM does not estimate the delays: its budget contains them.
    assert np.median(ml.std / gm.std) < 0.8


def test_unknown_low_passes_of_single_channels_are_estimated() -> None:
    about = ROBOT.description
    smooth = {name: 0.0 if name[0] == "r" else value for name, value in about.parameters.items()}
    robot = about.description.model_copy(update={"parameters": smooth})
    constants = {"forces": [5e-3, 0, 2e-3, 0, 4e-3, 1e-3], "lengths": [0, 0, 0.6e-3, 0, 0, 0]}
    delays = {"forces": [-1e-3, 0, 0, 0.8e-3, 0, 0]}
    case = run(
        {"estimators": ["ml"]},
        robot=robot,
        experiment={"sampling": "200 Hz", "low_pass": constants, "channel_delay": delays},
        tolerances={
            "low_pass": {"forces": "3 ms", "lengths": "0.5 ms"},
            "channel_delay": {"forces": "1 ms"},
        },
        noise={"force_std": ["1 N"] * 6, "length_std": ["20 um"] * 6},
    )
    data = Twin.of(case, palida_motion(), seed=5).measurement(1)
    ml = estimate_parameters(case, data, palida_motion())["ml"]
    assert ml.systematic is not None
    found = {one.name: one for one in ml.systematic.deviations}
    stated = {"force_low_pass": constants["forces"], "length_low_pass": constants["lengths"]}
    stated |= {"force_delay": delays["forces"]}
    off = []
    for name, values in stated.items():
        for actuator, true in enumerate(values, 1):
            one = found[f"{name}_{actuator}"]
            assert one.value >= 0 or name == "force_delay"
            off.append((one.value - true) / one.std)
    assert np.mean(np.square(off)) < 2
    # A low pass and a delay of one force are separated, if less surely than their sum is known.
    assert found["force_low_pass_1"].std < 0.4 * 3e-3
    error = ml.values - np.array(list(smooth.values()))
    assert error @ np.linalg.solve(ml.covariance, error) / len(error) < 2


@pytest.mark.parametrize("differentiation", ["auto", "spline"])
def test_estimated_low_passes_are_removed(differentiation: str) -> None:
    motion, constants = palida_motion(), 1e-3 * np.array([5.0, 0, 1, 3, 0, 2])
    times = STEP * np.arange(round(2 * motion.period / STEP))
    phases = motion.omega * times[:, None]
    chosen = toleranced_deviations(robot_from(run(tolerances={"low_pass": {"forces": 1}}).robot))
    machine = PerturbedMachine.of(ROBOT, chosen, constants)
    slow = np.real(np.exp(4j * phases) / (1 + 4j * motion.omega * constants))
    case = run({"differentiation": differentiation, "estimators": ["gm"]})
    data = apply_calibration(case, Measurement(times, slow, slow), motion, machine)
    forces, sensors = data.forces, data.force_sensors
    assert (sensors is None) == (differentiation == "spline")
    if sensors is not None:
        forces = sensors.undo(forces, STEP)
    assert np.max(np.abs(forces - np.cos(4 * phases))[20:-20]) < 1e-4


@pytest.mark.parametrize("periods", [2.0, 2.37])
def test_estimated_delays_are_removed_up_to_the_ends_of_a_recording(periods: float) -> None:
    # Delays of 20 steps: held or extrapolated ends would be wrong by a tenth of the amplitude.
    motion = palida_motion()
    times = STEP * np.arange(round(periods * motion.period / STEP))
    late = 20 * STEP * np.array([1.0, -1.0, 0.5, 0.0, -0.3, 0.0])

    def signals(delays: Array) -> Array:
        phases = motion.omega * (times[:, None] - delays)
        return np.sin(phases) + 0.3 * np.cos(4 * phases)

    names = [f"{kind}_delay_{j}" for kind in ("force", "length") for j in range(1, 7)]
    tolerances = {"channel_delay": {"forces": "1 ms", "lengths": "1 ms"}}
    chosen = toleranced_deviations(robot_from(run(tolerances=tolerances).robot))
    assert [one.name for one in chosen] == names
    machine = PerturbedMachine.of(ROBOT, chosen, np.concatenate([late, -late]))
    data = Measurement(times, signals(-late), signals(late))
    found = apply_calibration(run(), data, motion, machine)
    for values in (found.forces, found.lengths):
        assert np.max(np.abs(values - signals(np.zeros(6)))) < 1e-4
    single = run({"differentiation": "spline", "estimators": ["gm"]})
    found = apply_calibration(single, data, None, machine)
    for values in (found.forces, found.lengths):
        assert np.max(np.abs(values - signals(np.zeros(6)))[20:-20]) < 1e-4


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ({"estimate": {"differentiation": "central"}}, "data.filter"),
        ({"estimate": {"frequency": "estimated"}}, "data.filter"),
        ({"estimate": {"loss": "huber"}}, "data.filter"),
    ],
)
def test_filters_need_the_means_of_a_known_period(section: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match="whole periods") as refused:
        run(**section, data={"filter": {"q": {"low_pass": "50 Hz"}}})
    assert refused.value.problems[0].key == key


def _record_with_noise_filtered(
    file: Path, seed: int, low_pass: dict[str, Any], *, ends: bool = False
) -> None:
    """Write a recording whose forces a logger has filtered with their noise, at its own rate."""
    motion, rng, step = palida_motion(), np.random.default_rng(seed), STEP / 2
    samples = round(motion.period / step)
    before = 0 if ends else samples
    times = step * np.arange(-before, 10 * samples + before)
    noise = ROBOT.description.noise
    assert noise is not None

    def draw(covariance: Array) -> Array:
        return rng.multivariate_normal(np.zeros(6), covariance, len(times))

    state = motion.sample(times)
    forces = ROBOT.actuator_forces(*state) + draw(noise.force_covariance)
    own = signal.butter(low_pass["order"], low_pass["low_pass"], fs=1 / step)
    passing = signal.filtfilt if low_pass["zero_phase"] else signal.lfilter
    forces = passing(*own, forces, axis=0)
    lengths = ROBOT.inverse_kinematics(state.pose) + draw(noise.length_covariance)
    used = slice(before, before + 10 * samples)
    times = step * np.arange(10 * samples)
    write_measurement(Measurement(times, lengths[used], forces[used], step), file)


_LOGGERS = [
    (40.0, 3, True, False),
    (40.0, 3, True, True),
    (60.0, 1, True, True),
    (100.0, 2, True, False),
    (40.0, 2, False, False),
    (100.0, 1, False, False),
]


@pytest.mark.parametrize(("cutoff", "order", "zero_phase", "ends"), _LOGGERS)
def test_noise_that_has_passed_the_filter_leaves_estimates_that_are_accepted(
    tmp_path: Path, cutoff: float, order: int, zero_phase: bool, ends: bool
) -> None:
    low_pass = {"low_pass": cutoff, "order": order, "zero_phase": zero_phase}
    _record_with_noise_filtered(tmp_path / "m.csv", 0, low_pass, ends=ends)
    case = run({"estimators": ["gm"]}, data={"filter": {"Q": low_pass}})
    recording = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
    result = estimate(case, recording, palida_motion())
    found = result["gm"]
    error = np.array(list(found.values.values())) - ROBOT.parameters
    covariance = np.array(found.covariance)
    assert error @ np.linalg.solve(covariance, error) / len(error) < 2.5
    assert result.diagnostics is not None
    verdict = result.diagnostics.verdict
    assert verdict.status is Status.ACCEPTED, verdict.summary
    assert any("Hz on they are left out" in each for each in result.warnings)


@pytest.mark.parametrize("stated", [True, False])
def test_a_filtered_recording_with_a_silent_force(tmp_path: Path, stated: bool) -> None:
    """It is named behind a filter, too; forces whose filter is not stated are doubted."""
    low_pass = {"low_pass": 40.0, "order": 3, "zero_phase": True}
    for seed in (0, 1):
        _record_with_noise_filtered(tmp_path / f"{seed}.csv", seed, low_pass)
    case = run({"estimators": ["gm"]}, data={"filter": {"Q": low_pass}} if stated else {})
    clean, other = (
        read_measurement(tmp_path / f"{seed}.csv", case.run.data, case.robot) for seed in (0, 1)
    )
    forces = clean.forces.copy()
    forces[:, 2] = np.mean(forces[:, 2]) + (clean.forces - other.forces)[:, 2]
    design = palida_motion()
    found = [
        check_recording(case, ROBOT, fold_measurement(case, each, design), design).silent
        for each in (clean, replace(clean, forces=forces))
    ]
    assert not found[0]
    assert found[1].startswith("Q3 ")
    if not stated:
        diagnostics = estimate(case, clean, design).diagnostics
        assert diagnostics is not None
        assert diagnostics.verdict.status is Status.DOUBTFUL


@pytest.mark.parametrize("zero_phase", [False, True])
def test_a_digital_filter_is_that_of_its_own_rate(zero_phase: bool) -> None:
    samples, step = 400, 2e-3
    times = np.arange(3 * samples) * step
    wave = np.sin(2 * np.pi * times / 0.8) + np.cos(2 * np.pi * 90 * times / 0.8)
    passing = signal.filtfilt if zero_phase else signal.lfilter
    settled = passing(*signal.butter(2, 80.0, fs=1 / step), wave)[samples : 2 * samples]
    low_pass = {"low_pass": 80, "order": 2, "zero_phase": zero_phase, "sampling": "500 Hz"}
    series = np.repeat(wave[:samples, None], 6, axis=1)
    recorded = _response(filter={"Q": low_pass}).apply(series, step)
    assert np.allclose(recorded, settled[:, None], atol=1e-9)
    with pytest.raises(ValueError, match="digital filter"):
        _response(filter={"Q": low_pass | {"sampling": "150 Hz"}})


@pytest.mark.parametrize("still", [False, True])
def test_two_periods_behind_a_slow_filter_are_enough(tmp_path: Path, still: bool) -> None:
    """Their undamped lines are fewer than the channels; and a length may have no noise."""
    low_pass = {"low_pass": 1.5, "order": 2, "zero_phase": True}
    _record_with_noise_filtered(tmp_path / "m.csv", 0, low_pass)
    case = run({"estimators": ["gm"]}, data={"filter": {"Q": low_pass, "q2": low_pass}})
    recording = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
    used = slice(0, 2 * round(palida_motion().period / recording.step))
    lengths = recording.lengths[used].copy()
    if still:
        half = len(lengths) // 2
        lengths[half:, 1] = lengths[:half, 1]
    two = replace(
        recording, time=recording.time[used], lengths=lengths, forces=recording.forces[used]
    )
    if still:
        with pytest.raises(InputError, match="q2: the recording shows no noise at all"):
            fold_measurement(case, two, palida_motion())
        return
    folded, noise = fold_measurement(case, two, palida_motion())
    assert folded.forces.kept is not None
    assert np.all(np.linalg.eigvalsh(noise.forces.covariance) > 0)


def test_lines_that_are_left_out_have_no_weight_and_leave_white_noise(tmp_path: Path) -> None:
    low_pass = {"low_pass": 40.0, "order": 3, "zero_phase": True}
    _record_with_noise_filtered(tmp_path / "m.csv", 0, low_pass)
    case = run(data={"filter": {"Q": low_pass}})
    recording = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
    folded, noise = fold_measurement(case, recording, palida_motion())
    forces, whitening, sensors = folded.forces, noise.forces.filter, recording.force_sensors
    assert whitening is not None
    assert sensors is not None
    assert forces.kept == pytest.approx(40 * folded.period, abs=8)
    assert whitening.count == 2 * forces.kept - 1
    # Nothing is added to the recording.
    mean = recording.forces.reshape(-1, *forces.values.shape).mean(axis=0)
    assert np.allclose(forces.values, sensors.undo(mean, recording.step))
    rng = np.random.default_rng(1)
    high = np.fft.irfft(np.pad(rng.normal(size=(20, 6)), ((180, 1), (0, 0))), 400, axis=0)
    assert np.allclose(whitening(high), 0)
    one, other = rng.normal(size=(400, 6)), rng.normal(size=(whitening.count, 6))
    assert np.sum(whitening(one) * other) == pytest.approx(np.sum(one * whitening.adjoint(other)))
    assert np.sum(whitening(one) ** 2) == pytest.approx(np.sum(whitening.rows(one) ** 2))
    assert forces.periods is not None
    rest = np.stack([whitening(each) for each in forces.periods - forces.values])
    found = np.einsum("mni,mnj->ij", rest, rest) / (9 * whitening.count)
    assert np.allclose(found, noise.forces.covariance, atol=0.1 * np.max(found))


@pytest.mark.parametrize("sampling", [None, 400.0])
def test_the_delay_of_a_digital_filter_asks_for_its_sampling(sampling: float | None) -> None:
    motion, step, rng = palida_motion(), STEP / 2, np.random.default_rng(0)
    low_pass: dict[str, Any] = {"low_pass": 80.0, "order": 2}
    samples = round(motion.period / step)
    times = step * np.arange(-samples, 10 * samples)
    state, noise = motion.sample(times), ROBOT.description.noise
    assert noise is not None
    own = signal.butter(2, 80.0, fs=1 / step)
    lengths, forces = (
        values + 0.1 * rng.multivariate_normal(np.zeros(6), covariance, len(times))
        for values, covariance in (
            (ROBOT.inverse_kinematics(state.pose), noise.length_covariance),
            (signal.lfilter(*own, ROBOT.actuator_forces(*state), axis=0), noise.force_covariance),
        )
    )
    stated = low_pass | ({"sampling": sampling} if sampling else {})
    case = run({"estimators": ["gm"]}, data={"filter": {"Q": stated}})
    sensors = SensorResponse.of(case.run.data, "Q")
    used = slice(samples, None)
    data = Measurement(times[used], lengths[used], forces[used], step, force_sensors=sensors)
    result = estimate(case, data, motion)
    assert result.diagnostics is not None
    accepted = result.diagnostics.verdict.status is Status.ACCEPTED
    assert accepted == (sampling is not None)
    asked = any("state `sampling: 400 Hz` there" in each for each in result.warnings)
    assert asked == (sampling is None)


def test_periods_are_left_out_in_which_a_stated_filter_begins_from_nothing(
    tmp_path: Path,
) -> None:
    low_pass = {"low_pass": 10.0, "order": 2, "zero_phase": False}
    _record_with_noise_filtered(tmp_path / "m.csv", 1, low_pass, ends=True)
    case = run({"estimators": ["gm"]}, data={"filter": {"Q": low_pass}})
    recording = read_measurement(tmp_path / "m.csv", case.run.data, case.robot)
    found = leave_out_ramps(case, recording, palida_motion())
    assert len(recording) - len(found) == round(palida_motion().period / recording.step)
    assert found.time[0] == pytest.approx(recording.time[0] + palida_motion().period)
    assert "had not settled" in found.warnings[-1]
    settled = replace(recording, force_sensors=None)
    assert leave_out_ramps(case, settled, palida_motion()) is settled


def test_a_period_is_left_out_in_which_the_filter_of_the_lengths_alone_has_not_settled() -> None:
    samples, rng = 200, np.random.default_rng(2)
    period = samples * STEP
    times = STEP * np.arange(8 * samples)
    lengths = 0.7 + 0.1 * np.sin(2 * np.pi * times / period)[:, None] + np.zeros(6)
    lengths += 1e-5 * rng.normal(size=lengths.shape)
    lengths[:, 5] = 0.7  # a strut at rest
    forces = 20.0 * rng.normal(size=lengths.shape)
    section = DataSection.model_validate(
        {"filter": {name: {"low_pass": "10 Hz"} for name in ("q", "Q")}}
    )
    of_lengths, of_forces = (SensorResponse.of(section, name) for name in ("q", "Q"))

    def window(values: Array) -> tuple[float, float] | None:
        data = Measurement(
            times, values, forces, STEP, length_sensors=of_lengths, force_sensors=of_forces
        )
        return find_settled_window(data, 2 * np.pi / period)

    assert window(lengths) is None
    lengths[:20, :5] += 1e-3
    assert window(lengths) == pytest.approx((period, 8 * period))
