import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

from expdesign.configuration import quantity
from expdesign.configuration.quantity import (
    ACCELERATION,
    ANGLE,
    FORCE,
    FREQUENCY,
    INERTIA,
    LENGTH,
    LENGTH_VARIANCE,
    NUMBER,
    SPEED,
    quantity_in,
    quantity_of_unit,
    quantity_text,
)


@pytest.mark.parametrize(
    ("dimension", "text", "value"),
    [
        (LENGTH, "150 mm", 0.15),
        (LENGTH, "150mm", 0.15),
        (LENGTH, " -22.95 in ", -0.58293),
        (LENGTH, "2 um", 2e-6),
        (LENGTH, "2 µm", 2e-6),  # micro sign
        (LENGTH, "2 μm", 2e-6),  # Greek mu
        (LENGTH, "0.25", 0.25),
        (LENGTH, "1e-3 km", 1.0),
        (LENGTH, 3, 3.0),
        (LENGTH, np.float64(0.5), 0.5),
        (LENGTH, np.int64(2), 2.0),
        (ANGLE, "180 deg", math.pi),
        (ANGLE, "30°", math.radians(30)),
        (ANGLE, "1 rev", 2 * math.pi),
        (SPEED, "0.5 mm/s", 0.0005),
        (SPEED, "6 m/min", 0.1),
        (ACCELERATION, "9.81 m/s^2", 9.81),
        (ACCELERATION, "9.81 m/s²", 9.81),
        (ACCELERATION, "9.81 m/s**2", 9.81),
        (ACCELERATION, "9.81 m/s/s", 9.81),
        (ACCELERATION, "9.81 m s^-2", 9.81),
        (FREQUENCY, 0.2, 0.2),
        (FREQUENCY, "0.2 Hz", 0.2),
        (FREQUENCY, "1 kHz", 1000.0),
        (FREQUENCY, "2/s", None),
        (FREQUENCY, "2 s^-1", 2.0),
        (FORCE, "0.2 kN", 200.0),
        (FORCE, "1 kg m/s^2", 1.0),
        (quantity_in("N m"), "0.4 N·m", 0.4),
        (quantity_in("N s/m"), "20 N s/m", 20.0),
        (quantity_in("N s/m"), "20 N*s/m", 20.0),
        (INERTIA, "0.1 kg m2", 0.1),
        (LENGTH_VARIANCE, "0.01 mm^2", 1e-8),
        (NUMBER, "0.5", 0.5),
    ],
)
def test_texts_with_units(dimension, text, value):
    if value is None:
        with pytest.raises(PydanticCustomError):
            dimension.parse(text)
        return
    assert dimension.parse(text) == pytest.approx(value, rel=1e-15)


def test_decimal_fractions_lose_nothing():
    assert LENGTH.parse("0.1 mm") == 0.0001
    assert LENGTH.parse("14.1 mm") == 0.0141
    assert all(ANGLE.parse(f"{k} deg") == math.radians(k) for k in range(-360, 361))


@pytest.mark.parametrize(
    ("dimension", "value", "says"),
    [
        (LENGTH, "5 kg", "is a mass, not a length"),
        (LENGTH, "5 furlong", "unknown unit 'furlong'"),
        (LENGTH, "1 min", "is a duration"),
        (LENGTH, "0,5 m", "the decimal mark is a point"),
        (LENGTH, "5 m^2", "not a length"),
        (LENGTH, "m", "is not a length"),
        (LENGTH, "", "is not a length"),
        (LENGTH, "5 m; import os", "is not a length"),
        (LENGTH, "9**9**9**9", "is not a length"),
        (LENGTH, "1e999 m", "not a finite number"),
        (LENGTH, "1" * 10_000, "is not a length"),
        (LENGTH, True, "is not a length"),
        (LENGTH, np.True_, "is not a length"),
        (LENGTH, None, "nothing is not a length"),
        (LENGTH, [1], "a list of 1 is not a length"),
        (LENGTH, {"a": 1}, "a mapping is not a length"),
        (LENGTH, 1j, "is not a length"),
        (LENGTH, math.nan, "not a finite number"),
        (LENGTH, -math.inf, "not a finite number"),
        (LENGTH, "nan", "is not a length"),
        (LENGTH, 10**400, "not a finite number"),
        (FREQUENCY, "1 rad/s", "is an angular speed, not a frequency"),
        (FREQUENCY, "10 rpm", "is an angular speed, not a frequency"),
        (ANGLE, "1 m/m", "not an angle"),
        (NUMBER, "5 m", "is a length, not a number"),
    ],
)
def test_refused(dimension, value, says):
    with pytest.raises(PydanticCustomError) as caught:
        dimension.parse(value)
    assert says in caught.value.message()
    assert caught.value.context["allowed"]


def test_a_torque_in_place_of_a_force_is_told_what_makes_it_one():
    with pytest.raises(PydanticCustomError) as torque:
        FORCE.parse("1.27 N m")
    with pytest.raises(PydanticCustomError) as length:
        FORCE.parse("1.27 m")
    assert "2 pi / lead" in torque.value.context["allowed"]
    assert "lead" not in length.value.context["allowed"]


@given(st.one_of(st.text(), st.floats(), st.integers(), st.booleans(), st.none(), st.binary()))
def test_anything_gives_a_finite_number_or_is_refused(value):
    for dimension in (LENGTH, ANGLE, FREQUENCY, NUMBER):
        try:
            number = dimension.parse(value)
        except PydanticCustomError:
            continue
        assert isinstance(number, float)
        assert math.isfinite(number)


@given(
    st.from_regex(r"[0-9]{1,3}(\.[0-9]{1,3})? ?[a-zA-Z°µ²³*/^ .0-9-]{0,20}", fullmatch=True),
)
def test_what_looks_like_a_quantity_is_one_or_is_refused(text):
    try:
        number = LENGTH.parse(text)
    except PydanticCustomError:
        return
    assert math.isfinite(number)


@given(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e15, max_value=1e15))
def test_units_scale_exactly(value):
    # The decimal fraction that was written, not the binary one, is scaled.
    text = f"{value:.12f}"
    assert LENGTH.parse(f"{text} mm") == float(Fraction(text) / 1000)
    assert FORCE.parse(f"{text} kN") == float(Fraction(text) * 1000)


def test_plain_numbers_are_taken_in_the_unit_of_the_dimension():
    for dimension in quantity._QUANTITIES:
        assert dimension.parse(1.5) == 1.5
        assert dimension.parse(f"1.5 {dimension.unit}") == 1.5
        assert dimension.parse(dimension.example) > 0


def test_dimension_of_a_unit():
    assert quantity_in("m") is LENGTH
    assert quantity_in("1") is NUMBER
    assert quantity_in("m/s^2") is ACCELERATION
    # A unit that no dimension is written in still works, for limits that are added later.
    jerk = quantity_in("m/s^3")
    assert jerk.parse("1 mm/s^3") == 0.001
    with pytest.raises(ValueError, match="furlong"):
        quantity_in("furlong")
    assert quantity_of_unit("mm") is LENGTH
    assert quantity_of_unit("parsec") is None
    assert quantity_of_unit("m" * 1000) is None


@pytest.mark.parametrize(
    ("dimension", "text", "listed"),
    [
        (quantity_in("N"), "3 kgf", ": N, mN, kN, MN, lbf"),
        (quantity_in("m"), "3 mil", ": m, km, dm, cm, mm, µm, nm, in, ft"),
        (quantity_in("m/s"), "3 mph", "a product of these units: m, km"),
    ],
)
def test_an_unknown_unit_is_answered_with_the_known_ones(dimension, text, listed):
    with pytest.raises(PydanticCustomError, match="unknown unit") as caught:
        dimension.parse(text)
    assert listed in caught.value.context["allowed"]
    assert dimension.example in caught.value.context["allowed"]


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.2617993877991494, "rad", "15 deg"),
        (3264.43, "1", "3264.43"),
        (0.33, "m", "0.33 m"),
        (-15.25, "m/s^2", "-15.25 m/s^2"),
    ],
)
def test_quantities_read_as_users_write_them(value, unit, text):
    assert quantity_text(value, unit) == text
    assert quantity_in(unit).parse(text) == pytest.approx(value, rel=1e-6)
