"""Names of parameters and coordinates as formulas write them."""

from __future__ import annotations

import re

GREEK = {
    "alpha": (r"\alpha", "α"),
    "beta": (r"\beta", "β"),
    "phi": (r"\varphi", "φ"),
    "theta": (r"\theta", "θ"),
    "psi": (r"\psi", "ψ"),
}
"""Letters by their names: in LaTeX, and as they are."""

_INDEXED = re.compile(r"([A-Za-z])_?([A-Za-z]+|\d+)")


def symbol(name: str) -> str:
    r"""Return a name as Matplotlib's mathematics: ``r_alpha`` → ``$r_{\alpha}$``.

    Names that are neither parameters (``p10``, ``Ixy``) nor coordinates are returned as they are.
    """
    letter, index = (GREEK.get(part, (part, part))[0] for part in symbol_parts(name))
    if index:
        return f"${letter}_{{{index}}}$"
    return f"${letter}$" if letter else name


def symbol_parts(name: str) -> tuple[str, str]:
    """Return letter and index of a name, empty where there are none: ``("r", "alpha")``."""
    if name in GREEK or (len(name) == 1 and name.isalpha()):
        return name, ""
    found = _INDEXED.fullmatch(name)
    return ("", "") if found is None else (found[1], found[2])
