"""`README.txt`: instructions for the tables of the folder."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable

from expdesign.export.definition import scaled_in_words
from expdesign.export.result import (
    ExportedMotion,
    ExportedTable,
    ExportResult,
    TableAxis,
    TableCheck,
)
from expdesign.recheck.limit_check import in_words

_WIDTH = 96

_CONVENTION = (
    "Poses are those of the TCP in the base frame. The rotation is R = Rx(phi) Ry(theta) Rz(psi): "
    "first about x, then about the moved y, then about the moved z; R takes vectors of the "
    "platform's frame into the base frame. Strut lengths are the distances between the centres of "
    "base joint and platform joint."
)


def readme(result: ExportResult) -> str:
    """Return the instructions for every file of an export."""
    motion = result.motion
    first, last = motion.window
    parts = [
        _heading(f"Controller tables of {motion.name} for {motion.robot}", "="),
        _paragraph(
            f"{_which(result)} the same motion of {motion.duration:.4f} s: from rest at home "
            f"onto the periodic excitation, {motion.periods} periods of {motion.period:.6f} "
            f"s, and back to rest at home. Home is {_pose(motion.home)}. "
            f"{_certificate_text(motion)}"
        ),
        _heading("What to record", "-"),
        _paragraph(
            f"The measurement window lasts from {first:.6f} s to {last:.6f} s after the start of "
            f"the table: the {motion.periods} periods. "
            f"{_scaled_tables_text(result)}Record the six strut lengths and the "
            f"six actuator forces (or motor currents) at {motion.sampling:g} Hz, every sample "
            "with its time from the start of the table or triggered by it, with forces and "
            "lengths of the same instants. Keep the raw, unfiltered values. Lead-in and lead-out "
            f"do not count: in the run file of `expdesign estimate`, data: {{start: "
            f"{first:.6f} s, end: {last:.6f} s}} leaves them out of such a recording."
        ),
        _heading("Convention", "-"),
        _paragraph(_CONVENTION),
        _paragraph(
            "Before the first run: move each axis by hand and compare its unit, sign and zero "
            "with the tables below, then run the file at a distance from people and obstacles."
        ),
    ]
    if motion.unlimited:
        parts[-1:-1] = [_heading("What nothing limits", "-"), _paragraph(_unlimited_text(motion))]
    for name, file in result.files.items():
        parts += [
            _heading(f"{name}: {file.title}", "-"),
            *_first_run_text(file, motion),
            _axes(file.axes),
            _paragraph(_rows(file)),
            _paragraph(_check_text(file.read_back)),
            *_guide(file.guide),
        ]
    return "\n\n".join(parts) + "\n"


def _certificate_text(motion: ExportedMotion) -> str:
    if not motion.certified:
        return "Its limits are not proved for every instant."
    return "By the nominal model every limit is proved to be kept at every instant of it."


def _unlimited_text(motion: ExportedMotion) -> str:
    return (
        "Neither robot nor run set these limits, and nothing but this motion itself keeps the "
        f"machine from going further. It reaches: {in_words(motion.unlimited or ())}. Make sure "
        "that the machine can go there before the first run."
    )


def _which(result: ExportResult) -> str:
    scaled = [name for name, file in result.files.items() if file.scale != 1]
    if len(scaled) == len(result.files):
        return "All files hold, smaller and slower,"
    return f"All files but {', '.join(scaled)} hold" if scaled else "All files hold"


def _scaled_tables_text(result: ExportResult) -> str:
    """Say that tables for a first run have windows of their own, where there are any."""
    if all(file.scale == 1 for file in result.files.values()):
        return ""
    return "The window of a table for a first run is stated with that table below. "


def _first_run_text(file: ExportedTable, motion: ExportedMotion) -> list[str]:
    """Describe a table for a first run, with the times of its measurement window."""
    if file.scale == 1:
        return []
    first, last = file.window(motion)
    return [
        _paragraph(
            f"This is the same motion {scaled_in_words(file.scale)}. Run it before the others. It "
            f"lasts {file.duration:.4f} s, its measurement window from {first:.6f} s to "
            f"{last:.6f} s, a period {motion.period / file.scale:.6f} s."
        )
    ]


def _guide(text: str) -> list[str]:
    """Return the paragraphs of the instructions; headings and commands stay as they are."""
    return [
        part if "\n" in part or part[:1] == " " else _paragraph(part) for part in text.split("\n\n")
    ]


def _rows(file: ExportedTable) -> str:
    shortest, longest = 1e3 * file.shortest_step, 1e3 * file.longest_step
    apart = f"{longest:.6g}" if longest - shortest < 1e-6 else f"{shortest:.6g} to {longest:.6g}"  # noqa: PLR2004 - a nanosecond
    digits = "all digits" if file.digits is None else f"{file.digits} decimals"
    path = f"moves on {file.interpolation}"
    if file.read_back.controller is not None:
        path = "plans between the rows itself"
    return f"{file.rows} rows, {apart} ms apart, {digits}; checked for a controller that {path}."


def _check_text(check: TableCheck) -> str:
    text = (
        f"Read back: struts at most {1e6 * check.position_error:.3g} µm and "
        f"{1e3 * check.velocity_error:.3g} mm/s from the design"
    )
    for what, share in (
        ("accelerations", check.acceleration_error_share),
        ("forces", check.force_error_share),
    ):
        if math.isfinite(share):
            text += f", {what} {100 * share:.2g} % of their limits' range"
    controller = check.controller
    if controller is not None:
        text = (
            "Executed by a model of the controller's planner in cycles of "
            f"{1e3 * controller.cycle:g} ms: the motion takes {controller.duration:.3f} s. {text}; "
            f"a strut accelerates by up to {controller.acceleration:.3g} m/s^2 in single cycles, "
            f"where the design has {controller.designed_acceleration:.3g} m/s^2. Commanded motion"
        ).replace("Read back: struts", "Struts are")
    text += ": " if controller is not None else "; "
    text += check.limits_in_words
    if check.broken:
        text += f"; THE MACHINE BREAKS LIMITS: {'; '.join(check.broken)}"
    change = check.information
    if change is not None:
        text += (
            f"; log det F changes by {change.log_det_change:.2g}, no predicted standard "
            f"deviation by more than {100 * abs(change.std_change):.2g} %"
        )
    return text + "."


def _axes(axes: Iterable[TableAxis]) -> str:
    head = f"  {'axis':<12} {'moves':<6} {'unit':<7} start"
    rows = [f"  {a.name:<12} {a.moves:<6} {a.unit:<7} {a.start:.6f}" for a in axes]
    return "\n".join([head, *rows])


def _pose(home: tuple[float, ...]) -> str:
    place = ", ".join(f"{1e3 * value:.6g}" for value in home[:3])
    turn = ", ".join(f"{math.degrees(value):.6g}" for value in home[3:])
    return f"x, y, z = {place} mm and phi, theta, psi = {turn} deg"


def _heading(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}"


def _paragraph(text: str) -> str:
    return textwrap.fill(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
