"""Errors of the measurement that no motion makes: hum, delay, clock, force constants, lost rows."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.data.reading import read_measurement
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimation import parameter_priors
from estimation.twin import Twin
from estimation.twin.truth import write_measurement
from expdesign.configuration import InputError, load_run
from expdesign.robot import load_robot
from tests.twin.examples import TINY, configuration, motion

ROBOT = load_robot("palida")
DISTURBANCES = {
    "force_constant": {"common": 0.02, "each": [0.01, 0, 0, 0, 0, -0.01], "drift": -0.02},
    "hum": {"amplitude": 5.0},
    "delay": 1e-3,
    "clock": 2e-5,
    "strut_length": 1e-4,
    "compliance": 1e-7,
}


def forces(found, number=1):
    return found.measurement(number).forces


def test_force_constants_are_off_and_fall(quiet):
    plain = quiet(periods=4, sampling=50)
    error = {"common": "2 %", "each": [0.01, 0, 0, 0, 0, -0.01], "drift": "-5 %"}
    ratio = quiet(periods=4, sampling=50, force_constant=error).forces / plain.forces
    time = np.arange(400) / 400
    for strut, each in ((0, 0.01), (3, 0.0), (5, -0.01)):
        expected = 1.02 * (1 + each) * (1 - 0.05 * time)
        np.testing.assert_allclose(ratio[:, strut], expected, rtol=1e-12)


def test_lengths_have_a_zero_of_their_own(quiet):
    zeros = [1e-4, 0, 0, -2e-4, 0, 0]
    plain, found = (
        quiet(periods=1, sampling=50, strut_length=z, follows="platform") for z in (0.0, zeros)
    )
    np.testing.assert_allclose(found.lengths - plain.lengths, np.tile(zeros, (100, 1)), atol=1e-15)
    np.testing.assert_array_equal(found.forces, plain.forces)


def test_the_delay_is_that_of_the_cross_correlation(quiet):
    """The lag at which delayed and undelayed forces agree best, between the samples too."""
    lag, sampling = 7.3e-3, 500
    plain, late = (quiet(periods=1, sampling=sampling, delay=d) for d in (0.0, lag))
    np.testing.assert_array_equal(late.lengths, plain.lengths)
    before, after = (np.fft.rfft(t.forces - t.forces.mean(axis=0), axis=0) for t in (plain, late))
    turns = 2j * np.pi * np.arange(len(before)) / plain.grid.period
    lags = np.linspace(0, 2 * lag, 2001)
    spectrum = np.sum(after * before.conj(), axis=1)
    correlation = (np.exp(np.multiply.outer(lags, turns)) @ spectrum).real
    # Dry friction jumps between two samples: a tenth of a step.
    assert lags[np.argmax(correlation)] == pytest.approx(lag, abs=0.1 / sampling)


def test_the_delay_is_that_which_data_states():
    """Where `data.delay` says of it, the estimate knows nothing of it any more."""
    late, noise = 2e-3, {"force_std": [1e-3] * 6, "length_std": [1e-9] * 6}
    experiment = {"periods": 3, "sampling": 200, "delay": late}
    run = {"name": "n", "robot": "palida", "noise": noise, "experiment": experiment}
    run["estimate"] = {"estimators": ["gm"], "harmonics": 3}
    configuration = load_run(run)
    measured = Twin.of(configuration, motion()).measurement()
    known = parameter_priors(configuration, ROBOT)
    off = []
    for told in (late, 0.0):
        data = replace(measured, force_delay=told)
        experiment = prepare_experiment(configuration, ROBOT, data, motion())
        found = run_estimators(ROBOT, [experiment], known, ("gm",))["gm"]
        off.append(np.abs(found.values - ROBOT.parameters) / ROBOT.scales)
    assert np.max(off[0]) < 0.01
    assert np.max(off[1]) > 30 * np.max(off[0])


def test_stamps_of_a_fast_clock(quiet):
    """A hundred parts per million: after 40 s the recording is 4 ms ahead."""
    fast = 1e-4
    found = quiet(periods=20, sampling=50, clock=fast)
    measured = found.measurement()
    np.testing.assert_array_equal(measured.time, np.arange(2000) / 50)
    states = motion().sample(measured.time / (1 + fast))
    np.testing.assert_allclose(found.lengths, ROBOT.inverse_kinematics(states.pose), atol=1e-13)
    np.testing.assert_allclose(found.forces, ROBOT.actuator_forces(*states), atol=1e-9)


# --- hum ------------------------------------------------------------------------------------------


def sinusoids(values, times, frequencies):
    """Return the complex amplitudes of sinusoids, (K, 6), by least squares, and the residuals."""
    angles = 2 * np.pi * np.multiply.outer(times, frequencies)
    basis = np.concatenate([np.sin(angles), np.cos(angles)], axis=1)
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    half = len(frequencies)
    return found[:half] + 1j * found[half:], values - basis @ found


def test_hum_is_a_sinusoid_whose_phase_runs_on(quiet):
    given = {"periods": 3, "sampling": 170}
    hum = {"frequency": 50, "amplitude": [5, 4, 0, 1, 2, 3], "harmonics": [1, 0, 0.5]}
    plain, found = quiet(**given), quiet(**given, hum=hum)
    times = found.grid.times
    amplitudes = []
    for number in (1, 2):
        added = forces(found, number) - plain.forces
        # 150 Hz is seen at 20 Hz of 170 samples per second.
        amplitude, rest = sinusoids(added, times, [50.0, 150.0])
        sizes = np.outer([1, 0.5], [5, 4, 0, 1, 2, 3])
        np.testing.assert_allclose(np.abs(amplitude), sizes, atol=1e-9)
        assert np.abs(rest).max() < 1e-9
        amplitudes.append(amplitude)
    # Each actuator, harmonic and repetition has a phase of its own.
    phases = np.angle(np.array(amplitudes)[:, :, [0, 1, 3, 4, 5]]).ravel()
    assert len(np.unique(np.round(phases, 6))) == 20
    np.testing.assert_array_equal(found.forces, plain.forces)


def test_hum_with_a_phase_that_is_given(quiet):
    hum = {"frequency": 7, "amplitude": 2, "phase": "30 deg", "harmonics": [1, 1]}
    given = {"periods": 1, "sampling": 100}
    found = quiet(**given, hum=hum)
    angle = 2 * np.pi * 7 * found.grid.times + np.pi / 6
    expected = 2 * (np.sin(angle) + np.sin(2 * angle))
    for number in (1, 2):
        added = forces(found, number) - found.forces
        np.testing.assert_allclose(added, np.tile(expected[:, None], 6), atol=1e-9)


# --- lost samples ---------------------------------------------------------------------------------


def test_lost_samples_are_missing_and_the_stamps_say_so(twin):
    whole = twin(periods=3, sampling=100)
    found = twin(periods=3, sampling=100, lost={"rows": [1, 250, 251]})
    kept = np.delete(np.arange(600), [0, 249, 250])
    for number in (1, 2):
        measured, complete = found.measurement(number), whole.measurement(number)
        for name in ("time", "lengths", "forces", "period"):
            np.testing.assert_array_equal(getattr(measured, name), getattr(complete, name)[kept])


def test_a_share_of_the_samples_is_lost_in_every_repetition_anew(twin):
    found = twin(periods=20, sampling=100, lost={"share": "10 %"})
    lost = [set(range(4000)) - set(np.rint(found.measurement(k).time * 100)) for k in (1, 2)]
    deviation = np.sqrt(4000 * 0.1 * 0.9)
    assert all(abs(len(rows) - 400) < 5 * deviation for rows in lost)
    assert abs(len(lost[0] & lost[1]) - 40) < 5 * np.sqrt(40)


def test_a_recording_with_a_gap_is_written_and_read(twin, tmp_path):
    found = twin(periods=3, sampling=100, lost={"rows": [300]})
    path = tmp_path / "measurement.csv"
    write_measurement(found.measurement(), path)
    lines = path.read_text().splitlines()
    assert len(lines) == 600
    assert [line.split(",")[0] for line in lines[299:302]] == ["2.98", "3.0", "3.01"]
    read, made = read_measurement(path, load_run("palida").run.data, ROBOT), found.measurement()
    assert read.lost == made.lost == 1
    np.testing.assert_allclose(read.time, made.time, atol=1e-9)
    np.testing.assert_array_equal(read.lengths, made.lengths)


@pytest.mark.parametrize(
    ("experiment", "key"),
    [
        ({"lost": {}}, "experiment.lost.share"),
        ({"lost": {"share": 0.1, "rows": [1]}}, "experiment.lost.share"),
        ({"lost": {"share": 0.5}}, "experiment.lost.share"),
        ({"lost": {"rows": [0]}}, "experiment.lost.rows[1]"),
        ({"lost": {"rows": [3, 3]}}, "experiment.lost.rows"),
        ({"hum": {}}, "experiment.hum.amplitude"),
        ({"hum": {"amplitude": -1}}, "experiment.hum.amplitude"),
        ({"hum": {"amplitude": 1, "harmonics": []}}, "experiment.hum.harmonics"),
        ({"force_constant": {"each": [0.1] * 5}}, "experiment.force_constant.each"),
        ({"force_constant": {"common": -1}}, "experiment.force_constant.common"),
        ({"clock": 0.5}, "experiment.clock"),
        ({"delay": "1 mm"}, "experiment.delay"),
        ({"compliance": "-1 um/N"}, "experiment.compliance"),
        ({"compliance": "1 N/um"}, "experiment.compliance"),
        ({"strut_length": "1 s"}, "experiment.strut_length"),
    ],
)
def test_bad_input(experiment, key):
    with pytest.raises(InputError) as caught:
        configuration(TINY, **experiment)
    assert caught.value.problems[0].key == key


@pytest.mark.parametrize("rows", [[101], list(range(1, 101))], ids=["not there", "all"])
def test_samples_that_cannot_be_lost(twin, rows):
    with pytest.raises(InputError) as caught:
        twin(periods=1, sampling=50, lost={"rows": rows})
    assert caught.value.problems[0].key == "experiment.lost.rows"


@pytest.mark.parametrize("compliance", [1.0, 1e9])
def test_struts_that_cannot_hold_the_platform(compliance):
    with pytest.raises(InputError, match="cannot make the motion"):
        Twin.of(configuration(TINY, periods=1, sampling=50, compliance=compliance), motion())


@pytest.mark.parametrize("name", DISTURBANCES)
def test_each_is_told_and_changes_no_draw_of_the_noise(twin, name):
    given = {"periods": 2, "sampling": 100}
    plain, other = twin(**given), twin(**given, **{name: DISTURBANCES[name]})
    assert other.truth.disturbed_by == (name.replace("_", " "),)
    assert plain.truth.disturbed_by == ()
    noise, again = (t.measurement(5).lengths - t.lengths for t in (plain, other))
    np.testing.assert_allclose(again, noise, atol=1e-12)
    if name != "hum":
        noise, again = (forces(t, 5) - t.forces for t in (plain, other))
        np.testing.assert_allclose(again, noise, atol=1e-9)
