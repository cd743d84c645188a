"""`README.txt`: how to run what stands in the folder."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import Any

_WIDTH = 96

_CONVENTION = (
    "Poses are those of the TCP in the base frame. The rotation is R = Rx(phi) Ry(theta) Rz(psi): "
    "first about x, then about the moved y, then about the moved z; R takes vectors of the "
    "platform's frame into the base frame. Strut lengths are the distances between the centres of "
    "base joint and platform joint."
)


def readme(motion: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the text that tells how to run every file.

    Parameters
    ----------
    motion : dict
        As `motion_record` makes it.
    files : dict
        By the file's name, as `file_record` makes them.
    """
    first, last = motion["window"]
    parts = [
        _heading(f"Controller tables of {motion['name']} for {motion['robot']}", "="),
        _paragraph(
            f"All files hold the same motion of {motion['duration']:.4f} s: from rest at home "
            f"onto the periodic excitation, {motion['periods']} periods of {motion['period']:.6f} "
            f"s, and back to rest at home. Home is {_pose(motion['home'])}."
        ),
        _heading("What to record", "-"),
        _paragraph(
            f"The measurement window lasts from {first:.6f} s to {last:.6f} s after the start of "
            f"the table: the {motion['periods']} periods. Record the six strut lengths and the "
            f"six actuator forces (or motor currents) at {motion['sampling']:g} Hz, every sample "
            "with its time from the start of the table or triggered by it, with forces and "
            "lengths of the same instants. Keep the raw, unfiltered values. The way to the window "
            f"and from it does not count: in the run file of `expdesign estimate`, data: {{start: "
            f"{first:.6f} s, end: {last:.6f} s}} leaves it out of such a recording."
        ),
        _heading("Convention", "-"),
        _paragraph(_CONVENTION),
        _paragraph(
            "Before the first run: move each axis by hand and compare its unit, sign and zero "
            "with the tables below, then run the file at a distance from people and obstacles."
        ),
    ]
    for name, record in files.items():
        parts += [
            _heading(f"{name}: {record['title']}", "-"),
            _paragraph(record["guide"]),
            _axes(record["axes"]),
            _paragraph(_rows(record)),
            _paragraph(_checked(record["read_back"])),
        ]
    return "\n\n".join(parts) + "\n"


def _rows(record: Mapping[str, Any]) -> str:
    shortest, longest = (1e3 * record[key] for key in ("shortest_step", "longest_step"))
    apart = f"{longest:.6g}" if longest - shortest < 1e-6 else f"{shortest:.6g} to {longest:.6g}"  # noqa: PLR2004 - a nanosecond
    digits = "all digits" if record["digits"] is None else f"{record['digits']} decimals"
    return (
        f"{record['rows']} rows, {apart} ms apart, {digits}; checked for a controller that moves "
        f"on {record['interpolation']}."
    )


def _checked(check: Mapping[str, Any]) -> str:
    text = (
        f"Read back: struts at most {1e6 * check['position_error']:.3g} µm and "
        f"{1e3 * check['velocity_error']:.3g} mm/s from the design"
    )
    shares = (("accelerations", "acceleration_error_share"), ("forces", "force_error_share"))
    for what, key in shares:
        share = check[key]
        if share is not None and math.isfinite(share):
            text += f", {what} {100 * share:.2g} % of their limits' range"
    # A record of an earlier version does not say it.
    text += f"; {check.get('limits_in_words', 'every limit kept within its tolerance')}"
    change = check["information"]
    if change is not None:
        text += (
            f"; log det F changes by {change['log_det_change']:.2g}, no predicted standard "
            f"deviation by more than {100 * abs(change['std_change']):.2g} %"
        )
    return text + "."


def _axes(axes: list[Mapping[str, Any]]) -> str:
    head = f"  {'axis':<12} {'moves':<6} {'unit':<7} start"
    rows = [f"  {a['name']:<12} {a['moves']:<6} {a['unit']:<7} {a['start']:.6f}" for a in axes]
    return "\n".join([head, *rows])


def _pose(home: list[float]) -> str:
    place = ", ".join(f"{1e3 * value:.6g}" for value in home[:3])
    turn = ", ".join(f"{math.degrees(value):.6g}" for value in home[3:])
    return f"x, y, z = {place} mm and phi, theta, psi = {turn} deg"


def _heading(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}"


def _paragraph(text: str) -> str:
    return textwrap.fill(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
