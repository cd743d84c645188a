"""`export:`, the controller tables that are written."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, BeforeValidator, model_validator

from expdesign.configuration.errors import refusal, require
from expdesign.configuration.fields import (
    Distinct,
    Name,
    Offsets,
    Order,
    Signs,
    at_least,
    exactly,
    known,
    one_of,
    per_strut,
    whole,
)
from expdesign.configuration.quantity import Duration, Length, Number, Positive, Share
from expdesign.configuration.section import LATER, Section
from expdesign.mechanism.hexapod import ACTUATORS

Space = Literal["strut", "pose"]
LengthUnit = Literal["m", "mm", "um", "in"]
AngleUnit = Literal["rad", "deg"]
Encoding = Literal["yaml", "mcap"]

_LARGEST_DIGITS = 15


class Offer(NamedTuple):
    """What one format can be asked for."""

    spaces: tuple[Space, ...]
    """Coordinates that it can hold, the default first."""
    options: tuple[str, ...] = ()
    """Keys that it takes beside `format`, `file`, `segment`, `scale` and `tolerance`."""


_OF_ACTUATORS = ("order", "sign", "offset")
_PVT = Offer(
    ("strut", "pose"),
    ("space", "digits", "units", "angles", "axes", *_OF_ACTUATORS, "counts_per_metre", "trigger"),
)
OFFERS: dict[str, Offer] = {
    "csv": Offer(("strut",)),
    "ros2": Offer(("strut", "pose"), ("space", "encoding", "digits", "axes", *_OF_ACTUATORS)),
    "xps-pvt": _PVT,
    "linuxcnc-gcode": Offer(("pose",), ("digits", "units", "blend", "trigger")),
    "linuxcnc-strut": Offer(("strut",), ("digits", "units", *_OF_ACTUATORS, "counts_per_metre")),
    "pmac-pvt": _PVT,
    "pi-wave": Offer(("pose",), ("digits", "units", "angles")),
    "pvt-csv": Offer(("strut",), ("digits", "units", "axes", *_OF_ACTUATORS)),
    "mat": Offer(
        ("strut", "pose"), ("space", "units", "angles", "axes", *_OF_ACTUATORS, "counts_per_metre")
    ),
}
"""By the format's name."""

TRIGGERS = {"linuxcnc-gcode": (0, 63), "pmac-pvt": (0, 8191), "xps-pvt": (1, 8)}
"""First and last number of an output that can be switched, by format: P of M62 and M63, the
M-variable, the output of GPIO1.DO."""

_known_format = known(tuple(OFFERS), "choice")
_ALWAYS = ("format", "file", "segment", "scale", "tolerance")
_PMAC_AXES = tuple("ABCUVWXYZ")
STRUT_ONLY = (*_OF_ACTUATORS, "counts_per_metre")
"""Keys that say something of actuators: for tables of struts."""


_SCALE = require(
    lambda value: 0 < value <= 1,
    "{value:g} does not make the motion smaller and slower",
    "a share above 0, at most 1, such as 0.3",
)


class ExportSection(Section):
    """One table for a controller. What is None is the format's own default."""

    format: Annotated[str, one_of(tuple(OFFERS))]
    file: Name | None = None
    """Name of the file in ``exports/`` without its ending; the format's name by default. Where the
    motion is scaled, the scale comes behind it."""
    space: Annotated[Space, one_of(Space)] | None = None
    segment: Annotated[Duration, Positive] | None = None
    """Time between two rows, s (for PVT tables the longest); chosen for PVT tables, and the
    controller's period for others, when it is None."""
    scale: Annotated[Annotated[Share, _SCALE] | None, LATER] = None
    """F: the table holds home + F (λ(F t) − home) of the motion λ, for a first run."""
    digits: Annotated[int, whole(0, _LARGEST_DIGITS)] | None = None
    """Digits after the decimal point."""
    units: Annotated[LengthUnit, one_of(LengthUnit)] | None = None
    angles: Annotated[AngleUnit, one_of(AngleUnit)] | None = None
    axes: Annotated[tuple[Name, ...], exactly(ACTUATORS, "names"), Distinct] | None = None
    """Names of the axes, in the controller's order."""
    order: Order | None = None
    """Number of the strut on each of the controller's axes."""
    sign: Signs | None = None
    """Of the struts by their number: position = sign · (length − offset) · counts."""
    offset: Offsets | None = None
    """Length, m, at which the axis of a strut reads zero; ``"home"``: the length at home."""
    counts_per_metre: (
        Annotated[tuple[Annotated[Number, Positive], ...], per_strut("counts per metre")] | None
    ) = None
    tolerance: Annotated[Length, Positive] | None = None
    """Largest deviation of a strut's length from the design, m."""
    blend: Annotated[Length, Positive] | None = None
    """Path tolerance of LinuxCNC's G64, m."""
    encoding: Annotated[Encoding, one_of(Encoding)] | None = None
    trigger: Annotated[Annotated[int, whole(0)] | None, LATER] = None
    """Number of the digital output that is on during the measurement window."""

    @model_validator(mode="after")
    def _options_fit_format_and_each_other(self) -> ExportSection:
        takes = (*_ALWAYS, *OFFERS[self.format].options)
        for key in type(self).model_fields:
            if getattr(self, key) is not None and key not in takes:
                raise refusal(f"{self.format} has no option '{key}'", ", ".join(takes), key=key)
        of_actuators = [key for key in STRUT_ONLY if getattr(self, key) is not None]
        if self.coordinates == "pose" and of_actuators:
            key = of_actuators[0]
            message = f"'{key}' is about actuators, the table holds poses"
            raise refusal(message, "with space: strut only", key=key)
        if self.encoding == "mcap" and self.digits is not None:
            message = "a bag holds numbers with all their digits"
            raise refusal(message, "with encoding: yaml only", key="digits")
        if self.format == "linuxcnc-gcode" and self.units not in (None, "mm", "in"):
            message = f"G-code has no lengths in {self.units}"
            raise refusal(message, "mm or in", key="units")
        self._refuse_trigger()
        unknown = [name for name in self.axes or () if name not in _PMAC_AXES]
        if self.format == "pmac-pvt" and unknown:
            allowed = f"{ACTUATORS} of the letters {' '.join(_PMAC_AXES)}"
            raise refusal(f"'{unknown[0]}' is no axis of a PMAC", allowed, key="axes")
        if self.units is not None and self.counts_per_metre is not None:
            message = "units and counts_per_metre are both given"
            raise refusal(message, "one of the two", key="units")
        return self

    def _refuse_trigger(self) -> None:
        """Refuse an output that the format's controllers do not have."""
        if self.trigger is None:
            return
        first, last = TRIGGERS[self.format]
        if not first <= self.trigger <= last:
            message = f"{self.format} has no output {self.trigger}"
            raise refusal(message, f"a whole number from {first} to {last}", key="trigger")

    @property
    def coordinates(self) -> Space:
        """Coordinates of the table: what was asked for, or the format's default."""
        return self.space or OFFERS[self.format].spaces[0]

    @property
    def factor(self) -> float:
        """Scale of the motion, 0 < F ≤ 1: 1 when none is given."""
        return 1.0 if self.scale is None else self.scale

    @property
    def stem(self) -> str:
        """Name of the file without its ending; it tells the scale."""
        name = self.file or self.format
        ending = "" if self.factor == 1 else f"-scale-{self.factor:g}"
        return name if name.endswith(ending) else f"{name}{ending}"


def _section(value: object) -> object:
    """Let a format's name stand for the format with its defaults."""
    return {"format": _known_format(value)} if isinstance(value, str) else value


def _files_differ(sections: tuple[ExportSection, ...]) -> tuple[ExportSection, ...]:
    seen = set[str]()
    for section in sections:
        if section.stem in seen:
            message = f"'{section.stem}' is listed twice"
            raise refusal(message, "each one once, or with a file: of its own")
        seen.add(section.stem)
    return sections


ExportSections = Annotated[
    tuple[Annotated[ExportSection, BeforeValidator(_section)], ...],
    at_least(0, "formats"),
    AfterValidator(_files_differ),
]
"""Names of formats, or sections with options."""
