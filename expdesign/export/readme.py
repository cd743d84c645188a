"""`README.txt`: instructions for the tables of the folder."""

from __future__ import annotations

import math
import textwrap

from expdesign.export.definition import scaled_in_words
from expdesign.export.result import ExportResult, join_words
from expdesign.recheck.limit_check import in_words
from expdesign.templates import text_templates

_WIDTH = 96


def readme(result: ExportResult) -> str:
    """Return the instructions for every file of an export."""
    motion = result.motion
    environment = text_templates("expdesign.export")
    environment.filters |= {
        "heading": lambda text, line: f"{text}\n{line * len(text)}\n",
        "paragraph": _paragraph,
        "scaled_in_words": scaled_in_words,
    }
    text = environment.get_template("readme.txt.j2").render(
        motion=motion,
        files=result.files,
        scaled=[name for name, file in result.files.items() if file.scale != 1],
        place=", ".join(f"{1e3 * value:.6g}" for value in motion.home[:3]),
        turn=", ".join(f"{math.degrees(value):.6g}" for value in motion.home[3:]),
        unlimited=in_words(motion.unlimited),
        isfinite=math.isfinite,
    )
    return text.rstrip("\n") + "\n"


def _paragraph(text: str) -> str:
    filled = textwrap.fill(join_words(text), _WIDTH, break_long_words=False, break_on_hyphens=False)
    return f"{filled}\n\n"
