"""Logs as others write them: no names, no time, PWM and cm, two clocks; the numbers are made up."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.data.guess import guess_files
from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, InputError
from expdesign.configuration.parameters import Drive, Motor

JOINTS = ",".join(f"Joint_{j}" for j in range(1, 7))


def _lines(values, delimiter=",", digits="%.12g"):
    return [delimiter.join(digits % one for one in row) for row in values]


def test_positions_and_torques_without_time(tmp_path, rec, palida):
    """An industrial robot: two files of columns with the same names, at 5 kHz."""
    files = [tmp_path / "pos_read_data.csv", tmp_path / "torque_data.csv"]
    for file, values in zip(files, (rec.q, rec.Q), strict=True):
        file.write_text("\n".join([JOINTS, *_lines(values, digits="%.17g")]))
    guess = guess_files(*files, palida)
    assert any("sampling: …" in question for question in guess.questions)
    assert guess.section["columns"] == {
        f"{letter}{j}": f"Joint_{j}" for letter in "qQ" for j in range(1, 7)
    }
    places = {"lengths": str(files[0]), "forces": str(files[1])}
    stated = {"files": places, "sampling": "5 kHz", **guess.section}
    found = read_measurement(files[0], DataSection.model_validate(stated), palida)
    assert found.step == pytest.approx(2e-4, rel=1e-9)
    np.testing.assert_allclose(found.lengths, rec.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.forces, rec.Q, rtol=0, atol=1e-9)


def test_pwm_and_centimetres_of_a_microcontroller(tmp_path, rec, palida):
    """A model hexapod: no names, milliseconds, cm, PWM of −255 … 255, the battery in the last."""
    file, drive = (
        tmp_path / "serial.txt",
        Drive(motor=Motor(force_constant=(40.0,) * 6, resistance=(2.5,) * 6)),
    )
    battery = 12 - 0.5 * np.sin(np.arange(len(rec.t)) / 30)
    pwm = 255 * rec.Q * 2.5 / 40 / battery[:, None]
    table = np.column_stack([1e3 * rec.t, 100 * rec.q, -pwm, battery])
    file.write_text("\n".join(["boot ok", "imu: none", *_lines(table, ";")]))
    guess = guess_files(file)
    assert guess.section["delimiter"] == ";"
    header = guess.section["header"]
    assert (header["before"], len(header["names"])) == (2, 14)
    assert any(question.startswith("header: {names") for question in guess.questions)
    names = ["ms", *(f"cm{j}" for j in range(1, 7)), *(f"pwm{j}" for j in range(1, 7)), "Vbat"]
    section = {
        "delimiter": ";",
        "header": {"before": 2, "names": names},
        "columns": {"t": "ms", "U": "Vbat"}
        | {
            f"{letter}{j}": f"{name}{j}"
            for letter, name in (("q", "cm"), ("Q", "pwm"))
            for j in range(1, 7)
        },
        "units": {"t": "ms", "q": "cm", "Q": "duty", "U": "V"},
        "sign": {"Q": -1},
        "scale": {"Q": 1 / 255},
    }
    checked = DataSection.model_validate(section)
    found = read_measurement(file, checked, replace(palida, drive=drive))
    np.testing.assert_allclose(found.lengths, rec.q, rtol=1e-9)
    np.testing.assert_allclose(found.forces, rec.Q, rtol=1e-9)
    assert found.back_emf == pytest.approx((640,) * 6)
    file.write_text(file.read_text().replace(";", ",", 1))
    with pytest.raises(InputError, match="3: the line has 13 columns"):
        read_measurement(file, checked, replace(palida, drive=drive))


def test_tension_and_position_of_two_computers(tmp_path, rec, palida):
    """A cable robot: two clocks since 1970 of other units, the forces late and at half the rate."""
    files, begin = [tmp_path / "winch.csv", tmp_path / "loadcell.csv"], 1764238500.25
    times = np.arange(200) / 100
    late = times[::2] + 0.031
    lengths = rec.q[0] + 0.01 * np.sin(4 * times[:, None] + np.arange(6))
    forces = 80 + 30 * np.sin(4 * late[:, None] + np.arange(6))
    tables = (
        ("time_s", "pos", begin + times, lengths),
        ("stamp_ms", "tension", 1e3 * (begin + late), forces),
    )
    for file, (time, name, stamps, values) in zip(files, tables, strict=True):
        header = ",".join([time, *(f"{name}{j}" for j in range(1, 7))])
        rows = [f"{t:.6f},{row}" for t, row in zip(stamps, _lines(values), strict=True)]
        file.write_text("\n".join([header, *rows]))
    guess = guess_files(*files, palida)
    assert guess.section["columns"]["t"] == "time_s"
    assert guess.section["columns"]["tQ"] == "stamp_ms"
    assert guess.section["units"] == {"t": "s", "tQ": "ms"}
    places = {"lengths": str(files[0]), "forces": str(files[1])}
    section = DataSection.model_validate({"files": places, **guess.section})
    found = read_measurement(files[0], section, palida)
    assert "forces begin 31 ms later; combined at the times of the forces" in found.warnings[0]
    assert found.step == pytest.approx(0.02, rel=1e-4)
    np.testing.assert_allclose(found.forces, forces[: len(found)], atol=1e-6)
    expected = rec.q[0] + 0.01 * np.sin(4 * late[: len(found), None] + np.arange(6))
    np.testing.assert_allclose(found.lengths[2:-2], expected[2:-2], atol=2e-7)
