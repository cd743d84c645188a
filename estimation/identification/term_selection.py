"""The run and its recordings with the terms that the data support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Self

import numpy as np
from numpy.linalg import LinAlgError

from estimation.diagnostics.finding import Assumption, Finding
from estimation.estimators import (
    Experiment,
    ParameterEstimate,
    ParameterPriors,
    linear_estimate,
)
from estimation.identification.calibration import estimated_machine
from estimation.identification.recording import linearise_at_load, with_residual_noise
from estimation.selection import Evidence, Judge, SelectionRow, find_imitations, select
from expdesign.configuration import ComputationError, InputError, RunConfiguration
from expdesign.configuration.estimate import DEFAULT_LEVEL, SelectionCriterion, SelectSection
from expdesign.configuration.parameters import FurtherTerms, TermDescription
from expdesign.configuration.run import add_terms
from expdesign.information.identifiable import listed
from expdesign.robot import Robot, robot_from
from expdesign.runfolder import described

CAVEAT = (
    "The standard deviations and intervals of an estimate after selection are those of the model "
    "that was chosen, as if there had been no selection. They do not include that other data might "
    "have led to another model, and a weak term is chosen only if noise makes it look strong: its "
    "estimate is then too large. A term that was not chosen need not be zero."
)
"""Note on intervals after a selection."""

SAME_MOTION = (
    "periods of the fitted motion were held out: the error of the model is the same in all of "
    "them, so that terms which only imitate it are not penalised. Record another motion to detect "
    "them"
)


UNSETTLED = (
    "at the constants that were found with the terms chosen others are chosen, and so on: the last "
    "choice counts. Write the constants without estimate: true to choose at them"
)


_CAUSES = Assumption(
    "candidate terms do not imitate other effects",
    "a candidate term only imitates an effect that is not among the candidates",
    "look for the cause in the residuals; do not add the term to the robot",
)
_ROUNDS = 3
"""Largest number of selections, each at the constants found with the previous one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Selection:
    """Selection of candidates for the robot's terms."""

    by: Annotated[SelectionCriterion, described("", "criterion: bic, f or holdout")]
    level: Annotated[float | None, described("1", "of the F tests; null with other criteria")]
    candidates: Annotated[FurtherTerms, described("", "terms that were tried, as in a robot file")]
    judged: Annotated[
        FurtherTerms, described("", "the same, with the constants that they were judged at")
    ] = ()
    settled: Annotated[
        bool, described("", "false: other terms were chosen each time that constants were found")
    ] = True
    chosen: Annotated[tuple[str, ...], described("", "those that were added, in order of entry")]
    dispersion: Annotated[
        float,
        described(
            "1", "divisor of chi-square: residual variance with all candidates over the noise"
        ),
    ]
    held_out: Annotated[str, described("", "predicted data: recordings or periods, or empty")]
    steps: Annotated[tuple[SelectionRow, ...], described("", "every block that was tried")]
    caveat: Annotated[str, described("", "note on the intervals")] = CAVEAT
    bounded: Annotated[
        tuple[str, ...],
        described("", "parameters with bounds, which the choice did without, the estimate not"),
    ] = ()
    imitations: Annotated[
        tuple[str, ...],
        described(
            "",
            "chosen terms that were left out again: a lack of fit remained, and each explained "
            "less than half of it",
        ),
    ] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Finding on terms that only imitate another effect, if there are any."""
        impossible = dict.fromkeys(row.term for row in self.steps if not row.possible)
        reasons = {term: "impossible parameters" for term in impossible if term not in self.chosen}
        reasons |= dict.fromkeys(self.imitations, "a lack of fit remains")
        if not reasons:
            return ()
        words = ", ".join(f"{term} ({reason})" for term, reason in reasons.items())
        where = listed(tuple(reasons))
        return (_CAUSES.fails(f"not chosen by estimate.select: {words}", where=where),)

    @property
    def added(self) -> tuple[TermDescription, ...]:
        """The terms that were added, as in a robot file, in the order of the candidates."""
        return tuple(term for term in self.candidates if term.name in self.chosen)

    @property
    def notes(self) -> list[str]:
        """Notes on the choice in words."""
        found = [] if self.settled else [UNSETTLED]
        if self.held_out == "periods":
            found.append(SAME_MOTION)
        if self.bounded:
            found.append(
                f"the bounds of {listed(self.bounded)} (estimate.bounds) had no part in the "
                "choice: with them χ² would not be distributed as χ². The estimate keeps them, and "
                "a term that was chosen for a value beyond its bound explains less there than the "
                "choice counted on"
            )
        return found

    @property
    def warnings(self) -> list[str]:
        """The notes as warnings, after that on the intervals."""
        added = [f"estimate.select added {', '.join(self.chosen)}: {CAVEAT}"] if self.chosen else []
        return [*added, *(f"estimate.select: {note}" for note in self.notes)]

    @classmethod
    def of(
        cls,
        configuration: RunConfiguration,
        robot: Robot,
        experiments: Sequence[Experiment],
    ) -> Self | None:
        """Choose among the candidates of the run; None without any.

        If a chosen term has constants to be estimated, these are estimated with the chosen terms,
        and the selection is repeated: other terms imitate the error of a wrong constant. `robot` is
        that of the run, with whose kinematics the motions were fitted.
        """
        section = configuration.run.estimate.select
        if section is None:
            return None
        choose = partial(cls._at, configuration, robot, experiments, section)
        last = choose(hold_constants(section.candidates))
        for _ in range(1, _ROUNDS):
            if not any(c.estimate for term in last.added for c in term.constants.values()):
                return last
            machine = _found(add_terms(configuration, last.added), experiments)
            before, last = last, choose(hold_constants(section.candidates, machine))
            if set(last.chosen) == set(before.chosen):
                return last
        return replace(last, settled=False)

    @classmethod
    def _at(
        cls,
        configuration: RunConfiguration,
        robot: Robot,
        experiments: Sequence[Experiment],
        section: SelectSection,
        judged: FurtherTerms,
    ) -> Self:
        """Choose among candidates with these constants."""
        wide = robot_from(add_terms(configuration, judged).robot)
        terms = {term.name: term for term in wide.terms}
        priors = ParameterPriors.of(wide, configuration.run.estimate)
        estimated = {n for n, free in zip(priors.names, priors.free, strict=True) if free}
        blocks = {
            one.name: tuple(p.name for p in terms[one.name].parameters if p.name in estimated)
            for one in section.candidates
        }
        if nothing := [name for name, own in blocks.items() if not own]:
            raise InputError(
                f"nothing of {' and '.join(nothing)} is estimated: its parameters are fixed, or "
                "show only in combinations with others (estimate.parameters: base)",
                key="estimate.select.candidates",
                allowed="terms that say something that the robot's own do not",
            )
        unbounded = np.full(len(priors.names), np.inf)
        priors = replace(priors, lower=-unbounded, upper=unbounded)
        own = np.isin(priors.names, robot.parameter_names)
        without = replace(priors, free=priors.free & own)
        wide, loaded, found = _gauss_markov(wide, experiments, priors, without)
        # Constants of the robot's own terms may have been found, too.
        machine = estimated_machine(wide, found.systematic).robot
        if machine is not wide:
            wide, loaded = machine, tuple(each.of_robot(machine) for each in loaded)
        level = (section.level or DEFAULT_LEVEL) if section.by == "f" else None
        try:
            held = {} if found.systematic is None else found.systematic.estimates
            evidence = Evidence.of(wide, loaded, priors, found.values, blocks, held)
            needs = {
                name: partner for name in blocks if (partner := terms[name].constants_of) in blocks
            }
            judge = Judge(evidence, section.by, level or DEFAULT_LEVEL, needs)
        except LinAlgError as error:
            raise ComputationError(
                f"the recordings do not determine the robot's own parameters in addition to all "
                f"candidates of estimate.select: {error}"
            ) from error
        chosen, steps = select(judge)
        imitations = find_imitations(judge, chosen)
        held_out = "recordings" if len(loaded) > 1 else "periods"
        return cls(
            by=section.by,
            level=level,
            candidates=section.candidates,
            judged=judged,
            chosen=tuple(term for term in chosen if term not in imitations),
            imitations=imitations,
            dispersion=judge.dispersion,
            held_out=held_out if section.by == "holdout" else "",
            steps=steps,
            bounded=tuple(name for name in configuration.run.estimate.bounds if name in estimated),
        )


def _found(configuration: RunConfiguration, experiments: Sequence[Experiment]) -> Robot:
    """Return the robot of a run with its constants as GM finds them together with parameters."""
    robot = robot_from(configuration.robot)
    priors = ParameterPriors.of(robot, configuration.run.estimate)
    robot, _, found = _gauss_markov(robot, experiments, priors, priors)
    return estimated_machine(robot, found.systematic).robot


def _gauss_markov(
    robot: Robot, experiments: Sequence[Experiment], of_noise: ParameterPriors, own: ParameterPriors
) -> tuple[Robot, tuple[Experiment, ...], ParameterEstimate]:
    """Estimate the free parameters of `own`, with a noise left by those of `of_noise`."""
    present = [experiment.with_terms_of(robot) for experiment in experiments]
    robot, loaded = linearise_at_load(robot, with_residual_noise(robot, present, of_noise), own)
    return robot, loaded, linear_estimate(robot, loaded, own, "gm")


def hold_constants(
    candidates: Sequence[TermDescription], robot: Robot | None = None
) -> tuple[TermDescription, ...]:
    """Return terms with fixed constants, even those that the run would estimate.

    Terms of the robot, if one is given, get its constants. Constants of a missing force have no
    effect.
    """
    known = {} if robot is None else robot.description.constants_by_term
    return tuple(
        term.with_constants(known.get(term.name, {}), estimate=False) for term in candidates
    )
