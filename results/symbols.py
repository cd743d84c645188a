"""Names of parameters and coordinates as formulas write them."""

from __future__ import annotations

import re

_GREEK = {
    "alpha": r"\alpha",
    "beta": r"\beta",
    "phi": r"\varphi",
    "theta": r"\theta",
    "psi": r"\psi",
}
_INDEXED = re.compile(r"([A-Za-z])_?([A-Za-z]+|\d+)")


def symbol(name: str) -> str:
    r"""Return a name as Matplotlib's mathematics: ``r_alpha`` → ``$r_{\alpha}$``.

    Parameters
    ----------
    name : str
        A parameter (``p10``, ``r_alpha``, ``Ixy``), a coordinate or any other name, which is
        returned as it is.
    """
    if name in _GREEK:
        return f"${_GREEK[name]}$"
    found = _INDEXED.fullmatch(name)
    if found is None:
        return f"${name}$" if len(name) == 1 and name.isalpha() else name
    letter, index = found.groups()
    return f"${letter}_{{{_GREEK.get(index, index)}}}$"
