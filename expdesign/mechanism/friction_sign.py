"""The signs of dry friction, which jump: exact, smoothed, or given."""

from __future__ import annotations

from enum import Enum

import casadi as ca

_STEEP = 60.0
"""Twice the share of the width from which on the smooth sign is 1 to the last digit."""


class Friction(Enum):
    """Where the signs of dry friction come from."""

    EXACT = "exact"
    """sign(rate), sign(0) = 0: simulation, recheck, every reported number."""
    SMOOTH = "smooth"
    """tanh(rate / width), the width being an input: what an optimiser can differentiate."""
    HELD = "held"
    """The signs are an input: fixed while something else is differentiated."""


def smooth_sign(rates: ca.SX) -> ca.SX:
    """Return tanh of rates, which are multiples of their widths, with an error of 1e-15 at most.

    Made of exp: the C library's tanh takes four times as long, most of the time of all limits.
    """
    return 1 - 2 / (ca.exp(ca.fmin(2 * rates, _STEEP)) + 1)
