"""Units of columns: stated in the run file, in the header, or SI."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError, load_run
from expdesign.configuration.parameters import Drive, Gear, Motor, Screw
from expdesign.configuration.quantity import quantity_of_unit
from expdesign.library import robot_files
from tests.data.recordings import CHANNELS, write_csv

SHARED = settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
LENGTHS = ("m", "dm", "cm", "mm", "µm", "in", "ft", "km")
TIMES = ("s", "ms", "us", "min", "h")
FORCES = ("N", "kN", "mN", "lbf", "kg m/s^2")
CURRENTS = ("A", "mA")
_OF = {"t": TIMES, "q": LENGTHS, "Q": FORCES}
_FILE = robot_files()["palida"]
LEAD = 0.008


def _factor(unit):
    return quantity_of_unit(unit).parse(f"1 {unit}")


def _close(found, rec):
    assert np.allclose(found.lengths, rec.q, rtol=1e-12, atol=0)
    assert np.allclose(found.forces, rec.Q, rtol=1e-12, atol=0)
    assert np.allclose(found.time, rec.t, rtol=0, atol=1e-11)


@given(
    units=st.fixed_dictionaries({c: st.sampled_from(_OF[c[0]]) for c in CHANNELS}),
    in_header=st.sets(st.sampled_from(CHANNELS)),
)
@SHARED
def test_estimates_do_not_depend_on_the_units_of_the_file(units, in_header, tmp_path, rec, read):
    """Each column in a unit of its own, told by the header or by the run file."""
    path = tmp_path / "m.csv"
    frame = rec.frame
    for channel, unit in units.items():
        frame[channel] /= _factor(unit)
    frame.columns = [f"{c} [{units[c]}]" if c in in_header else c for c in frame.columns]
    frame.to_csv(path, index=False)
    stated = {channel: unit for channel, unit in units.items() if channel not in in_header}
    _close(read(path, units=stated), rec)


def test_a_recording_is_the_same_with_other_units_signs_and_orders(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    sections = (
        {},
        {"units": {"Q": "kN"}},
        {"sign": {"Q": [1, -1, 1, 1, 1, 1]}, "order": {"Q": [2, 1, 3, 4, 5, 6]}},
        {"columns": {"Q1": "Q2", "Q2": "Q1"}},
    )
    found = [read(path, **section) for section in sections]
    assert len({one.fingerprint for one in found}) == 1
    assert len({one.forces.tobytes() for one in found}) == len(sections)
    assert read(path, start=float(rec.t[0])).fingerprint == found[0].fingerprint
    half = float(rec.t[len(rec.t) // 2])
    parts = [read(path, end=half), read(path, start=half), found[0].between(0.0, half)]
    assert len({one.fingerprint for one in (found[0], *parts)}) == 4


def test_a_group_of_channels_and_one_of_them(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    rec.q[:, [0, 1, 3, 4, 5]] *= 1e3
    rec.q[:, 2] *= 1e2
    write_csv(path, rec)
    rec.q[:, [0, 1, 3, 4, 5]] /= 1e3
    rec.q[:, 2] /= 1e2
    _close(read(path, units={"q": "mm", "q3": "cm"}), rec)


def test_unit_in_header_and_run_file_may_agree(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    rec.frame.rename(columns={"Q2": "Q2 [newton]"}).to_csv(path, index=False)
    _close(read(path, units={"Q": "N"}), rec)


@given(
    constants=st.lists(st.floats(1, 500), min_size=6, max_size=6),
    unit=st.sampled_from(CURRENTS),
    header=st.booleans(),
)
@SHARED
def test_currents(constants, unit, header, tmp_path, rec, read):
    path = tmp_path / "m.csv"
    frame = rec.frame
    for j, constant in enumerate(constants, 1):
        frame[f"Q{j}"] /= constant * _factor(unit)
    if header:
        frame.columns = [f"{c} [{unit}]" if c[0] == "Q" else c for c in frame.columns]
    frame.to_csv(path, index=False)
    units = {} if header else {"Q": unit}
    found = read(path, units=units, force_constants=constants)
    _close(found, rec)
    assert found.warnings == ()


def test_force_constants_without_a_current_are_refused(tmp_path, rec, refused):
    """Whatever the file holds, one of the two is wrong: newtons times N/A are none."""
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    (problem,) = refused(path, force_constants=90)
    assert "no channel is a current" in problem.message
    assert "data.units: {Q: A}" in problem.allowed


@pytest.mark.parametrize("drive", [{"screw": Screw(lead=LEAD)}, {"gear": Gear(lead=LEAD)}])
@pytest.mark.parametrize(
    ("channel", "unit", "per_metre_or_newton", "section"),
    [
        ("q", "rev", 1 / LEAD, {}),
        ("q", "turns", 1 / LEAD, {}),
        ("q", "rad", 2 * np.pi / LEAD, {}),
        ("q", "deg", 360 / LEAD, {}),
        ("q", "°", 360 / LEAD, {}),
        ("q", "counts", 4096 / LEAD, {"counts_per_revolution": 4096}),
        ("q", "inc", np.arange(1, 7) * 1e5, {"counts_per_metre": [1e5 * j for j in range(1, 7)]}),
        ("Q", "N m", LEAD / (2 * np.pi), {}),
        ("Q", "mNm", 1e3 * LEAD / (2 * np.pi), {}),
        ("Q", "A", 1 / 90, {"force_constants": 90}),
    ],
)
def test_units_of_the_motor(
    channel, unit, per_metre_or_newton, section, drive, tmp_path, rec, palida
):
    """A turn moves the strut by the lead, and the power of both is the same."""
    path, header = tmp_path / "m.csv", "gear" in drive
    frame = rec.frame
    names = [f"{channel}{j}" for j in range(1, 7)]
    frame[names] *= per_metre_or_newton
    if header:
        frame.columns = [f"{c} ({unit})" if c in names else c for c in frame.columns]
    frame.to_csv(path, index=False)
    units = {} if header else {channel: unit}
    machine = replace(palida, drive=Drive(**drive))
    _close(read_measurement(path, DataSection(units=units, **section), machine), rec)


@pytest.mark.parametrize(
    ("unit", "per_newton"),
    [("V", 1.2), ("mV", 1200), ("%", 1.2 / 0.24), ("duty", 1.2 / 24), ("A", 1)],
)
def test_voltages_of_motors(unit, per_newton, tmp_path, rec, palida):
    """At rest all of the voltage is over the resistance; the speed's share is not in the data."""
    path, constants = tmp_path / "m.csv", 2 * np.pi / LEAD * np.linspace(0.04, 0.06, 6)
    motor = Motor(constant=tuple(np.linspace(0.04, 0.06, 6)), resistance=(1.2,) * 6, supply=24)
    machine = replace(palida, drive=Drive(screw=Screw(lead=LEAD), motor=motor))
    frame = rec.frame
    frame[[f"Q{j}" for j in range(1, 7)]] *= per_newton / constants
    frame.to_csv(path, index=False)
    found = read_measurement(path, DataSection(units={"Q": unit}), machine)
    _close(found, rec)
    if unit == "A":
        assert found.back_emf is None
    else:
        assert found.back_emf == pytest.approx(constants**2 / 1.2, rel=1e-12)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"units": {"Q": "V"}}, "states no motor of the drives"),
        ({"units": {"Q1": "duty"}}, "states no supply voltage of the motors"),
        ({"units": {"Q": "V", "Q2": "N"}}, "some forces are voltages or duty cycles, others not"),
        ({"units": {"Q": "V"}, "columns": {"U": "battery"}}, "no channel is a duty cycle"),
    ],
)
def test_voltages_without_their_motors_are_refused(section, message, tmp_path, rec, palida):
    path, motor = tmp_path / "m.csv", Motor(force_constant=(90.0,) * 6, resistance=(1.2,) * 6)
    rec.frame.assign(battery=24.0).to_csv(path, index=False)
    machine = palida if "motor of" in message else replace(palida, drive=Drive(motor=motor))
    with pytest.raises(InputError) as caught:
        read_measurement(path, DataSection.model_validate(section), machine)
    assert all(message in problem.message for problem in caught.value.problems)


@pytest.mark.parametrize("key", ["force_constants", "counts_per_metre", "counts_per_revolution"])
def test_scales_that_no_channel_needs_are_refused(key, tmp_path, rec, refused):
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    (problem,) = refused(path, **{key: 90})
    assert f"data.{key} are given, but no channel is" in problem.message


def test_a_run_that_needs_a_lead_names_the_robot_file(tmp_path):
    file = tmp_path / "run.yaml"
    file.write_text("name: a\nrobot: palida\ndata:\n  units: {q: rev, Q: N}\n")
    with pytest.raises(InputError) as caught:
        load_run(file)
    (problem,) = caught.value.problems
    assert (problem.file, problem.line, problem.key) == (file, 4, "data.units.q")
    assert str(_FILE) in problem.message
    assert "drive: {screw: {lead: 5 mm}}" in problem.allowed


def test_a_unit_that_is_not_known_is_the_only_defect(tmp_path, rec, refused):
    """What its channel holds is not known then: nothing is said of missing currents."""
    path = tmp_path / "m.csv"
    rec.frame.rename(columns={f"Q{j}": f"Q{j} [PWM]" for j in range(1, 7)}).to_csv(
        path, index=False
    )
    assert all("is not known" in problem.message for problem in refused(path, force_constants=90))


@pytest.mark.parametrize(
    ("header", "units", "message"),
    [
        ("q3 [mm]", {"q": "m"}, "the file says that q3 is in 'mm', data.units says 'm'"),
        ("q3 [N]", {}, "the file's unit 'N' is that of a force"),
        ("q3 [rad/s]", {}, "the file's unit 'rad/s' is that of an angular speed"),
        ("q3 [rad]", {}, f"q3 is an angle, but {_FILE} states no lead of the drives"),
        ("Q2 [mNm]", {}, f"Q2 is a torque, but {_FILE} states no lead of the drives"),
        (
            "q3 [counts]",
            {},
            "q3 is a count, but neither counts_per_metre nor counts_per_revolution are given",
        ),
        ("Q2 [mm]", {}, "the file's unit 'mm' is that of a length"),
        ("Q2 [A]", {}, "Q2 is a current, but no force constants are given"),
        ("q3 [Inkremente]", {}, "the file's unit 'Inkremente' is not known"),
        ("t [Hz]", {}, "the file's unit 'Hz' is that of a frequency"),
    ],
)
def test_units_that_contradict_are_refused(header, units, message, tmp_path, rec, refused):
    path = tmp_path / "m.csv"
    channel = header.split()[0]
    rec.frame.rename(columns={channel: header}).to_csv(path, index=False)
    (problem,) = refused(path, units=units)
    assert (problem.message, problem.line, problem.key) == (message, 1, header)
    assert problem.allowed


def test_an_unknown_unit_may_be_told_in_the_run_file(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    rec.frame.rename(columns={"q3": "q3 [Meter laut Blatt]"}).to_csv(path, index=False)
    found = read(path, units={"q3": "m"})
    _close(found, rec)
    assert "'Meter laut Blatt' is not known, 'm' used" in found.warnings[0]


def test_delays_are_kept_for_the_processing(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    found = read(path, delay={"forces": "2 ms", "lengths": "-1 ms"})
    assert (found.force_delay, found.length_delay) == (0.002, -0.001)
    assert np.array_equal(found.lengths, rec.q)
