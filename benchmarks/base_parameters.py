"""Base parameters of every robot that ships, against a singular value decomposition made anew.

The other way draws 10 000 states of its own, knows no limits, takes the null space from SciPy and
solves for the coefficients there. Beside the robots as they ship there are machines with further
terms, some of which say nothing new.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.configuration import load_run
from expdesign.library import robot_files
from expdesign.recheck.excitable import structural_base
from expdesign.robot import Robot, robot_from
from tests.payload import described, with_payload

TITLE = "Base parameters"
STATES, OTHER_STATES = 10_000, 1000
_ROUNDING = 1e-9
"""Relative singular value that is none: with unit columns, of 10 000 states."""
_WRONG = "wrong"
_STRIBECK = {"stribeck": {"velocity": 1e9}}
"""Friction that hardly falls with any speed: the dry one once more."""
_EVERY = (
    "drive_inertia",
    "force_offset",
    {"stribeck": {"velocity": 0.05}},
    "load_friction",
    {"cable": {"rest_length": 0.6}},
)


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each robot that ships, then for machines with further terms."""
    for name in sorted(robot_files()):
        yield _row(name, _robot(name))
    yield _row("palida, every term", _robot(described("palida", *_EVERY)))
    yield _row("palida, no gravity", _robot(described("palida") | {"gravity": [0, 0, 0]}))
    for name in ("palida", "rubin"):
        yield _row(f"{name}, stribeck at 1e9 m/s", _robot(described(name, _STRIBECK)))
    for name in ("linuxcnc", "rubin"):
        yield _row(f"{name}, general platform with a payload", with_payload(name))


def _robot(source: Any) -> Robot:
    return robot_from(load_run({"name": "n", "robot": source}).robot)


def _row(title: str, robot: Robot) -> dict[str, Any]:
    base = structural_base(robot)
    names, count = base.names, len(base.names)
    stacked = _regressors(robot, STATES, 1).reshape(-1, count)
    norms = np.linalg.norm(stacked, axis=0)
    norms[norms == 0] = 1.0
    unit = stacked / norms
    values = sla.svdvals(unit, check_finite=False)
    rank = int(np.count_nonzero(values > _ROUNDING * values[0]))
    at = [names.index(name) for name in base.base]
    left = [k for k in range(count) if k not in at]
    chosen = sla.svdvals(unit[:, at])
    # What the base parameters say the forces cannot show, in the units of the other way.
    hidden = np.zeros((count, len(left)))
    hidden[at] = -base.matrix[:, left]
    hidden[left, range(len(left))] = 1.0
    hidden *= norms[:, None]
    null = sla.null_space(np.linalg.qr(unit, mode="r"), rcond=_ROUNDING)
    same = null.shape == hidden.shape
    angle = float(np.max(sla.subspace_angles(null, hidden))) if same and left else 0.0
    solved = sla.lstsq(unit[:, at], unit[:, left])[0] if left else np.zeros((len(at), 0))
    ours = base.matrix[:, left] * np.multiply.outer(norms[at], 1 / norms[left])
    coefficients = float(np.max(np.abs(solved - ours), initial=0.0))
    forces = _force_error(robot, base.matrix, at, left)
    agrees = (
        same
        and rank == len(at)
        and chosen[-1] > _ROUNDING * chosen[0]
        and max(angle, coefficients, forces) < _ROUNDING
    )
    return {
        "machine": title,
        "parameters": count,
        "base": len(at),
        "rank of 10 000 other states": rank,
        "smallest singular value that is one": f"{values[rank - 1] / values[0]:.1e}",
        "largest that is none": f"{values[rank] / values[0]:.0e}" if rank < count else "–",
        "angle of the null spaces": f"{angle:.0e}" if left else "–",
        "coefficients differ by": f"{coefficients:.0e}" if left else "–",
        "forces differ by": f"{forces:.0e}",
        "regrouped": "; ".join(base.sentences()) or "–",
        "agrees": agrees or _WRONG,
    }


def _force_error(robot: Robot, matrix: Array, at: list[int], left: list[int]) -> float:
    """Return how much forces change, as a share of the largest, where only β stays.

    On further states, for parameters of which those left out are others, and those of the base
    follow.
    """
    rng = np.random.default_rng(2)
    first = robot.scales * rng.normal(size=len(robot.scales))
    second = first.copy()
    second[left] = robot.scales[left] * rng.normal(size=len(left))
    second[at] = matrix @ first - matrix[:, left] @ second[left]
    regressors = _regressors(robot, OTHER_STATES, 3)
    one, other = regressors @ first, regressors @ second
    return float(np.max(np.abs(one - other)) / np.max(np.abs(one)))


def _regressors(robot: Robot, count: int, seed: int) -> Array:
    """Return A of states about home, (count, 6, m): a tenth of the struts' length, 0.2 rad."""
    rng = np.random.default_rng(seed)
    length = float(np.mean(robot.inverse_kinematics(robot.home)))
    size = np.repeat([0.1 * length, 0.2], 3)
    pose = robot.home + size * rng.uniform(-1, 1, (count, 6))
    rate, acceleration = (k * size * rng.normal(size=(count, 6)) for k in (3.0, 30.0))
    return robot.regressor(pose, rate, acceleration)


def summary(table: pd.DataFrame) -> str:
    """Return for how many machines both ways agree."""
    wrong = int(np.count_nonzero(table["agrees"] == _WRONG))
    return (
        f"{len(table) - wrong} of {len(table)} machines: the same rank, null space, coefficients "
        f"and forces by both ways, within {_ROUNDING:g}. The random states of the first are 250 "
        "within the limits; the 10 000 of the other know no limits."
    )
