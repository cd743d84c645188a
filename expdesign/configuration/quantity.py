"""Physical quantities: a plain number in SI units, or a text with a unit ("150 mm").

A unit is a product of known symbols with powers: "kg m^2", "N s/m". Prefixes do not combine freely
("min" is a minute, never a milli-inch), and an angle has a dimension ("rad/s" is not a frequency).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from numbers import Real
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from expdesign.configuration.errors import quote, refusal, require

_UNITS: tuple[tuple[str, int | str | float | Fraction, str], ...] = (
    ("m meter", 1, "m"),
    ("km kilometer", 1000, "m"),
    ("dm decimeter", "0.1", "m"),
    ("cm centimeter", "0.01", "m"),
    ("mm millimeter", "1e-3", "m"),
    ("µm um micrometer", "1e-6", "m"),
    ("nm nanometer", "1e-9", "m"),
    ("in inch", "0.0254", "m"),
    ("ft foot", "0.3048", "m"),
    ("s second", 1, "s"),
    ("ms millisecond", "1e-3", "s"),
    ("µs us microsecond", "1e-6", "s"),
    ("ns nanosecond", "1e-9", "s"),
    ("min minute", 60, "s"),
    ("h hour", 3600, "s"),
    ("Hz hertz", 1, "s^-1"),
    ("mHz millihertz", "1e-3", "s^-1"),
    ("kHz kilohertz", 1000, "s^-1"),
    ("MHz megahertz", 10**6, "s^-1"),
    ("rad radian", 1, "rad"),
    ("mrad milliradian", "1e-3", "rad"),
    ("µrad urad microradian", "1e-6", "rad"),
    ("deg ° degree", math.pi / 180, "rad"),  # "30 deg" is math.radians(30) to the last bit
    ("arcmin arcminute", math.pi / 10_800, "rad"),
    ("arcsec arcsecond", math.pi / 648_000, "rad"),
    ("rev turn", 2 * math.pi, "rad"),
    ("rpm", Fraction(2 * math.pi) / 60, "rad s^-1"),
    ("kg kilogram", 1, "kg"),
    ("g gram", "1e-3", "kg"),
    ("t tonne", 1000, "kg"),
    ("lb pound", "0.45359237", "kg"),
    ("N newton", 1, "kg m s^-2"),
    ("mN millinewton", "1e-3", "kg m s^-2"),
    ("kN kilonewton", 1000, "kg m s^-2"),
    ("MN meganewton", 10**6, "kg m s^-2"),
    ("lbf poundforce", "4.4482216152605", "kg m s^-2"),
    ("Nm", 1, "kg m^2 s^-2"),
    ("mNm", "1e-3", "kg m^2 s^-2"),
    ("Ncm", "0.01", "kg m^2 s^-2"),
    ("A ampere", 1, "A"),
    ("mA milliampere", "1e-3", "A"),
    ("V volt", 1, "kg m^2 s^-3 A^-1"),
    ("mV millivolt", "1e-3", "kg m^2 s^-3 A^-1"),
    ("ohm Ohm", 1, "kg m^2 s^-3 A^-2"),
    ("mohm milliohm", "1e-3", "kg m^2 s^-3 A^-2"),
    ("count inc increment tick", 1, "count"),
    ("duty", 1, "duty"),
    ("percent", "0.01", "duty"),
)
"""Names, usual symbol first; value in the product of base units."""

_NUMBER = r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?"
_FACTOR = r"(?:[A-Za-zµ]{1,12}|°)(?:(?:\^|\*\*)?-?[1-9])?"
_QUANTITY = re.compile(
    rf"\s*({_NUMBER})\s*((?:{_FACTOR})(?:\s*[*/]\s*{_FACTOR}|\s+{_FACTOR})*)?\s*"
)
_FACTORS = re.compile(r"([*/]?)\s*([A-Za-zµ]+|°)(?:(?:\^|\*\*)?(-?[1-9]))?")
_SHARE = re.compile(rf"\s*({_NUMBER})\s*(%|ppm)?\s*")
_SHARES = {None: Fraction(1), "%": Fraction(1, 100), "ppm": Fraction(1, 1_000_000)}
_LONGEST = 120
_SIGNS = {"²": "2", "³": "3", "·": "*", "⋅": "*", "−": "-", "μ": "µ"}
_PLAIN = str.maketrans(_SIGNS | {"%": "percent", "Ω": "ohm", "\N{OHM SIGN}": "ohm"})


@dataclass(frozen=True)
class Quantity:
    """A kind of physical quantity; as an annotation, the validator of a float in SI units.

    Examples
    --------
    >>> Quantity("a length", "m", "150 mm").parse("150 mm")
    0.15
    """

    name: str
    """With its article, for messages."""
    unit: str
    """Unit of plain numbers."""
    example: str
    hints: tuple[tuple[str, str], ...] = ()
    """Advice for values of another kind, by the unit of that kind."""

    @property
    def allowed(self) -> str:
        """Accepted values in words."""
        if self.unit == "1":
            return "a plain number"
        return f'{self.name}: a plain number in {self.unit}, or a text such as "{self.example}"'

    @property
    def units(self) -> tuple[str, ...]:
        """Symbols of this kind; none for a speed."""
        wanted = _powers(self.unit)
        return tuple(symbol for symbol in unit_symbols() if _powers(symbol) == wanted)

    def parse(self, value: object) -> float:
        """Convert a real number, or a text of a number and an optional unit, to SI units.

        Raises
        ------
        pydantic_core.PydanticCustomError
            The value is a boolean, not finite, or has an unknown unit or one of another kind.
        """
        if isinstance(value, bool) or not isinstance(value, Real | str):
            raise refusal(f"{quote(value)} is not {self.name}", self.allowed)
        try:
            number = self._parse_text(value) if isinstance(value, str) else float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise refusal(f"{quote(value)} is not a finite number", self.allowed)
        return number

    def _parse_text(self, text: str) -> float:
        match = _match(text)
        if match is None:
            hint = " (the decimal mark is a point)" if re.match(r"\s*[+-]?\d+,\d", text) else ""
            raise refusal(f"{quote(text)} is not {self.name}{hint}", self.allowed)
        number, unit = match.groups()
        if unit is None:
            return float(number)
        if (found := _parse_unit(unit)) is None:
            units = self.units or unit_symbols()
            known = "the units are" if self.units else "a product of these units"
            raise refusal(
                f"{quote(text)} has an unknown unit '{unit}'",
                f"{self.allowed}; {known}: {', '.join(units)}",
            )
        scale, powers = found
        if powers != _powers(self.unit):
            kind = _kind(powers)
            wrong = f"is {kind.name}" if kind else "has the wrong unit"
            advice = dict(self.hints).get(kind.unit) if kind else None
            allowed = f"{self.allowed}; {advice}" if advice else self.allowed
            raise refusal(f"{quote(text)} {wrong}, not {self.name}", allowed)
        return float(Fraction(number) * scale)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.parse, handler(source))


class ShareQuantity(Quantity):
    """A ratio: a plain number, or a text in percent or parts per million ("20 ppm")."""

    @property
    def allowed(self) -> str:
        """Accepted values in words."""
        return f'{self.name}: a plain number such as 0.02, or a text such as "{self.example}"'

    def _parse_text(self, text: str) -> float:
        match = _SHARE.fullmatch(text) if len(text) <= _LONGEST else None
        if match is None:
            raise refusal(f"{quote(text)} is not {self.name}", f"{self.allowed}; units: %, ppm")
        number, unit = match.groups()
        return float(Fraction(number) * _SHARES[unit])


NUMBER = Quantity("a number", "1", "0.5")
SHARE = ShareQuantity("a share", "1", "2 %")
LENGTH = Quantity("a length", "m", "150 mm")
ANGLE = Quantity("an angle", "rad", "30 deg")
SPEED = Quantity("a speed", "m/s", "500 mm/s")
ACCELERATION = Quantity("an acceleration", "m/s^2", "30 m/s^2")
JERK = Quantity("a jerk", "m/s^3", "1500 m/s^3")
FORCE = Quantity(
    "a force",
    "N",
    "0.2 kN",
    (("N m", "a motor's torque, behind a screw or gear, is that times 2 pi / lead"),),
)
FREQUENCY = Quantity("a frequency", "Hz", "0.2 Hz")
DURATION = Quantity("a duration", "s", "1 ms")
MASS = Quantity("a mass", "kg", "1.9 kg")
INERTIA = Quantity("a moment of inertia", "kg m^2", "0.2 kg m^2")
FORCE_VARIANCE = Quantity("a force variance", "N^2", "400 N^2")
LENGTH_VARIANCE = Quantity("a length variance", "m^2", "0.01 mm^2")
FORCE_CONSTANT = Quantity("a force constant", "N/A", "90 N/A")
CURRENT = Quantity("a current", "A", "2 A")
COMPLIANCE = Quantity("a compliance", "m/N", "0.05 um/N")
TORQUE = Quantity("a torque", "N m", "0.4 N m")
COUNT = Quantity("a count", "count", "4096 counts")
VOLTAGE = Quantity("a voltage", "V", "24 V")
DUTY = Quantity("a duty cycle", "duty", "40 %")
"""Share of the supply voltage, from −1 to 1, that a bridge applies to its motor."""
MOTOR_CONSTANT = Quantity("a motor constant", "N m/A", "0.05 N m/A")
RESISTANCE = Quantity("a resistance", "ohm", "1.2 ohm")

_QUANTITIES = (
    *(LENGTH, ANGLE, SPEED, ACCELERATION, JERK, FORCE, FREQUENCY, DURATION, MASS, INERTIA),
    *(FORCE_VARIANCE, LENGTH_VARIANCE, FORCE_CONSTANT, CURRENT, COMPLIANCE, TORQUE, COUNT),
    *(VOLTAGE, DUTY, MOTOR_CONSTANT, RESISTANCE),
    Quantity("an angular speed", "rad/s", "30 deg/s"),
    Quantity("an angular acceleration", "rad/s^2", "30 deg/s^2"),
    Quantity("a first moment", "kg m", "1.7 kg m"),
    Quantity("a viscous friction", "N s/m", "20 N s/m"),
)

Number = Annotated[float, NUMBER]
Share = Annotated[float, SHARE]
Length = Annotated[float, LENGTH]
Angle = Annotated[float, ANGLE]
Speed = Annotated[float, SPEED]
Acceleration = Annotated[float, ACCELERATION]
Jerk = Annotated[float, JERK]
Mass = Annotated[float, MASS]
Inertia = Annotated[float, INERTIA]
Force = Annotated[float, FORCE]
Frequency = Annotated[float, FREQUENCY]
Duration = Annotated[float, DURATION]
ForceVariance = Annotated[float, FORCE_VARIANCE]
LengthVariance = Annotated[float, LENGTH_VARIANCE]
ForceConstant = Annotated[float, FORCE_CONSTANT]
Compliance = Annotated[float, COMPLIANCE]
Voltage = Annotated[float, VOLTAGE]
MotorConstant = Annotated[float, MOTOR_CONSTANT]
Resistance = Annotated[float, RESISTANCE]

Positive = require(lambda value: value > 0, "{value:g} is not positive", "a value above 0")
NotNegative = require(lambda value: value >= 0, "{value:g} is negative", "0 or more")


@lru_cache(maxsize=1024)
def quantity_in(unit: str) -> Quantity:
    """Return the quantity with plain numbers in a unit, ``"1"`` for a bare number.

    Examples
    --------
    >>> quantity_in("m/s").parse("500 mm/s")
    0.5
    """
    if not _powers(unit):
        return NUMBER
    known = (one for one in _QUANTITIES if _parse_unit(one.unit) == _parse_unit(unit))
    return next(known, Quantity(f"a value in {unit}", unit, f"1 {unit}"))


def quantity_of_unit(unit: str) -> Quantity | None:
    """Return the kind of quantity of a unit of any scale, None for an unknown unit.

    Examples
    --------
    >>> quantity_of_unit("mm").name
    'a length'
    """
    found = _unit_of(unit)
    return None if found is None else _kind(found[1])


def _unit_of(unit: str) -> tuple[Fraction, _Powers] | None:
    match = _match(f"1 {unit}")
    return _parse_unit(match.group(2)) if match and match.group(2) else None


def same_unit(one: str, other: str) -> bool:
    """Return whether two known units have the same value.

    Examples
    --------
    >>> same_unit("N m", "Nm"), same_unit("m", "mm")
    (True, False)
    """
    return _unit_of(one) == _unit_of(other)


_SHOWN_AS = {
    "rad": ("deg", math.degrees(1.0)),
    "rad/s": ("deg/s", math.degrees(1.0)),
    "1": ("", 1.0),
}


def quantity_text(value: float, unit: str, digits: int = 6) -> str:
    """Return an SI value with its unit, angles in degrees; the unit of a bare number is ``"1"``.

    Examples
    --------
    >>> quantity_text(0.33, "m"), quantity_text(3.14159265, "rad"), quantity_text(12, "1")
    ('0.33 m', '180 deg', '12')
    >>> quantity_text(184.0, "N", 2)
    '180 N'
    """
    symbol, factor = _SHOWN_AS.get(unit, (unit, 1.0))
    return f"{float(f'{value * factor:.{digits}g}'):g} {symbol}".rstrip()


def unit_symbols() -> tuple[str, ...]:
    """Return the usual symbol of every unit."""
    return tuple(names.split()[0] for names, _, _ in _UNITS)


_Powers = tuple[tuple[str, int], ...]
"""Powers of the base units, sorted by their symbols."""


def _match(text: str) -> re.Match[str] | None:
    return _QUANTITY.fullmatch(text.translate(_PLAIN)) if len(text) <= _LONGEST else None


def _powers(unit: str) -> _Powers:
    found = _parse_unit(unit)
    if found is None:
        raise ValueError(f"unit '{unit}' is not defined")
    return found[1]


def _kind(powers: _Powers) -> Quantity | None:
    return next((one for one in _QUANTITIES if _powers(one.unit) == powers), None)


@lru_cache(maxsize=1024)
def _parse_unit(unit: str) -> tuple[Fraction, _Powers] | None:
    """Return the SI value of a product of units, and its dimension; None for unknown symbols."""
    scale, powers = Fraction(1), dict[str, int]()
    for operator, symbol, exponent in _FACTORS.findall("" if unit == "1" else unit):
        if symbol not in _table():
            return None
        power = int(exponent or 1) * (-1 if operator == "/" else 1)
        value, base = _table()[symbol]
        scale *= value**power
        for name, own in base.items():
            powers[name] = powers.get(name, 0) + own * power
    return scale, tuple(sorted((name, power) for name, power in powers.items() if power))


_SHORT = 3
"""Longest name without a plural."""


@cache
def _table() -> dict[str, tuple[Fraction, dict[str, int]]]:
    """Return value and powers of the base units of every unit, by all its names."""
    found = {}
    for names, value, product in _UNITS:
        base = {symbol: int(power or 1) for _, symbol, power in _FACTORS.findall(product)}
        for name in names.split():
            found[name] = Fraction(value), base
            if len(name) > _SHORT:
                found[f"{name}s"] = found[name]
    return found
