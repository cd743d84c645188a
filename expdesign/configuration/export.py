"""`export:`, the controller tables that are written."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, get_args

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag, model_validator

from expdesign.configuration.base import Section
from expdesign.configuration.failure import nearest, refusal, shown
from expdesign.configuration.quantity import Duration, Length, Number, Positive
from expdesign.configuration.scalars import (
    Distinct,
    Name,
    at_least,
    exactly,
    one_of,
    one_or_six,
    whole,
)

ExportFormat = Literal[
    "csv",
    "ros2",
    "xps-pvt",
    "linuxcnc-gcode",
    "linuxcnc-strut",
    "pmac-pvt",
    "pi-wave",
    "pvt-csv",
    "mat",
]
Space = Literal["strut", "pose"]
LengthUnit = Literal["m", "mm", "um", "in"]
AngleUnit = Literal["rad", "deg"]
Encoding = Literal["yaml", "mcap"]

_LARGEST_DIGITS = 15
_AXES = 6


class Offer(NamedTuple):
    """What one format can be asked for.

    Attributes
    ----------
    spaces : tuple of str
        Coordinates that it can hold, the default first.
    options : tuple of str
        Keys that it takes beside `format`, `file`, `segment` and `tolerance`.
    """

    spaces: tuple[Space, ...]
    options: tuple[str, ...] = ()


_ACTUATORS = ("order", "sign", "offset")
OFFERS: dict[str, Offer] = {
    "csv": Offer(("strut",)),
    "ros2": Offer(("strut", "pose"), ("space", "encoding", "digits", "axes", *_ACTUATORS)),
    "xps-pvt": Offer(
        ("strut", "pose"),
        ("space", "digits", "units", "angles", "axes", *_ACTUATORS, "counts_per_metre"),
    ),
    "linuxcnc-gcode": Offer(("pose",), ("digits", "blend")),
    "linuxcnc-strut": Offer(("strut",), ("digits", "units", *_ACTUATORS, "counts_per_metre")),
    "pmac-pvt": Offer(
        ("strut", "pose"),
        ("space", "digits", "units", "angles", "axes", *_ACTUATORS, "counts_per_metre"),
    ),
    "pi-wave": Offer(("pose",), ("digits", "units", "angles")),
    "pvt-csv": Offer(("strut",), ("digits", "units", "axes", *_ACTUATORS)),
    "mat": Offer(
        ("strut", "pose"), ("space", "units", "angles", "axes", *_ACTUATORS, "counts_per_metre")
    ),
}
"""By the format's name."""

_ALWAYS = ("format", "file", "segment", "tolerance")
_PMAC_AXES = tuple("ABCUVWXYZ")
STRUT_ONLY = (*_ACTUATORS, "counts_per_metre")
"""Keys that say something of actuators: for tables of struts."""


def _order(value: tuple[int, ...]) -> tuple[int, ...]:
    if sorted(value) != list(range(1, _AXES + 1)):
        raise refusal(
            f"{list(value)} is no order of the six struts",
            "the numbers 1 to 6, each once: the strut on the controller's first axis comes first",
        )
    return value


def _sign(value: object) -> object:
    if isinstance(value, bool) or value not in (1, -1):
        raise refusal(f"{shown(value)} is not a sign", "1 or -1")
    return value


def _home_or_lengths(value: object) -> str:
    return "(name)" if value == "home" else "(inline)"


class ExportSection(Section):
    """One table for a controller. What is None is the format's own default.

    Attributes
    ----------
    format : str
    file : str or None
        Name of the file in ``exports/`` without its ending; the format's name by default.
    space : {"strut", "pose"} or None
        Coordinates of the table.
    segment : float or None
        Time between two rows, s (for PVT tables the longest); chosen for PVT tables, and the
        controller's period for others, when it is None.
    digits : int or None
        Digits after the decimal point.
    units : {"m", "mm", "um", "in"} or None
    angles : {"rad", "deg"} or None
    axes : (6,) or None
        Names of the axes, in the controller's order.
    order : (6,) or None
        Number of the strut on each of the controller's axes.
    sign, offset, counts_per_metre : (6,) or None
        Of struts 1 to 6: position = sign · (length − offset) · counts. The offset is the length,
        m, at which the axis reads zero, ``"home"``: the length at home.
    tolerance : float or None
        Largest deviation of a strut's length from the design, m.
    blend : float or None
        Path tolerance of LinuxCNC's G64, m.
    encoding : {"yaml", "mcap"} or None
    """

    format: Annotated[ExportFormat, one_of(ExportFormat)]
    file: Name | None = None
    space: Annotated[Space, one_of(Space)] | None = None
    segment: Annotated[Duration, Positive] | None = None
    digits: Annotated[int, whole(0, _LARGEST_DIGITS)] | None = None
    units: Annotated[LengthUnit, one_of(LengthUnit)] | None = None
    angles: Annotated[AngleUnit, one_of(AngleUnit)] | None = None
    axes: Annotated[tuple[Name, ...], exactly(_AXES, "names"), Distinct] | None = None
    order: (
        Annotated[
            tuple[Annotated[int, whole(1, _AXES)], ...],
            exactly(_AXES, "numbers of struts"),
            AfterValidator(_order),
        ]
        | None
    ) = None
    sign: (
        Annotated[tuple[Annotated[int, BeforeValidator(_sign)], ...], one_or_six("signs")] | None
    ) = None
    offset: (
        Annotated[
            Annotated[Literal["home"], Tag("(name)")]
            | Annotated[tuple[Length, ...], one_or_six("offsets"), Tag("(inline)")],
            Discriminator(_home_or_lengths),
        ]
        | None
    ) = None
    counts_per_metre: (
        Annotated[tuple[Annotated[Number, Positive], ...], one_or_six("counts per metre")] | None
    ) = None
    tolerance: Annotated[Length, Positive] | None = None
    blend: Annotated[Length, Positive] | None = None
    encoding: Annotated[Encoding, one_of(Encoding)] | None = None

    @model_validator(mode="after")
    def _format_takes_the_options(self) -> ExportSection:
        offer = OFFERS[self.format]
        for key in type(self).model_fields:
            if getattr(self, key) is None or key in (*_ALWAYS, *offer.options):
                continue
            raise refusal(
                f"{self.format} has no option '{key}'",
                ", ".join((*_ALWAYS, *offer.options)),
                key=key,
            )
        return self

    @model_validator(mode="after")
    def _options_fit_each_other(self) -> ExportSection:
        if self.coordinates == "pose":
            for key in STRUT_ONLY:
                if getattr(self, key) is not None:
                    raise refusal(
                        f"'{key}' is about actuators, the table holds poses",
                        "with space: strut only",
                        key=key,
                    )
        if self.encoding == "mcap" and self.digits is not None:
            raise refusal(
                "a bag holds numbers with all their digits",
                "with encoding: yaml only",
                key="digits",
            )
        if self.format == "pmac-pvt":
            for name in self.axes or ():
                if name not in _PMAC_AXES:
                    raise refusal(
                        f"'{name}' is no axis of a PMAC",
                        f"six of the letters {' '.join(_PMAC_AXES)}",
                        key="axes",
                    )
        if self.units is not None and self.counts_per_metre is not None:
            raise refusal(
                "units and counts_per_metre are both given", "one of the two", key="units"
            )
        return self

    @property
    def coordinates(self) -> Space:
        """Coordinates of the table: what was asked for, or the format's default."""
        return self.space or OFFERS[self.format].spaces[0]

    @property
    def stem(self) -> str:
        """Name of the file without its ending."""
        return self.file or self.format


def _section(value: object) -> object:
    """Let a format's name stand for the format with its defaults."""
    if not isinstance(value, str):
        return value
    choices = get_args(ExportFormat)
    if value not in choices:
        raise refusal(
            f"{shown(value)} is not a choice", " | ".join(choices), nearest(value, choices)
        )
    return {"format": value}


def _files_differ(sections: tuple[ExportSection, ...]) -> tuple[ExportSection, ...]:
    stems = [section.stem for section in sections]
    for position, stem in enumerate(stems):
        if stem in stems[:position]:
            raise refusal(f"'{stem}' is listed twice", "each one once, or with a file: of its own")
    return sections


ExportSections = Annotated[
    tuple[Annotated[ExportSection, BeforeValidator(_section)], ...],
    at_least(0, "formats"),
    AfterValidator(_files_differ),
]
"""Names of formats, or sections with options."""
