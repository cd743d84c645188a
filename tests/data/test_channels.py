"""Order, signs and zeros of the channels, as controllers count them."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimation.data.reading import read_measurement
from expdesign.configuration import DataSection, load_run
from expdesign.robot import Robot
from tests.data.recordings import CHANNELS, write_csv

SHARED = settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
SIGNS = st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6)
ORDER = st.permutations(range(1, 7))


def _close(found, rec):
    assert np.allclose(found.lengths, rec.q, rtol=1e-12, atol=1e-12)
    assert np.allclose(found.forces, rec.Q, rtol=1e-12, atol=1e-9)
    assert np.allclose(found.time, rec.t, rtol=0, atol=1e-12)


@given(
    order=st.fixed_dictionaries({"q": ORDER, "Q": ORDER}),
    sign=st.fixed_dictionaries({"q": SIGNS, "Q": SIGNS}),
    offset=st.fixed_dictionaries(
        {
            "q": st.lists(st.floats(-0.2, 0.2), min_size=6, max_size=6),
            "Q": st.lists(st.floats(-50, 50), min_size=6, max_size=6),
        }
    ),
    constants=st.lists(st.floats(1, 500), min_size=6, max_size=6),
)
@SHARED
def test_axes_that_count_otherwise(order, sign, offset, constants, tmp_path, rec, read):
    """Position = sign · (length − offset) of the strut on each axis, as a controller table has it.

    Currents in a column of its own unit: constants are those of the actuators.
    """
    path = tmp_path / "m.csv"
    frame = rec.frame
    for group, values in (("q", rec.q), ("Q", rec.Q)):
        for axis, strut in enumerate(np.array(order[group]) - 1, 1):
            axis_values = sign[group][strut] * (values[:, strut] - offset[group][strut])
            frame[f"{group}{axis}"] = axis_values / (constants[strut] if group == "Q" else 1e-3)
    frame.to_csv(path, index=False)
    units = {"q": "mm", "Q": "A"}
    _close(
        read(path, units=units, force_constants=constants, order=order, sign=sign, offset=offset),
        rec,
    )


def test_what_an_export_says_may_stand_in_data(tmp_path, rec, read, palida):
    """A plain value is that of lengths and forces; zeros are those of the lengths."""
    path = tmp_path / "m.csv"
    home = palida.struts_at(palida.home).lengths
    order, sign = [2, 1, 3, 4, 6, 5], [1, 1, -1, 1, 1, -1]
    frame = rec.frame
    for axis, strut in enumerate(np.array(order) - 1, 1):
        frame[f"q{axis}"] = sign[strut] * (rec.q[:, strut] - home[strut])
        frame[f"Q{axis}"] = sign[strut] * rec.Q[:, strut]
    frame.to_csv(path, index=False)
    _close(read(path, order=order, sign=sign, offset="home"), rec)


def test_home_on_a_thread_is_that_of_the_actuators(tmp_path, rec, palida):
    """As exports have it: on a thread a length at home is not the distance of the joints."""
    description = palida.description.model_dump(mode="json", by_alias=True)
    screws = {"drive": {"screw": {"lead": 5e-3}}, "platform_cardan_axes": [[1, 0, 0]] * 6}
    robot = load_run({"name": "n", "robot": {**description, **screws}}).robot
    machine = Robot(robot)
    home = machine.inverse_kinematics(machine.home)
    assert np.max(np.abs(home - robot.struts_at(robot.home).lengths)) > 1e-4
    path, frame = tmp_path / "m.csv", rec.frame
    for strut in range(6):
        frame[f"q{strut + 1}"] = rec.q[:, strut] - home[strut]
    frame.to_csv(path, index=False)
    _close(read_measurement(path, DataSection(offset="home"), robot), rec)


def test_defects_are_told_by_the_file_s_own_column(tmp_path, rec, refused):
    path = tmp_path / "m.csv"
    frame = rec.frame.astype(object)
    frame.loc[7, "Q1"] = "lost"
    frame.rename(columns={"Q1": "Motor 1"}).to_csv(path, index=False)
    (problem,) = refused(path, columns={"Q1": "Motor 1"}, order=[2, 1, 3, 4, 5, 6])
    assert (problem.key, problem.line) == ("Motor 1", 9)
    assert "'lost'" in problem.message


_ELSEWHERE = 1e-3 * np.array([70, -56, 11, -24, 60, -68])


@pytest.mark.parametrize(
    ("change", "section", "hint"),
    [
        (lambda q, _: -q, {}, "data.sign: {q: -1}"),
        (lambda q, home: q - home, {}, "data.offset: home"),
        # In the middle of a motion struts are elsewhere: in cm or feet one of them would fit alone.
        (lambda q, home: q - home + _ELSEWHERE, {}, "data.offset: home"),
        (lambda q, home: 1e3 * (q - home), {"offset": "home"}, "data.units: {q: mm}"),
    ],
)
def test_lengths_that_are_counted_otherwise(change, section, hint, tmp_path, rec, refused, palida):
    path = tmp_path / "m.csv"
    rec.q = change(rec.q, palida.struts_at(palida.home).lengths)
    write_csv(path, rec)
    assert all(hint in problem.message for problem in refused(path, **section))


def test_nothing_said_is_the_file_as_it_is(tmp_path, rec, read):
    path = tmp_path / "m.csv"
    write_csv(path, rec)
    one, other = read(path), read(path, order=[*range(1, 7)], sign=1, offset=0)
    assert np.array_equal(one.lengths, other.lengths)
    assert np.array_equal(one.forces, rec.Q)
    assert set(CHANNELS) == set(one.channels)
