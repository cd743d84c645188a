"""`export:`: the options that controller tables of all formats share, and their validation.

A format is a module in `expdesign.export.formats` or in a plug-in. Its own options are a subclass
of `ExportSection`, to which this module leads by the format's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import AfterValidator, BeforeValidator, Field, SerializeAsAny, model_validator

from expdesign.configuration import schema
from expdesign.configuration.actuator_units import ActuatorUnits
from expdesign.configuration.errors import nearest_name, quote, refusal
from expdesign.configuration.quantity import Duration, Length, Positive, Share
from expdesign.configuration.robot import ResolvedRobot
from expdesign.mechanism.hexapod import ACTUATORS

Space = Literal["strut", "pose"]
_LARGEST_DIGITS = 15
_ALWAYS = ("format", "file", "segment", "scale", "tolerance")
STRUT_AXES = ("order", "sign", "offset")
STRUT_ONLY = (*STRUT_AXES, "counts_per_metre", "counts_per_revolution")
"""Options about actuators, for tables of struts."""
SCALES = ("units", "counts_per_metre", "counts_per_revolution")
"""Options for the unit of a strut's length, one of which may be given."""
MOTOR_UNITS = ("rad", "deg", "rev")
"""Units of a strut's length as the angle of its motor."""
COUNTS = "counts"
PVT_OPTIONS = (*("space", "digits", "units", "angles", "axes", *STRUT_ONLY, "trigger"),)
"""Shared options of PVT tables."""


def export_formats() -> Mapping[str, type[ExportSection]]:
    """Return the options of every format by its name.

    Examples
    --------
    >>> export_formats()["pi-wave"].spaces
    ('pose',)
    """
    formats = import_module("expdesign.export.formats").table_formats()
    return {name: table_format.options for name, table_format in formats.items()}


class ExportSection(schema.Section):
    """Options of one controller table; the value None means the format's default."""

    spaces: ClassVar[tuple[Space, ...]] = ("strut", "pose")
    """Coordinates of the format's tables, the default first."""
    shared: ClassVar[tuple[str, ...]] = ()
    """Accepted options of this class in addition to those of every format."""
    reasons: ClassVar[dict[str, str]] = {}
    """Reasons why the format does not have options that other formats have."""
    outputs: ClassVar[tuple[int, int]] = (0, 0)
    """First and last number of a digital output, for formats with the option `trigger`."""

    format: Annotated[str, schema.one_of(export_formats)]
    file: schema.Name | None = None
    """File name in ``exports/`` with or without suffix, by default the format's name; the name of a
    scaled motion ends in its scale."""
    space: Space | None = None
    segment: Annotated[Duration, Positive] | None = None
    """Time between two rows, s (for PVT tables the longest); by default chosen for PVT tables, and
    the controller's period for others."""
    scale: Annotated[Share, Field(gt=0, le=1)] | None = None
    """Scale F of a table with home + F (λ(F t) − home) of the motion λ, for a first run."""
    digits: Annotated[int, schema.whole(0, _LARGEST_DIGITS)] | None = None
    """Digits after the decimal point."""
    units: Literal["m", "mm", "um", "in", "rad", "deg", "rev"] | None = None
    """Unit of lengths; of a strut also the angle of its motor."""
    angles: Literal["rad", "deg"] | None = None
    axes: (
        Annotated[tuple[schema.Name, ...], schema.exactly(ACTUATORS, "names"), schema.Distinct]
        | None
    ) = None
    """Names of the axes, in the controller's order."""
    order: schema.Order | None = None
    """Number of the strut on each of the controller's axes."""
    sign: schema.Signs | None = None
    """Signs by the struts' numbers: position = sign · (length − offset) · counts."""
    offset: schema.Offsets | None = None
    """Lengths at which the axes of the struts read zero, m; ``"home"``: the lengths at home."""
    counts_per_metre: schema.Counts | None = None
    """Counts of one metre of a strut, instead of units."""
    counts_per_revolution: schema.Counts | None = None
    """Counts of one turn of a motor, instead of units."""
    tolerance: Annotated[Length, Positive] | None = None
    """Largest deviation of a strut's length from the design, m."""
    trigger: Annotated[int, schema.whole(0)] | None = None
    """Number of the digital output that is on during the measurement window."""
    repeat: Literal["file", "controller"] | None = None
    """Where a period is repeated: ``"file"``, the default, or ``"controller"``."""

    @classmethod
    def own_options(cls) -> tuple[str, ...]:
        """Return the keys that the format accepts in addition to those of every format."""
        own = (key for key in cls.model_fields if key not in ExportSection.model_fields)
        return (*cls.shared, *own)

    @classmethod
    def options(cls) -> tuple[str, ...]:
        """Return the keys that the format accepts."""
        return (*_ALWAYS, *cls.own_options())

    @model_validator(mode="after")
    def _check_combination(self) -> ExportSection:
        takes = self.options()
        for key in type(self).model_fields:
            if getattr(self, key) is not None and key not in takes:
                reason = f": {self.reasons[key]}" if key in self.reasons else ""
                message = f"{self.format} has no option '{key}'{reason}"
                raise refusal(message, ", ".join(takes), key=key)
        strut_only = [key for key in STRUT_ONLY if getattr(self, key) is not None]
        if self.coordinates == "pose" and strut_only:
            key = strut_only[0]
            message = f"'{key}' is about actuators, the table holds poses"
            raise refusal(message, "with space: strut only", key=key)
        if self.coordinates == "pose" and self.units in MOTOR_UNITS:
            message = f"'{self.units}' is a unit of motors, the table holds poses"
            raise refusal(message, "with space: strut only", key="units")
        scales = [key for key in SCALES if getattr(self, key) is not None]
        if len(scales) > 1:
            message = f"{scales[0]} and {scales[1]} are both given"
            raise refusal(message, "one of the two", key=scales[0])
        first, last = self.outputs
        if self.trigger is not None and not first <= self.trigger <= last:
            message = f"{self.format} has no output {self.trigger}"
            raise refusal(message, f"a whole number from {first} to {last}", key="trigger")
        return self

    @property
    def looped(self) -> bool:
        """Whether the controller repeats the period."""
        return self.repeat == "controller"

    @property
    def coordinates(self) -> Space:
        """Coordinates of the table."""
        return self.space or self.spaces[0]

    @property
    def length_unit(self) -> str | None:
        """Unit of lengths; None for the format's."""
        counted = self.counts_per_metre is not None or self.counts_per_revolution is not None
        return COUNTS if counted else self.units

    def actuator_units(self, robot: ResolvedRobot | None) -> ActuatorUnits:
        """Return the units of the struts and motors of a robot."""
        return ActuatorUnits(robot, self.counts_per_metre, self.counts_per_revolution)

    @property
    def factor(self) -> float:
        """Scale of the motion, 0 < F ≤ 1, by default 1."""
        return 1.0 if self.scale is None else self.scale

    @property
    def stem(self) -> str:
        """File name without suffix, with the scale."""
        name = (self.file or self.format).removesuffix(self.suffix)
        ending = "" if self.factor == 1 else f"-scale-{self.factor:g}"
        return name if name.endswith(ending) else f"{name}{ending}"

    @property
    def suffix(self) -> str:
        """Suffix of the file."""
        formats = import_module("expdesign.export.formats").table_formats()
        return self.binary_suffix or cast("str", formats[self.format].suffix)

    @property
    def binary_suffix(self) -> str:
        """Suffix of a binary file with all digits, empty for text and for formats without both."""
        return ""


def export_section(**given: Any) -> ExportSection:
    """Return the validated options of one table.

    Examples
    --------
    >>> export_section(format="xps-pvt", segment="20 ms").segment
    0.02
    """
    section = export_formats().get(given.get("format", ""), ExportSection)
    return section.model_validate(given)


def _read_section(value: object) -> object:
    """Validate a format's name or a mapping with options against the format's own section."""
    if isinstance(value, ExportSection):
        return value
    given = {"format": value} if isinstance(value, str) else value
    if not isinstance(given, dict):
        raise refusal(f"{quote(value)} is not a format", "a format, or a mapping with its options")
    formats = export_formats()
    name = given.get("format")
    if not isinstance(name, str) or name not in formats:
        key = "" if isinstance(value, str) or "format" not in given else "format"
        reason = f"{quote(name)} is not a choice" if name else "the key 'format' is missing"
        meant = partial(nearest_name, name, formats)
        raise refusal(reason, " | ".join(formats), meant, key)
    takes = formats[name].options()
    for key in given:
        if key not in ExportSection.model_fields and key not in takes:
            meant = partial(nearest_name, key, takes)
            raise refusal(f"unknown key {quote(key)}", ", ".join(takes), meant, key)
    return formats[name].model_validate(given)


def _check_files_differ(sections: tuple[ExportSection, ...]) -> tuple[ExportSection, ...]:
    seen = set[str]()
    for section in sections:
        if section.stem in seen:
            message = f"'{section.stem}' is listed twice"
            raise refusal(message, "each one once, or with another file:")
        seen.add(section.stem)
    return sections


ExportSections = Annotated[
    tuple[SerializeAsAny[Annotated[ExportSection, BeforeValidator(_read_section)]], ...],
    schema.at_least(0, "formats"),
    AfterValidator(_check_files_differ),
]
"""Names of formats, or sections with options."""
