"""Inertia and weight of the struts: ring and stator turn about A, the slider moves along u."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import StrutKinematics
from expdesign.mechanism.term import FIRST_MOMENT_SCALE, Columns, Instant, Lump, Parameter, Term
from expdesign.mechanism.terms.rigid_platform import MASS

_ROUNDING = 0.05
"""Largest violation of p2 ≤ p3 in published tables of estimates, as a share."""

_HARMLESS = ". By so little it is harmless for the design"


def _columns(instant: Instant) -> Columns:
    forces = [generalized_force_regressor(strut, instant.gravity) for strut in instant.struts]
    torques, between = (ca.vertcat(*(each[rows, :] for each in forces)) for rows in ([0, 1], [2]))
    return Columns(torques=torques, between=between)


def generalized_force_regressor(strut: StrutKinematics, gravity: ca.SX) -> ca.SX:
    """Return the (3, 5) regressor of (τ_α, τ_β, τ_l) for p1 … p5.

    From T = ½ p1 α̇² + ½ p2 cos²β α̇² + ½ p3 β̇² + p5 l (cos²β α̇² + β̇²) and
    V = −(p4 + p5) g·u by Lagrange's equations; N·m for the angles, N for the length.
    """
    s, c, length = strut.sin_beta, strut.cos_beta, strut.length
    dalpha, dbeta, dlength = strut.alpha_rate, strut.beta_rate, strut.length_rate
    ddalpha, ddbeta = strut.alpha_acceleration, strut.beta_acceleration
    # d/dt(cos²β α̇) and sin β cos β α̇²: what p2 sees; with 2 l in front, what p5 sees as well.
    turning = c * (c * ddalpha - 2 * s * dbeta * dalpha)
    centrifugal = s * c * dalpha**2
    weight_alpha = -c * ca.dot(gravity, strut.along_alpha)
    weight_beta = -ca.dot(gravity, strut.along_beta)
    return ca.vertcat(
        ca.horzcat(
            ddalpha,
            turning,
            0,
            weight_alpha,
            weight_alpha + 2 * (length * turning + dlength * c**2 * dalpha),
        ),
        ca.horzcat(
            0,
            centrifugal,
            ddbeta,
            weight_beta,
            weight_beta + 2 * (length * (ddbeta + centrifugal) + dlength * dbeta),
        ),
        ca.horzcat(0, 0, 0, 0, -(dbeta**2 + (c * dalpha) ** 2)),
    )


def _impossible(p: Mapping[str, float]) -> list[str]:
    found = []
    if p["p2"] > p["p3"]:
        small = p["p2"] < (1 + _ROUNDING) * p["p3"]
        found.append(
            f"p2 = {p['p2']:g} exceeds p3 = {p['p3']:g} by {p['p2'] - p['p3']:.2g} kg m^2: the "
            f"struts' inertia about their axis would be negative{_HARMLESS if small else ''}"
        )
    if p["p1"] + p["p2"] < 0:
        found.append(f"p1 + p2 = {p['p1'] + p['p2']:g} is negative")
    if p.get(MASS, 0.0) > 0 and p["p2"] + p["p3"] > 0:
        least = p["p5"] * (p["p5"] / ((p["p2"] + p["p3"]) / 2)) * ACTUATORS
        if least > p[MASS]:
            found.append(
                f"six sliders with p5 = {p['p5']:g} and these moments of inertia (p2, p3) weigh "
                f"{least:.3g} kg at least, more than {MASS} = {p[MASS]:g}"
            )
    return found


def along(p: Mapping[str, float], mass: float) -> Array:
    """Return the pseudo-inertia along u of a slider with a mass in kg, (2, 2): kg m², kg m and kg.

    ½ (p2 + p3) is ∫ z² dm of stator and slider, that of the slider at most.
    """
    return np.array([[(p["p2"] + p["p3"]) / 2, p["p5"]], [p["p5"], mass]])


def _along(p: Mapping[str, float]) -> Array:
    """Return the same for a slider with the largest possible mass."""
    return along(p, p[MASS] / ACTUATORS)


def thickness(p: Mapping[str, float], slack: float = 0.0) -> Array:
    """Return ∫ x² dm of stator and slider, (1, 1), kg m²; `slack` is a share of p3."""
    return np.array([[((1 + slack) * p["p3"] - p["p2"]) / 2]])


def breadth(p: Mapping[str, float], slack: float = 0.0) -> Array:
    """Return ∫ y² dm of stator and slider with the ring's inertia about α, (1, 1), kg m².

    The triangle inequality of moments of inertia, p3 ≤ p2 + 2 p1: p1 is at least that about the
    struts' axis. `slack` is a share of p3.
    """
    return np.array([[p["p1"] + (p["p2"] - (1 - slack) * p["p3"]) / 2]])


TERM = Term(
    name="struts",
    place=10,
    meaning="inertia and weight of ring, stator and slider of the struts",
    parameters=(
        Parameter(
            "p1",
            "kg m^2",
            "$I_{zz1} + I_{yy2} + I_{zz3}$: ring about α, stator and slider about their axis",
            words="inertia of a strut about α, the part without β: ring, stator, slider",
            lower=0,
            strict=True,
        ),
        Parameter(
            "p2",
            "kg m^2",
            "$I_{xx2} + I_{xx3} - I_{yy2} - I_{zz3}$",
            words="inertia of a strut about α, the part with cos²β: stator, slider",
        ),
        Parameter(
            "p3",
            "kg m^2",
            "$I_{zz2} + I_{yy3}$",
            words="inertia of a strut about β: stator, slider",
            lower=0,
            strict=True,
        ),
        Parameter(
            "p4",
            "kg m",
            "first moment of the stator about $A$, along $u$",
            FIRST_MOMENT_SCALE,
            words="first moment of a stator: mass times its centre's distance from the base joint",
        ),
        Parameter(
            "p5",
            "kg m",
            "first moment of the slider about $B$, along $u$ (negative)",
            FIRST_MOMENT_SCALE,
            words="first moment of a slider: mass times its centre's distance from the platform "
            "joint, negative",
            upper=0,
        ),
    ),
    columns=_columns,
    impossible=_impossible,
    lumps=(
        Lump("the sliders' first moment, inertia and mass", ("p2", "p3", "p5", MASS), _along),
        Lump("the struts' moments of inertia", ("p2", "p3"), partial(thickness, slack=_ROUNDING)),
        Lump(
            "the struts' moments of inertia", ("p1", "p2", "p3"), partial(breadth, slack=_ROUNDING)
        ),
    ),
)
