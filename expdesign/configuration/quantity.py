"""Physical quantities: a plain number in SI units, or a string with a unit ("150 mm").

The registry knows the units of this field and no others, without prefixes that combine freely:
"min" is a minute and never a milli-inch, an angle has a dimension of its own ("rad/s" is no
frequency), and a text from a file can start no arithmetic but products of units.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cache, lru_cache
from numbers import Real
from typing import Annotated

import pint
from pydantic import BeforeValidator

from expdesign.configuration.errors import refusal, require, shown

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
_FACTOR = r"(?:[A-Za-zµμ]{1,12}|°)(?:(?:\^|\*\*)?-?[1-9])?"
_QUANTITY = re.compile(
    rf"\s*({_NUMBER})\s*((?:{_FACTOR})(?:\s*[*/]\s*{_FACTOR}|\s+{_FACTOR})*)?\s*"
)
_POWER = re.compile(r"(?<=[A-Za-zµμ°])(?:\^|\*\*)?(-?[1-9])")
_SHARE = re.compile(rf"\s*({_NUMBER})\s*(%|ppm)?\s*")
_SHARES = {None: Fraction(1), "%": Fraction(1, 100), "ppm": Fraction(1, 1_000_000)}
_LONGEST = 120
_SUPERSCRIPTS = str.maketrans({"²": "2", "³": "3", "·": "*", "⋅": "*", "−": "-", "μ": "µ"})
# The exact decimal expansion, so that "30 deg" is math.radians(30) to the last bit.
_DEGREE = f"{Decimal(math.pi / 180):f}"
_DEFINITIONS = (
    "meter = [length] = m",
    "kilometer = 1000 * meter = km",
    "decimeter = 0.1 * meter = dm",
    "centimeter = 0.01 * meter = cm",
    "millimeter = 0.001 * meter = mm",
    "micrometer = 0.000001 * meter = µm = um",
    "nanometer = 0.000000001 * meter = nm",
    "inch = 0.0254 * meter = in",
    "foot = 0.3048 * meter = ft",
    "second = [time] = s",
    "millisecond = 0.001 * second = ms",
    "microsecond = 0.000001 * second = µs = us",
    "minute = 60 * second = min",
    "hour = 3600 * second = h",
    "hertz = 1 / second = Hz",
    "millihertz = 0.001 * hertz = mHz",
    "kilohertz = 1000 * hertz = kHz",
    "megahertz = 1000000 * hertz = MHz",
    "radian = [angle] = rad",
    "milliradian = 0.001 * radian = mrad",
    "microradian = 0.000001 * radian = µrad = urad",
    f"degree = {_DEGREE} * radian = deg = ° = degrees",
    f"arcminute = {Decimal(math.pi / 10_800):f} * radian = arcmin",
    f"arcsecond = {Decimal(math.pi / 648_000):f} * radian = arcsec",
    f"turn = {Decimal(2 * math.pi):f} * radian = rev",
    "rpm = turn / minute",
    "kilogram = [mass] = kg",
    "gram = 0.001 * kilogram = g",
    "tonne = 1000 * kilogram = t",
    "pound = 0.45359237 * kilogram = lb",
    "newton = kilogram * meter / second ** 2 = N",
    "millinewton = 0.001 * newton = mN",
    "kilonewton = 1000 * newton = kN",
    "meganewton = 1000000 * newton = MN",
    "poundforce = 4.4482216152605 * newton = lbf",
    "ampere = [current] = A",
    "milliampere = 0.001 * ampere = mA",
)
_UNSIGNED = 2
"""Parts of a definition without a symbol: name and value."""


@dataclass(frozen=True)
class Dimension:
    """A kind of physical quantity.

    `name` has its article, for messages ("a length"); `unit` is that of a plain number; `example`
    is a text that is accepted; `hints` are what to say of quantities that are given instead, by
    their unit.
    """

    name: str
    unit: str
    example: str
    hints: tuple[tuple[str, str], ...] = ()

    @property
    def allowed(self) -> str:
        """What a user may write."""
        if self.unit == "1":
            return "a plain number"
        return f'{self.name}: a plain number in {self.unit}, or a text such as "{self.example}"'

    @property
    def units(self) -> tuple[str, ...]:
        """Units of this kind that have a name of their own: none for a speed."""
        dimensions = _dimensionality(self.unit)
        return tuple(s for s in unit_symbols() if _dimensionality(s) == dimensions)

    def parse(self, value: object) -> float:
        """Convert what stands in the file to a finite number in `unit`.

        Takes a real number, or a text of a number and optionally a unit.

        Raises
        ------
        pydantic_core.PydanticCustomError
            If it is no such quantity: booleans, NaN, infinities, unknown units and units of
            another dimension are refused.
        """
        if isinstance(value, bool) or not isinstance(value, Real | str):
            raise refusal(f"{shown(value)} is not {self.name}", self.allowed)
        try:
            number = self._from_text(value) if isinstance(value, str) else float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise refusal(f"{shown(value)} is not a finite number", self.allowed)
        return number

    def _from_text(self, text: str) -> float:
        match = _quantity(text)
        if match is None:
            hint = " (the decimal mark is a point)" if re.match(r"\s*[+-]?\d+,\d", text) else ""
            raise refusal(f"{shown(text)} is not {self.name}{hint}", self.allowed)
        number, unit = match.groups()
        if unit is None:
            return float(number)
        factor = _factor(unit)
        if factor is None:
            units = self.units or unit_symbols()
            known = "the units are" if self.units else "a product of these units"
            raise refusal(
                f"{shown(text)} has an unknown unit '{unit}'",
                f"{self.allowed}; {known}: {', '.join(units)}",
            )
        scale, dimensions = factor
        if dimensions != _dimensionality(self.unit):
            kind = _of_dimensions(dimensions)
            wrong = f"is {kind.name}" if kind else "has the wrong unit"
            meant = dict(self.hints).get(kind.unit) if kind else None
            allowed = f"{self.allowed}; {meant}" if meant else self.allowed
            raise refusal(f"{shown(text)} {wrong}, not {self.name}", allowed)
        return float(Fraction(number) * scale)


NUMBER = Dimension("a number", "1", "0.5")
LENGTH = Dimension("a length", "m", "150 mm")
ANGLE = Dimension("an angle", "rad", "30 deg")
SPEED = Dimension("a speed", "m/s", "500 mm/s")
ACCELERATION = Dimension("an acceleration", "m/s^2", "30 m/s^2")
JERK = Dimension("a jerk", "m/s^3", "1500 m/s^3")
ANGULAR_SPEED = Dimension("an angular speed", "rad/s", "30 deg/s")
ANGULAR_ACCELERATION = Dimension("an angular acceleration", "rad/s^2", "30 deg/s^2")
FORCE = Dimension(
    "a force",
    "N",
    "0.2 kN",
    (("N m", "a motor's torque, behind a screw or gear, is that times 2 pi / lead"),),
)
TORQUE = Dimension("a torque", "N m", "0.4 N m")
FREQUENCY = Dimension("a frequency", "Hz", "0.2 Hz")
DURATION = Dimension("a duration", "s", "1 ms")
MASS = Dimension("a mass", "kg", "1.9 kg")
FIRST_MOMENT = Dimension("a first moment", "kg m", "1.7 kg m")
INERTIA = Dimension("a moment of inertia", "kg m^2", "0.2 kg m^2")
DAMPING = Dimension("a viscous friction", "N s/m", "20 N s/m")
FORCE_VARIANCE = Dimension("a force variance", "N^2", "400 N^2")
LENGTH_VARIANCE = Dimension("a length variance", "m^2", "0.01 mm^2")
FORCE_CONSTANT = Dimension("a force constant", "N/A", "90 N/A")
CURRENT = Dimension("a current", "A", "2 A")
COMPLIANCE = Dimension("a compliance", "m/N", "0.05 um/N")


@dataclass(frozen=True)
class ShareDimension(Dimension):
    """A ratio: a plain number, or a text in percent or parts per million ("20 ppm")."""

    @property
    def allowed(self) -> str:
        """What a user may write."""
        return f'{self.name}: a plain number such as 0.02, or a text such as "{self.example}"'

    def _from_text(self, text: str) -> float:
        match = _SHARE.fullmatch(text) if len(text) <= _LONGEST else None
        if match is None:
            raise refusal(f"{shown(text)} is not {self.name}", f"{self.allowed}; units: %, ppm")
        number, unit = match.groups()
        return float(Fraction(number) * _SHARES[unit])


SHARE = ShareDimension("a share", "1", "2 %")
_DIMENSIONS = (
    *(LENGTH, ANGLE, SPEED, ACCELERATION, ANGULAR_SPEED, ANGULAR_ACCELERATION, FORCE, TORQUE),
    *(FREQUENCY, DURATION, MASS, FIRST_MOMENT, INERTIA, DAMPING, FORCE_VARIANCE, LENGTH_VARIANCE),
    *(FORCE_CONSTANT, CURRENT, JERK, COMPLIANCE),
)
_Dimensionality = tuple[tuple[str, Fraction], ...]


@cache
def _registry() -> pint.UnitRegistry[Fraction]:
    registry: pint.UnitRegistry[Fraction] = pint.UnitRegistry(None, non_int_type=Fraction)
    for line in _DEFINITIONS:
        registry.define(line)
    return registry


@lru_cache(maxsize=1024)
def _factor(unit: str) -> tuple[Fraction, _Dimensionality] | None:
    """Return the SI value of a unit and its dimensions, None when it is not known."""
    if unit == "1":
        return Fraction(1), ()
    try:
        parsed = _registry().parse_units(
            _POWER.sub(r"**\1", re.sub(r"(?<=\w)\s+(?=\w)", "*", unit))
        )
        base = _registry().Quantity(Fraction(1), parsed).to_base_units()
    except (pint.errors.PintError, AttributeError, TypeError, ValueError):
        return None
    dimensions = tuple(
        sorted((str(key), Fraction(str(power))) for key, power in base.dimensionality.items())
    )
    return Fraction(base.magnitude), dimensions


@cache
def unit_symbols() -> tuple[str, ...]:
    """Return every unit as it is usually written."""
    parts = (line.split(" = ") for line in _DEFINITIONS)
    return tuple(names[0] if len(names) == _UNSIGNED else names[2] for names in parts)


def _quantity(text: str) -> re.Match[str] | None:
    return _QUANTITY.fullmatch(text.translate(_SUPERSCRIPTS)) if len(text) <= _LONGEST else None


def _dimensionality(unit: str) -> _Dimensionality:
    factor = _factor(unit)
    if factor is None:
        raise ValueError(f"unit '{unit}' is not defined")
    return factor[1]


def _of_dimensions(dimensions: _Dimensionality) -> Dimension | None:
    return next((d for d in _DIMENSIONS if _dimensionality(d.unit) == dimensions), None)


def dimension_of(unit: str) -> Dimension:
    """Return the dimension whose plain numbers are in this unit ("1" for a bare number).

    Raises
    ------
    ValueError
        If the unit is not known.
    """
    if not _dimensionality(unit):
        return NUMBER
    known = (d for d in _DIMENSIONS if _factor(d.unit) == _factor(unit))
    return next(known, Dimension(f"a value in {unit}", unit, f"1 {unit}"))


def unit_dimension(unit: str) -> Dimension | None:
    """Return the dimension that a unit belongs to whatever its scale, None for an unknown unit."""
    match = _quantity(f"1 {unit}")
    factor = _factor(match.group(2)) if match and match.group(2) else None
    return None if factor is None else _of_dimensions(factor[1])


Positive = require(lambda value: value > 0, "{value:g} is not positive", "a value above 0")
NotNegative = require(lambda value: value >= 0, "{value:g} is negative", "0 or more")
Number = Annotated[float, BeforeValidator(NUMBER.parse)]
Share = Annotated[float, BeforeValidator(SHARE.parse)]
Length = Annotated[float, BeforeValidator(LENGTH.parse)]
Angle = Annotated[float, BeforeValidator(ANGLE.parse)]
Speed = Annotated[float, BeforeValidator(SPEED.parse)]
Acceleration = Annotated[float, BeforeValidator(ACCELERATION.parse)]
Jerk = Annotated[float, BeforeValidator(JERK.parse)]
Mass = Annotated[float, BeforeValidator(MASS.parse)]
Inertia = Annotated[float, BeforeValidator(INERTIA.parse)]
Force = Annotated[float, BeforeValidator(FORCE.parse)]
Frequency = Annotated[float, BeforeValidator(FREQUENCY.parse)]
Duration = Annotated[float, BeforeValidator(DURATION.parse)]
ForceVariance = Annotated[float, BeforeValidator(FORCE_VARIANCE.parse)]
LengthVariance = Annotated[float, BeforeValidator(LENGTH_VARIANCE.parse)]
ForceConstant = Annotated[float, BeforeValidator(FORCE_CONSTANT.parse)]
Compliance = Annotated[float, BeforeValidator(COMPLIANCE.parse)]
_SHOWN_AS = {
    "rad": ("deg", math.degrees(1.0)),
    "rad/s": ("deg/s", math.degrees(1.0)),
    "1": ("", 1.0),
}


def quantity_text(value: float, unit: str, digits: int = 6) -> str:
    """Return an SI value with its unit, angles in degrees: ``"15 deg"``, ``"0.33 m"``, ``"12"``.

    The unit is ``"1"`` for a bare number.
    """
    symbol, factor = _SHOWN_AS.get(unit, (unit, 1.0))
    return f"{value * factor:.{digits}g} {symbol}".rstrip()
