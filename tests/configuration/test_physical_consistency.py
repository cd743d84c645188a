"""Rounded parameters: what rounding explains is told from what it does not."""

from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import expdesign
from expdesign.configuration.document import Document, read_yaml
from expdesign.configuration.plausibility import rounding_errors
from expdesign.configuration.robot import load_robot_description

PALIDA = (Path(expdesign.__file__).parent / "library/robots/palida.yaml").read_text("utf-8")


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Return a way to PaLiDA with moments of the struts as they are written."""
    path = tmp_path_factory.mktemp("robots") / "robot.yaml"

    def load(p2, p3):
        text = PALIDA.replace("p2: 0.947", f"p2: {p2}").replace("p3: 0.943", f"p3: {p3}")
        path.write_text(text, encoding="utf-8")
        return load_robot_description(path)

    return load


def _inconsistent(robot):
    return [text for text in robot.warnings if "physically inconsistent" in text]


@given(
    st.decimals(-1000, 1000, allow_nan=False, places=6),
    st.integers(0, 6),
    st.sampled_from([("", 1.0), (" kg m^2", 1.0), (" g m^2", 1e-3), ("e-3", 1e-3), ("e2", 100.0)]),
)
def test_half_a_unit_of_the_last_digit(number, places, unit):
    """A number that rounds to what is written is never farther off."""
    ending, size = unit
    written = number.quantize(Decimal(1).scaleb(-places), ROUND_HALF_EVEN)
    text = f"{written:f}{ending}"
    value = float(written) * size
    key = ("parameters", "p2")
    document = Document({}, texts={key: text})
    half = rounding_errors(document, ("parameters",), {"p2": float(f"{written:f}") * size})
    if not places or not written:  # written as a whole number, or as nothing: meant so
        assert not half
        return
    if not half:  # the product is another number in the last bit
        assert size not in (1.0,)
        return
    assert half["p2"] == pytest.approx(0.5 * 10.0**-places * size, rel=1e-12)
    assert abs(float(number) * size - value) <= half["p2"] * (1 + 1e-6)


def test_digits_are_those_of_the_file(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_text(
        "base: &base {p1: 0.50, p6: 7}\nparameters:\n  <<: *base\n  p2: 0.940\n  p3: '94.0 g m^2'\n"
        "  p1: 2.5e-3\n",
        encoding="utf-8",
    )
    values = {"p1": 2.5e-3, "p2": 0.94, "p3": 0.094, "p4": 0.1, "p6": 7.0}
    found = rounding_errors(read_yaml(path), ("parameters",), values)
    assert found == pytest.approx({"p1": 5e-5, "p2": 5e-4, "p3": 5e-5})
    # A value that is not what stands there, as of bodies, has no digits.
    assert set(rounding_errors(read_yaml(path), ("parameters",), values | {"p2": 0.9})) == {
        "p1",
        "p3",
    }


@settings(max_examples=12, deadline=None)
@given(st.floats(0.9, 1.1), st.floats(0, 1e-4), st.integers(2, 4), st.integers(2, 4))
def test_rounding_alone_makes_no_machine_inconsistent(robot, p3, thickness, digits2, digits3):
    """Of struts that bodies have, and with what rounding does not explain on top of it."""
    p2 = Decimal(p3 - thickness).quantize(Decimal(1).scaleb(-digits2))
    rounded = Decimal(p3).quantize(Decimal(1).scaleb(-digits3))
    found = robot(f"{p2:f}", f"{rounded:f}")
    assert not _inconsistent(found)
    assert bool(found.rounded) == (p2 > rounded)
    off = Decimal(p3) + Decimal("1.1") * (Decimal(1).scaleb(-digits2) + Decimal(1).scaleb(-digits3))
    off = off.quantize(Decimal(1).scaleb(-digits2))
    if float(off - rounded) > 0.51 * (10.0**-digits2 + 10.0**-digits3):
        found = robot(f"{off:f}", f"{rounded:f}")
        assert _inconsistent(found)
        assert not found.rounded


def test_how_far_a_table_is_off_is_told_in_its_last_digit(robot):
    (told,) = _inconsistent(robot("0.947", "0.943"))
    assert "by 0.004 kg m^2" in told
    assert told.count("4 times the rounding") == 2
    (told,) = _inconsistent(robot("0.9470000", "0.943"))
    assert "4 times the rounding" in told
    assert told.count("times the rounding") == 1


def test_numbers_without_digits_count_as_they_are(robot):
    description = robot("0.944", "0.943").description.model_dump(mode="json", by_alias=True)
    machine = expdesign.configuration.load_run({"name": "n", "robot": description}).robot
    assert _inconsistent(machine)
    assert not machine.rounded
    assert np.isclose(machine.parameters["p2"], 0.944)
