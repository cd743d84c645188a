"""A run whose robot has terms beyond those of its file, as an estimate may find them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from expdesign.configuration.parameters import TermDescription, chosen_terms
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunConfiguration
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.term import parameters_of


def with_added_terms(
    configuration: RunConfiguration, added: Sequence[TermDescription]
) -> RunConfiguration:
    """Return the run with further terms of its robot, their parameters at zero.

    Those without signs of friction come before the first that has some: the load of the actuators
    counts them for the others. Terms that it has already are left alone. What an earlier estimate
    knew is dropped: it did not know of them.
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
    described = _in_order(about.terms, added)
    turning = about.platform_cardan_axes is not None
    terms = chosen_terms(described, about.platform, about.drive, turning=turning)

    def known(values: Mapping[str, float]) -> dict[str, float]:
        return {one.name: values.get(one.name, 0.0) for one in parameters_of(terms)}

    stated = {"terms": described, "parameters": known(about.parameters), "identification": None}
    return replace(
        robot,
        description=about.model_copy(update=stated),
        terms=terms,
        constants=tuple(c.value for term in described for c in term.constants.values()),
        # Those of a payload are in these, and not in what the file states.
        parameters=known(robot.parameters),
    )


def _in_order(
    own: Sequence[TermDescription], added: Sequence[TermDescription]
) -> tuple[TermDescription, ...]:
    """Return terms with further ones where they belong."""
    found = list(own)
    for term in sorted(added, key=lambda one: bool(term_definitions()[one.name].rates)):
        names = [one.name for one in found]
        place = len(names)
        if not term_definitions()[term.name].rates:
            place = next(
                (k for k, name in enumerate(names) if term_definitions()[name].rates), place
            )
        if (partner := term_definitions()[term.name].beside) in names:
            place = max(place, names.index(partner) + 1)
        found.insert(place, term)
    return tuple(found)
