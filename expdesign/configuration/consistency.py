"""Parameters that no real bodies have: a warning, since rounded tables and estimates have them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_POSITIVE = ("p1", "p3", "p6", "p7", "p8", "p10")
_NOT_NEGATIVE = ("r_alpha", "r_beta", *(f"{k}{j}" for k in "rv" for j in range(1, 7)))

_ROUNDING = 0.05
"""Share by which published tables of estimates, rounded, were seen to break an inequality."""

_HARMLESS = ". By so little it is the rounding of a published table: harmless for the design"


def parameter_warnings(parameters: Mapping[str, float]) -> list[str]:
    """Return in words what is physically inconsistent in the nominal parameters.

    Parameters
    ----------
    parameters : dict
        Values in SI units by name, symmetric or general.
    """
    p = parameters
    found = [f"{name} = {p[name]:g} is not positive" for name in _POSITIVE if p[name] <= 0]
    found += [f"{name} = {p[name]:g} is negative" for name in _NOT_NEGATIVE if p[name] < 0]
    if p["p2"] > p["p3"]:
        small = p["p2"] < (1 + _ROUNDING) * p["p3"]
        found.append(
            f"p2 = {p['p2']:g} exceeds p3 = {p['p3']:g}: the struts' inertia about their axis "
            f"would be negative{_HARMLESS if small else ''}"
        )
    if p["p1"] + p["p2"] < 0:
        found.append(f"p1 + p2 = {p['p1'] + p['p2']:g} is negative")
    found += _platform(p)
    return [f"physically inconsistent parameters: {text}" for text in found]


def _platform(p: Mapping[str, float]) -> list[str]:
    """Judge mass, first moments and inertia together by the pseudo-inertia matrix."""
    if any(p[name] <= 0 for name in ("p6", "p7", "p8", "p10")):
        return []
    inertia = np.diag([p["p6"], p["p7"], p["p8"]])
    moments = np.array([p.get("sx", 0.0), p.get("sy", 0.0), p["p9"]])
    for name, (i, j) in {"Ixy": (0, 1), "Ixz": (0, 2), "Iyz": (1, 2)}.items():
        inertia[i, j] = inertia[j, i] = p.get(name, 0.0)
    with np.errstate(all="ignore"):
        # Positive definite for every body of positive density, and only then.
        density = np.trace(inertia) / 2 * np.eye(3) - inertia
        about_centre = density - np.outer(moments, moments) / p["p10"]
    if not np.all(np.isfinite(about_centre)):
        return ["the platform's parameters are too large to be judged"]
    if np.linalg.eigvalsh(about_centre)[0] < 0:
        return ["no body has the platform's mass, first moments and moments of inertia (p6…p10)"]
    return []
