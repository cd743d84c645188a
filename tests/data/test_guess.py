"""Guesses of the section `data` from the dialects of recorders."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal
from scipy.io import savemat

from estimation.data.guess import guess_data, guess_files
from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError
from expdesign.configuration.parameters import Drive, Screw
from tests.data.recordings import write_bag_folder, write_hdf5, write_mdf

LEAD = 0.02
PER_RADIAN = LEAD / (2 * np.pi)
BEGIN = 1_764_212_345_123_456_789
TIMES = {
    "s": lambda t: t,
    "ms": lambda t: np.round(1e3 * t).astype(int),
    "ns": lambda t: BEGIN + np.round(1e9 * t).astype(np.int64),
    "iso": lambda t: TIMES["ns"](t).astype("datetime64[ns]").astype(str),
}
GERMAN = {"sep": ";", "decimal": ","}
# time and its form; lengths, m; forces, N; other columns; options of the text; guessed units
DIALECTS = [
    ("t", "s", "q{}", 1, "Q{}", 1, ["dq{}"], {}, {}),
    ("time_ms", "ms", "pos_{}_mm", 1e-3, "force{}_kN", 1e3, ["vel_{}"], {}, "ms mm kN"),
    (
        *("Zeit", "iso", "Achse {} Istposition (rev)", LEAD, "Achse {} Moment (Nm)"),
        *(1 / PER_RADIAN, ["Achse {} Sollposition (rev)"], GERMAN, "- rev Nm"),
    ),
    (
        *("Timestamp", "ns", "Axis {}.ActPos [deg]", np.pi / 180 * PER_RADIAN),
        *("Axis {}.ActTorque [mNm]", 1e-3 / PER_RADIAN, ["Axis {}.ActVel [deg/s]"]),
        *({"sep": "\t"}, "ns deg mNm"),
    ),
    ("t", "s", "q{}", 1, "tau{}", 1, ["qd{}", "temp{}"], {}, {}),
    ("Time [s]", "s", "cable_{}_length [cm]", 0.01, "tension_{} [N]", 1, [], {}, "s cm N"),
    ("Zeitstempel", "s", "Istposition_A{}", 1, "Drehmoment_A{}", 1, [], GERMAN, ""),
    ("sec", "s", "enc{} [rad]", PER_RADIAN, "M{} [Nm]", 1 / PER_RADIAN, [], {}, "- rad Nm"),
]


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("dialect", DIALECTS, ids=lambda row: row[4])
def test_the_section_reads_the_recording(dialect, first, tmp_path, rec, palida):
    """Whatever the names, units and marks: what is guessed needs no question to be read."""
    time, form, lengths, metres, forces, newtons, others, options, units = dialect
    frame = rec.frame[["t"]].rename(columns={"t": time})
    frame[time] = TIMES[form](rec.t)
    for number in range(6):
        for other in others:
            frame[other.format(number + first)] = number + rec.t
        frame[lengths.format(number + first)] = rec.q[:, number] / metres
        frame[forces.format(number + first)] = rec.Q[:, number] / newtons
    path = tmp_path / "log.csv"
    frame.to_csv(path, index=False, **options)
    machine = replace(palida, drive=Drive(screw=Screw(lead=LEAD)))
    guess = guess_data(path, machine)
    stated = dict(zip("tqQ", units.split(), strict=True)) if units else {}
    stated = {key: unit for key, unit in stated.items() if unit != "-"}
    assert guess.section.get("units", {}) == stated
    fits = "no offset: the lengths fit the robot's as they are"
    assert guess.facts == ["60 rows, 1000 Hz, 0.059 s", fits]
    assert all("not stated, N is assumed" in text for text in guess.questions)
    assert len(guess.questions) == ("Q" not in stated)
    found = read_measurement(path, DataSection.model_validate(guess.section), machine)
    np.testing.assert_allclose(found.lengths, rec.q, rtol=1e-12)
    np.testing.assert_allclose(found.forces, rec.Q, rtol=1e-12)
    assert found.time == pytest.approx(rec.t, rel=0, abs=1e-11)


@pytest.mark.parametrize(
    ("unit", "metres", "at_home"),
    [("mm", 1e-3, False), ("in", 0.0254, False), ("mm", 1e-3, True), ("rev", LEAD, True)],
)
def test_lengths_without_a_unit_get_the_one_that_fits_the_robot(
    unit, metres, at_home, tmp_path, rec, palida
):
    machine = replace(palida, drive=Drive(screw=Screw(lead=LEAD)))
    home = machine.struts_at(machine.home).lengths
    rec.q = (rec.q - home * at_home) / metres
    rec.frame.to_csv(tmp_path / "log.csv", index=False)
    guess = guess_data(tmp_path / "log.csv", machine)
    assert guess.section.get("offset") == ("home" if at_home else None)
    assert guess.section["units"]["q"] == unit
    assert any(f"units: {{q: {unit}}}: not stated, fits the robot" in q for q in guess.questions)


def test_whole_numbers_without_a_unit_are_counts(tmp_path, rec, palida):
    home = palida.struts_at(palida.home).lengths
    rec.q = np.round((rec.q - home) / 5e-7)
    rec.frame.to_csv(tmp_path / "log.csv", index=False)
    guess = guess_data(tmp_path / "log.csv", palida)
    assert guess.section["units"]["q"] == "counts"
    assert any("whole numbers without a unit" in one for one in guess.questions)
    assert any(one.startswith("q in counts: counts_per_metre") for one in guess.questions)


QUESTIONS = {
    # A hexapod of a laboratory: lengths in cm, and the duty of the motors for their forces.
    "time_ms,len1_cm,len2_cm,len3_cm,len4_cm,len5_cm,len6_cm,pwm1,pwm2,pwm3,pwm4,pwm5,pwm6": (
        "units: {Q: duty}: guessed from the name, −1 to 1",
    ),
    "t,q1,q2,q3,q4,q5,q6,tau1,tau2,tau3,tau4,tau5,tau6,F1,F2,F3,F4,F5,F6": (
        "actuator forces: 'tau#', or 'F#'?",
    ),
    "t,q1,q2,q3,q4,q5,q6,q7,tau1,tau2,tau3,tau4,tau5,tau6,tau7": ("'q#': the first six of 7",),
    # A cable robot: two streams in one file, each with its own stamps.
    "stamp_len,len1,len2,len3,len4,len5,len6,stamp_tau,tau1,tau2,tau3,tau4,tau5,tau6": (
        "the time is stamp_len; stamp_tau too? Lengths and forces of different times are files: {",
    ),
    "a,b": ("no six columns are the strut lengths", "no column is the time"),
    "t,q1 [U],q2 [U],q3 [U],q4 [U],q5 [U],q6 [U],I1 [A],I2 [A],I3 [A],I4 [A],I5 [A],I6 [A]": (
        "units: {q: …}: 'U' is not known",
        "Q in A: force_constants: one value or six, in N/A",
    ),
    "t,q1 [inc],q2 [inc],q3 [inc],q4 [inc],q5 [inc],q6 [inc],F1,F2,F3,F4,F5,F6": (
        "q in inc: counts_per_metre: counts of one metre of the strut, or counts_per_revolution",
    ),
}


@pytest.mark.parametrize("header", QUESTIONS)
def test_what_the_file_does_not_determine_is_a_question(header, tmp_path):
    path = tmp_path / "log.txt"
    width = header.count(",") + 1
    rows = [",".join(str(n + k) for k in range(width)) for n in range(20)]
    path.write_text("\n".join([header, *rows]))
    questions = guess_data(path).questions
    for wanted in QUESTIONS[header]:
        assert any(wanted in question for question in questions), questions


def test_counts_of_unknown_size_leave_the_zero_open(tmp_path, rec, palida):
    columns = {f"q{j}": f"q{j} [inc]" for j in range(1, 7)}
    path = tmp_path / "log.csv"
    rec.frame.rename(columns=columns).to_csv(path, index=False)
    guess = guess_data(path, replace(palida, drive=Drive(screw=Screw(lead=LEAD))))
    assert any("counts_per_revolution" in question for question in guess.questions)
    assert any(fact.startswith("no offset: ") for fact in guess.facts)


def test_counts_that_cross_zero_are_taken_from_home(tmp_path, rec, palida):
    rec.q = np.round((rec.q - rec.q.mean(axis=0)) / 5e-7)
    columns = {f"q{j}": f"q{j} [inc]" for j in range(1, 7)}
    path = tmp_path / "log.csv"
    rec.frame.rename(columns=columns).to_csv(path, index=False)
    for machine in (None, replace(palida, drive=Drive(screw=Screw(lead=LEAD)))):
        guess = guess_data(path, machine)
        assert guess.section["offset"] == "home"
        assert any("readings cross zero" in question for question in guess.questions)
        assert not any("no offset" in fact for fact in guess.facts)


@pytest.mark.parametrize(
    ("others", "supply", "question"),
    [
        ({"battery [V]": 24.0}, "battery [V]", ""),
        ({"battery [V]": 24.0, "logic [V]": 5.0}, None, "battery [V] or logic [V]"),
        ({"bus": 24.0}, None, "is bus the motors' supply?"),
        ({"coil 1 [V]": 1.0, "temperature": 30.0}, "coil 1 [V]", ""),
        ({f"coil {j} [V]": 1.0 for j in range(6)}, None, ""),
    ],
)
def test_the_only_voltage_of_duty_cycles_is_their_supply(
    others, supply, question, tmp_path, rec, palida
):
    columns = {f"Q{j}": f"pwm{j} [%]" for j in range(1, 7)}
    path = tmp_path / "log.csv"
    rec.frame.rename(columns=columns).assign(**others).to_csv(path, index=False)
    guess = guess_data(path, palida)
    assert guess.section["columns"].get("U") == supply
    assert guess.section["units"].get("U") == (supply and "V")
    asked = [one for one in guess.questions if "the motors' supply" in one]
    assert len(asked) == bool(question)
    assert all(question in one for one in asked)


@pytest.mark.parametrize(
    ("before", "after", "wanted"),
    [
        ("Recorder 5\n\n", "", {"before": 2}),
        ("", "[ms]\t" + 6 * "[mm]\t" + 5 * "[N]\t" + "[N]\n", {"after": 1}),
        ("No. 7\n", "[ms]\t" + 6 * "[mm]\t" + 6 * "[N]\t" + "\n", None),
    ],
)
def test_lines_around_the_names(before, after, wanted, tmp_path, rec, palida):
    path = tmp_path / "log.tsv"
    header, rows = rec.frame.to_csv(index=False, sep="\t").split("\n", 1)
    path.write_text(f"{before}{header}\n{after}{rows}")
    guess = guess_data(path)
    assert guess.section["header"] == (wanted or {"before": 1, "after": 1})
    if after:
        assert guess.section["units"] == {"t": "ms", "q": "mm", "Q": "N"}
    else:
        found = read_measurement(path, DataSection.model_validate(guess.section), palida)
        assert np.array_equal(found.lengths, rec.q)


def test_stamps_that_jitter_and_steps_of_milliseconds(tmp_path, rec):
    rng = np.random.default_rng(0)
    rec.t = 2.0 * np.arange(60) + rng.uniform(-0.5, 0.5, 60)
    rec.frame.to_csv(tmp_path / "log.csv", index=False)
    guess = guess_data(tmp_path / "log.csv")
    assert guess.section["time"] == "stamped"
    assert guess.section["units"] == {"t": "ms"}
    assert "guessed from steps of" in guess.questions[0]


@pytest.mark.parametrize(("begin", "step", "unit"), [(2.5e9, 1e3, "us"), (3e11, 1e6, "ns")])
def test_a_counter_is_no_date(begin, step, unit, tmp_path, rec, palida):
    """Its first value may be that of a date, its steps are not."""
    frame = rec.frame
    frame["t"] = (begin + step * np.arange(60)).astype(np.int64)
    frame.to_csv(tmp_path / "log.csv", index=False)
    guess = guess_data(tmp_path / "log.csv")
    assert guess.section["units"] == {"t": unit}
    assert f"units: {{t: {unit}}}: guessed from steps of {step:g}" in guess.questions
    assert guess.facts[0].startswith("60 rows, 1000 Hz")
    with pytest.raises(InputError, match="a counter of an unknown unit") as caught:
        read_measurement(tmp_path / "log.csv", DataSection(), palida)
    assert "data.units: {t: us}" in caught.value.problems[0].allowed


@pytest.mark.parametrize(("amplitude", "unit"), [(40.0, "mm"), (0.04, "m"), (0.0, "m")])
def test_the_unit_of_lengths_from_home_follows_from_their_motion(
    amplitude, unit, tmp_path, rec, palida
):
    rec.q = 1e-3 + amplitude * np.sin(0.3 * np.arange(60)[:, None] + np.arange(6))
    rec.frame.to_csv(tmp_path / "log.csv", index=False)
    guess = guess_data(tmp_path / "log.csv", palida)
    assert guess.section["offset"] == "home"
    assert guess.section.get("units", {}).get("q", "m") == unit
    asked = [text for text in guess.questions if text.startswith(f"units: {{q: {unit}}}")]
    assert len(asked) == (amplitude != 0.04), "a motion confirms m"


def _write_structs(path, rec):
    savemat(path, {"log": {"time": rec.t, "pos": rec.q, "force": rec.Q, "cmd": 2 * rec.q}})


def _write_numpy(path, rec):
    np.savez(path, t=rec.t, q=rec.q, Q=rec.Q)


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("log.mat", _write_structs),
        ("log.npz", _write_numpy),
        ("log.h5", write_hdf5),
        ("log.mf4", write_mdf),
        ("log", write_bag_folder),
    ],
)
def test_other_files(name, write, tmp_path, rec, palida):
    write(tmp_path / name, rec)
    guess = guess_data(tmp_path / name, palida)
    found = read_measurement(tmp_path / name, DataSection.model_validate(guess.section), palida)
    assert guess.questions == ["units: {Q: …}: not stated, N is assumed"]
    assert np.array_equal(found.lengths, rec.q)
    assert np.array_equal(found.forces, rec.Q)


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(("unit", "question"), [("kN", ""), ("N m", "the lead")])
def test_units_that_an_mdf_file_states(unit, question, tmp_path, rec):
    units = {"q": "m", "Q": unit}
    with MDF(version="4.10") as file:
        channels = [(name, values) for name, values in rec.columns.items() if name != "t"]
        file.append([Signal(v, rec.t, name=name, unit=units[name[0]]) for name, v in channels])
        file.save(tmp_path / "log.mf4")
    guess = guess_data(tmp_path / "log.mf4")
    assert guess.section["units"]["Q"] == unit
    assert len(guess.questions) == bool(question)
    assert all(question in text for text in guess.questions)


def test_two_files_in_the_wrong_order_are_refused(tmp_path, rec):
    files = tmp_path / "torque.csv", tmp_path / "pos.csv"
    for file, name, values in zip(files, ("ActTorque", "ActPos"), (rec.Q, rec.q), strict=True):
        columns = [f"{name}{j}" for j in range(1, 7)]
        pd.DataFrame(values, columns=columns).to_csv(file, index=False)
    with pytest.raises(InputError, match="lengths first") as error:
        guess_files(*files)
    assert error.value.problems[0].file == files[0]
    assert guess_files(*reversed(files)).section["columns"]["Q6"] == "ActTorque6"


def test_two_files_without_time_need_a_rate_and_units_alone(tmp_path, rec, palida):
    """As drives store them: positions of motors, and torques, with the same names."""
    names = [f"Joint_{j}" for j in range(1, 7)]
    files = {"lengths": tmp_path / "pos.csv", "forces": tmp_path / "torque.csv"}
    pd.DataFrame(rec.q / PER_RADIAN, columns=names).to_csv(files["lengths"], index=False)
    pd.DataFrame(rec.Q * PER_RADIAN, columns=names).to_csv(files["forces"], index=False)
    guess = guess_files(files["lengths"], files["forces"])
    asked = [question.partition("{")[0] for question in guess.questions]
    assert asked == ["no column is the time: state columns: ", "units: ", "units: "]
    assert any("m is assumed; around" in question for question in guess.questions)
    edited = {"units": {"q": "rad", "Q": "Nm"}, "sampling": "1 kHz"}
    paths = {key: str(file) for key, file in files.items()}
    section = DataSection.model_validate({**guess.section, "files": paths, **edited})
    machine = replace(palida, drive=Drive(screw=Screw(lead=LEAD)))
    found = read_measurement(tmp_path / ".." / tmp_path.name / "pos.csv", section, machine)
    np.testing.assert_allclose(found.lengths, rec.q, rtol=1e-12)
    np.testing.assert_allclose(found.forces, rec.Q, rtol=1e-12)
