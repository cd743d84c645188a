"""`drive`: what moves the struts."""

import math

import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.actuator_units import ActuatorUnits
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.terms import DEFAULT

SCREW = {"screw": {"lead": "5 mm", "inertia": 6.3e-5}}
MASS = 6.3e-5 * (2 * math.pi / 5e-3) ** 2


@pytest.fixture(scope="module")
def palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _robot(palida, drive, **changes):
    return load_run({"name": "n", "robot": {**palida, "drive": drive, **changes}}).robot


def test_a_direct_drive_adds_nothing(palida):
    assert palida["drive"] == "direct"
    robot = _robot(palida, "direct")
    assert [term.name for term in robot.terms] == list(DEFAULT)
    assert "m_drive" not in robot.parameters


@pytest.mark.parametrize("kind", ["screw", "gear"])
def test_lead_and_inertia_make_a_mass(palida, kind):
    robot = _robot(palida, {kind: SCREW["screw"]})
    assert robot.parameters["m_drive"] == pytest.approx(MASS, rel=1e-12)
    assert pytest.approx(100, abs=1) == MASS
    names = list(robot.parameters)
    assert names[names.index("m_drive") - 1 : names.index("m_drive") + 2] == [
        "p10",
        "m_drive",
        "r_alpha",
    ]
    assert not [text for text in robot.warnings if "inertia" in text and "drive" in text]


@pytest.mark.parametrize(
    ("pitch", "metres"), [("1 rev", 0.002), ("1.5 screw rev", 0.009), ("7 mm", 0.007)]
)
def test_a_screw_behind_a_gear_counts_turns_of_the_motor_and_of_the_screw(palida, pitch, metres):
    drive = {"screw": {"lead": "6 mm", "ratio": 3, "inertia": 6.3e-5}}
    robot = _robot(palida, drive, terms=[*DEFAULT, {"cogging": {"pitch": pitch}}])
    cogging = next(term for term in robot.description.terms if term.name == "cogging")
    assert cogging.constants["pitch"].value == pytest.approx(metres)
    mass = 6.3e-5 * (2 * math.pi / 2e-3) ** 2
    assert robot.parameters["m_drive"] == pytest.approx(mass, rel=1e-12)
    assert robot.thread_lead == pytest.approx(6e-3)
    assert ActuatorUnits(robot).si_values("rev") == pytest.approx((2e-3,) * 6)


@pytest.mark.parametrize(
    ("drive", "pitch"), [("direct", "1 rev"), ({"gear": {"lead": "0.2 m"}}, "1 screw rev")]
)
def test_turns_need_the_lead_of_the_drive(palida, drive, pitch):
    with pytest.raises(InputError, match="needs the lead of the drive"):
        _robot(palida, drive, terms=[*DEFAULT, {"cogging": {"pitch": pitch}}])


def test_a_value_that_is_given_counts_before_the_drives(palida):
    parameters = {**palida["parameters"], "m_drive": "80 kg"}
    assert _robot(palida, SCREW, parameters=parameters).parameters["m_drive"] == 80


def test_a_term_that_is_listed_keeps_its_place(palida):
    terms = [*DEFAULT, "drive_inertia"]
    robot = _robot(palida, SCREW, terms=terms)
    assert [term.name for term in robot.terms] == terms
    assert robot.parameters["m_drive"] == pytest.approx(MASS, rel=1e-12)


def test_an_inertia_that_is_not_known_is_told(palida):
    robot = _robot(palida, {"screw": {"lead": 0.005}})
    assert robot.parameters["m_drive"] == 0
    assert any("m_drive" in text for text in robot.warnings)


MOTOR = {"constant": "0.05 N m/A", "resistance": [1.2] * 6, "supply": "24 V"}


@pytest.mark.parametrize(
    "drive", ["direct", SCREW, {"gear": {"lead": "0.2 m"}}, {**SCREW, "motor": MOTOR}]
)
def test_what_is_resolved_is_read_again(palida, drive, tmp_path):
    run = load_run({"name": "n", "robot": {**palida, "drive": drive}})
    path = tmp_path / "run.yaml"
    path.write_text(resolved_yaml(run), encoding="utf-8")
    again = load_run(path)
    assert again.robot.description == run.robot.description
    assert again.robot.parameters == run.robot.parameters


def test_constants_of_a_motor_are_those_along_the_strut(palida):
    drive = _robot(palida, {**SCREW, "motor": MOTOR}).drive
    constant = 0.05 * 2 * math.pi / 5e-3
    assert drive.force_constants == pytest.approx((constant,) * 6, rel=1e-12)
    assert drive.back_emf == pytest.approx((constant**2 / 1.2,) * 6, rel=1e-12)
    direct = _robot(palida, {"motor": {"force_constant": constant, "resistance": "1200 mohm"}})
    assert direct.drive.back_emf == pytest.approx(drive.back_emf, rel=1e-12)
    assert direct.parameters == _robot(palida, "direct").parameters


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"motor": MOTOR}, "a torque constant needs the lead of a screw or gear"),
        ({**SCREW, "motor": {"resistance": 1}}, "a motor needs one of two constants"),
        ({**SCREW, "gear": {"lead": 1}, "motor": MOTOR}, "there are 2 kinds of drive"),
        ({**SCREW, "motor": {**MOTOR, "supply": "24 A"}}, "is a current, not a voltage"),
    ],
)
def test_motors_that_cannot_be_are_refused(palida, drive, message):
    with pytest.raises(InputError) as caught:
        _robot(palida, drive)
    assert message in str(caught.value)
