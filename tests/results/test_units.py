import numpy as np
import pytest

from results.notation import DisplayUnit, handy_unit, symbol


@pytest.mark.parametrize(
    ("si", "values", "expected"),
    [
        ("m", [0.45, -0.95], "mm"),
        ("m", [7.0], "m"),
        ("m", [2e-5], "µm"),
        ("m/s", [-2.0], "m/s"),
        ("m/s", [5e-4], "mm/s"),
        ("m/s^2", [30.0], "m/s²"),
        ("m/s^2", [0.05], "mm/s²"),
        ("N", [230.0], "N"),
        ("N", [20e3], "kN"),
        ("rad", [0.3], "°"),
        ("1", [10.0], ""),
        ("kg", [10.0], "kg"),
        ("N", [0.0], "N"),
        ("N", [], "N"),
        ("N", [230.0, np.inf, np.nan], "N"),
    ],
)
def test_unit_fits_the_largest_magnitude(si, values, expected):
    assert handy_unit(si, values).symbol == expected


@pytest.mark.parametrize(
    ("unit", "value", "text"),
    [
        (DisplayUnit("mm", 1e3), -0.654, "−654 mm"),
        (DisplayUnit("°", 180 / np.pi), np.pi / 6, "30°"),
        (DisplayUnit("", 1.0), 9.77866, "9.779"),
    ],
)
def test_quantity_as_text(unit, value, text):
    assert unit.quantity(value) == text


def test_label_tells_the_unit():
    assert DisplayUnit("mm", 1e3).label("Length") == "Length (mm)"
    assert DisplayUnit("", 1.0).label("Condition") == "Condition"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("p1", "$p_{1}$"),
        ("p10", "$p_{10}$"),
        ("r_alpha", r"$r_{\alpha}$"),
        ("r_beta", r"$r_{\beta}$"),
        ("v6", "$v_{6}$"),
        ("sx", "$s_{x}$"),
        ("Ixy", "$I_{xy}$"),
        ("x", "$x$"),
        ("phi", r"$\varphi$"),
        ("strut 3", "strut 3"),
        ("", ""),
    ],
)
def test_symbols(name, expected):
    assert symbol(name) == expected
