"""A run whose robot has terms beyond those of its file, as an estimate may find them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from expdesign.configuration.parameters import TermDescription, chosen_terms
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunConfiguration
from expdesign.mechanism.catalogue import TERMS
from expdesign.mechanism.term import parameters_of


def with_added_terms(
    configuration: RunConfiguration, added: Sequence[TermDescription]
) -> RunConfiguration:
    """Return the run with further terms behind those of its robot, their parameters at zero.

    Those without signs of friction come first: the load of the actuators counts them for the
    others. Terms that it has already are left alone. What an earlier estimate knew is dropped: it
    did not know of them.
    """
    present = [term.name for term in configuration.robot.terms]
    lacking = [term for term in added if term.name not in present]
    if not lacking:
        return configuration
    robot = _with_terms(configuration.robot, lacking)
    run = configuration.run.model_copy(update={"robot": robot.description})
    return replace(configuration, robot=robot, run=run)


def _with_terms(robot: ResolvedRobot, added: Sequence[TermDescription]) -> ResolvedRobot:
    about = robot.description
    described = (*about.terms, *sorted(added, key=lambda one: bool(TERMS[one.name].rates)))
    turning = about.platform_cardan_axes is not None
    terms = chosen_terms(described, about.platform, about.drive, turning=turning)
    parameters = {p.name: about.parameters.get(p.name, 0.0) for p in parameters_of(terms)}
    changes = {"terms": described, "parameters": parameters, "identification": None}
    return replace(
        robot,
        description=about.model_copy(update=changes),
        terms=terms,
        constants=tuple(c.value for term in described for c in term.constants.values()),
        parameters=parameters,
    )
