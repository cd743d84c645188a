import pytest

from expdesign.configuration.values.quantity import dimension_of, quantity_text


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
    assert dimension_of(unit).parse(text) == pytest.approx(value, rel=1e-6)
