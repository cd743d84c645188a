"""The limits of a description, made ready for the graph."""

from __future__ import annotations

import itertools

import numpy as np

from constraints import Limit, LimitDefinition, limit_definitions
from expdesign.configuration import ResolvedRobot, shared_joint_pairs
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS


def robot_limits(description: ResolvedRobot) -> tuple[Limit, ...]:
    """Return the limits that are given, in the order of the catalogue.

    Pairs of struts that share a joint have no clearance to keep: their rows are left open.
    """
    definitions = limit_definitions()
    offered = {*hexapod_graph(general=False).kinematic, "actuator_force"}
    limits = []
    for key, definition in definitions.items():
        if key not in description.limits:
            continue
        given = description.limits[key]
        missing = set(definition.requires) - offered
        if missing:
            raise ValueError(f"limit '{key}' needs {', '.join(sorted(missing))}: not offered here")
        labels = row_labels(definition)
        lower = np.broadcast_to(given.lower, len(labels)).copy()
        upper = np.broadcast_to(given.upper, len(labels)).copy()
        if definition.pairs:
            for i, j in shared_joint_pairs(description):
                row = list(itertools.combinations(range(ACTUATORS), 2)).index((i, j))
                lower[row], upper[row] = -np.inf, np.inf
        limits.append(Limit(definition, lower, upper, labels, given.origin))
    return tuple(limits)


def row_labels(definition: LimitDefinition) -> tuple[str, ...]:
    """Name the rows of a limit: components, struts (from 1), pairs of struts, or nothing."""
    if definition.components:
        return definition.components
    if definition.per_actuator:
        return tuple(f"strut {j + 1}" for j in range(ACTUATORS))
    if definition.pairs:
        pairs = itertools.combinations(range(ACTUATORS), 2)
        return tuple(f"struts {i + 1}-{j + 1}" for i, j in pairs)
    return ("",)
