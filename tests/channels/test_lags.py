"""Lags of all forces and of single channels, at rates over several draws: stated, and mended."""

import re
from dataclasses import replace

import numpy as np
import pytest

from estimation.channels.report import describe_channel_lag, describe_lag
from estimation.channels.wiring import ChannelLag, Wiring
from estimation.data.measurement import Measurement
from estimation.data.sensors import SensorResponse
from estimation.diagnostics.finding import Status
from estimation.identification import estimate, estimate_parameters
from estimation.identification.recording import (
    check_recording,
    fold_measurement,
    prepare_recording,
)
from expdesign.robot import robot_from
from tests.estimation.cases import PERIODS, ROBOT, STEP, measured, run, trajectory

MOTION = trajectory()
QUIET = 0.3
FINER = 10
SAMPLES = round(MOTION.period / STEP)


def behind(seed, *, forces=None, lengths=None):
    """Return a recording behind responses of ω, (T, 6) or (T, 1) each, with usual noise × 0.3."""
    noisy, exact = (measured(MOTION, seed, force_scale=f, length_scale=f) for f in (QUIET, 0.0))
    times = np.arange(SAMPLES * FINER) * STEP / FINER
    states = MOTION.sample(times)
    rates = MOTION.omega * np.arange(len(times) // 2 + 1)

    def passed(series, response):
        if response is None:
            return series[::FINER]
        lines = np.fft.rfft(series, axis=0) * response(rates)
        return np.fft.irfft(lines, len(times), axis=0)[::FINER]

    new = {
        "lengths": passed(ROBOT.inverse_kinematics(states.pose), lengths),
        "forces": passed(
            ROBOT.actuator_forces(states.pose, states.rate, states.acceleration), forces
        ),
    }
    parts = {
        name: np.tile(values, (PERIODS, 1)) + getattr(noisy, name) - getattr(exact, name)
        for name, values in new.items()
    }
    return Measurement(noisy.time, step=STEP, **parts)


def averaged(rates):
    """Return the response of means over four samples: 1.5 samples late."""
    return np.mean(np.exp(-1j * np.multiply.outer(rates, STEP * np.arange(4))), axis=1)[:, None]


def held(rates):
    """Return the response of a hold over three samples: 1.5 samples late."""
    return (np.sinc(1.5 * rates * STEP / np.pi) * np.exp(-1.5j * rates * STEP))[:, None]


def slow(constant, strut):
    """Return the response of a low pass of one channel."""

    def response(rates):
        found = np.ones((len(rates), 6), dtype=complex)
        found[:, strut] /= 1 + 1j * rates * constant
        return found

    return response


def late(delay, strut):
    """Return the response of a delay of one channel."""

    def response(rates):
        found = np.ones((len(rates), 6), dtype=complex)
        found[:, strut] = np.exp(-1j * rates * delay)
        return found

    return response


def lag_of(data, **sections):
    case = run(**sections)
    folded = fold_measurement(case, data, MOTION)
    return check_recording(case, ROBOT, folded, MOTION).lag


@pytest.mark.parametrize("logger", [averaged, held])
@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(8), marks=pytest.mark.slow)])
def test_forces_that_a_logger_has_averaged(logger, seeds):
    """Their lag is stated, 1.5 samples, and never taken for certain as a delay."""
    stated = [lag_of(behind(seed, forces=logger)) for seed in seeds]
    sizes = [float(one.split("by about ")[1].split()[0]) for one in stated if one]
    assert len(sizes) >= len(seeds) - (len(seeds) > 2)
    assert sizes == pytest.approx([7.5] * len(sizes), abs=2)


@pytest.mark.parametrize(
    ("seeds", "least"), [([1], 1), pytest.param([0, 1, 2], 2, marks=pytest.mark.slow)]
)
def test_what_is_stated_of_averaged_forces_mends_them(seeds, least):
    """The estimate repeats the sentence of the check; with its keys it is accepted."""
    accepted = []
    for seed in seeds:
        data = behind(seed, forces=averaged)
        doubtful = estimate(run({"estimators": ["gm"]}), data, MOTION)
        assert doubtful.diagnostics.verdict.status is Status.DOUBTFUL
        sentence = lag_of(data)
        assert sentence in doubtful.warnings
        delay = re.search(r"`data\.delay: {forces: ([^}]*)}`", sentence)
        cutoff = re.search(r"`data\.filter: {Q: {low_pass: (\S+ Hz), order: 1}}`", sentence)
        section = {"delay": {"forces": delay[1]}} if delay else {}
        section |= {"filter": {"Q": {"low_pass": cutoff[1], "order": 1}}} if cutoff else {}
        case = run({"estimators": ["gm"]}, data=section)
        sensors = SensorResponse.of(case.run.data, "Q")
        own = replace(data, force_delay=case.run.data.delay.forces[0], force_sensors=sensors)
        accepted.append(estimate(case, own, MOTION).diagnostics.verdict.status is Status.ACCEPTED)
    assert sum(accepted) >= least


@pytest.mark.parametrize("response", [slow, late])
@pytest.mark.parametrize(("group", "name", "size"), [("lengths", "q", 0.01), ("forces", "Q", 0.02)])
def test_a_lag_of_one_channel(group, name, size, response):
    """The channel is named, as not certain: a filter and a delay are alternatives."""
    right = []
    for seed in range(6):
        data = behind(seed, **{group: response(size, seed)})
        found = lag_of(data)
        sizes = re.match(
            rf"{name}{seed + 1} lags behind the other channels by about (\S+) ms", found
        )
        right.append(sizes is not None and 0.6 < float(sizes[1]) / (1e3 * size) < 1.4)
        assert not found or "(not certain)" in found
    assert sum(right) >= 5


def test_recordings_without_a_lag():
    assert not any(lag_of(behind(seed)) for seed in range(20))


@pytest.mark.parametrize("group", ["lengths", "forces"])
def test_the_diagnosis_names_the_late_channel(group):
    """5 ms: more than a derivative shows, since samples pass jumps of dry friction."""
    strut = 2
    data = behind(502, **{group: late(5e-3, strut)})
    found = estimate(run({"estimators": ["gm"]}), data, MOTION).diagnostics.recordings[0]
    first = found.tests.effects[0]
    assert (first.kind, first.parameter, first.strut) == ("lag", group.removesuffix("s"), strut)
    assert first.value == pytest.approx(5e-3, abs=1e-3)


def prepared(case, data):
    return prepare_recording(case, robot_from(case.robot), data, MOTION)


@pytest.mark.parametrize(("constant", "warned"), [(0.2, True), (0.02, False)])
@pytest.mark.parametrize(
    "warn", [prepared, pytest.param(estimate_parameters, marks=pytest.mark.slow)]
)
def test_a_low_pass_that_is_slower_than_its_model(constant, warned, warn):
    """ωτ is 2.5, or 0.25; the tolerance is as large."""
    data = behind(1, forces=lambda rates: 1 / (1 + 1j * rates[:, None] * constant))
    case = run({"estimators": ["ml"]}, tolerances={"low_pass": {"forces": constant}})
    found = warn(case, data)
    warnings = [one for one in found.warnings if "ωτ" in one]
    assert bool(warnings) == warned
    assert all("State the filter, `data.filter: {Q: {low_pass: 0.796 Hz" in w for w in warnings)


@pytest.mark.parametrize(
    ("stated", "advised"),
    [
        ([0, "5 ms", 0, 0, 0, 0], "[1 ms, 6 ms, 1 ms, 1 ms, 1 ms, 1 ms]"),
        ("-1 ms", "0"),
    ],
)
def test_a_lag_adds_to_the_stated_delays_of_the_channels(stated, advised):
    section = run(data={"delay": {"forces": stated}}).run.data
    assert f"`data.delay: {{forces: {advised}}}`" in describe_lag(ROBOT, 1e-3, 0.0, section)


def test_the_filter_of_a_late_channel_is_that_of_its_column():
    """Delays are those of the struts, filters those of the channels in the file."""
    section = run(data={"order": {"Q": [3, 1, 2, 4, 5, 6]}}).run.data
    lag = ChannelLag("Q", 2, 2e-3)
    said = describe_channel_lag(lag, Wiring.as_measured(), section)
    assert said.startswith("Q3 lags")
    assert "`data.delay: {forces: [0, 0, 2 ms, 0, 0, 0]}`" in said
    key = re.search(r"`data.filter: {(Q\d): {low_pass: 79.6 Hz, order: 1}}`", said)[1]
    filters = run(data={"order": section.order, "filter": {key: {"low_pass": "79.6 Hz"}}}).run.data
    assert [one is not None for one in filters.channel_filters("Q")] == [j == 2 for j in range(6)]
