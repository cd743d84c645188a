"""A true machine drawn from the tolerances of the robot: what it is and how it is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.configuration.sections.experiment import ForceConstantError
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, as_in_a_file, deviated, deviations, tolerated


@dataclass(frozen=True, eq=False)
class DrawnMachine:
    """A machine that deviates from the run's."""

    configuration: RunConfiguration
    """The run whose true machine it is: `Twin.of` takes it. Its robot is the run's still."""
    deviations: tuple[Deviation, ...]
    """What was drawn: every entry that has a tolerance."""
    values: Array
    """(t,), what each is off by, SI."""


def drawn_machine(configuration: RunConfiguration, rng: np.random.Generator) -> DrawnMachine:
    """Draw what the robot's tolerances leave open, from independent normal distributions.

    The deviations come to those that the run states: to the joints, gravity and constants of its
    true machine (`experiment.truth`, or the robot), and to `strut_length`, `force_constant`,
    `delay` and `clock` of its `experiment`. Parameters and noise are the true machine's.

    Parameters
    ----------
    configuration : RunConfiguration
        With `tolerances` of its robot.
    rng : numpy.random.Generator
    """
    base = configuration.truth or configuration.robot
    robot = Robot(replace(base, tolerances=configuration.robot.tolerances))
    entries = tolerated(robot)
    values = rng.standard_normal(len(entries)) * np.array([each.std for each in entries])
    theta = np.zeros(len(deviations(robot)))
    theta[[each.place for each in entries]] = values
    off: dict[str, list[float]] = {}
    for entry, value in zip(deviations(robot), theta.tolist(), strict=True):
        off.setdefault(entry.group, []).append(value)
    section = configuration.run.experiment
    error = section.force_constant or ForceConstantError()
    (common,) = off["force_constant.common"]
    each = zip(error.each, off["force_constant.each"], strict=True)
    constants = {
        "common": _product(error.common, common),
        "each": tuple(_product(stated, drawn) for stated, drawn in each),
    }
    truth = replace(deviated(robot, entries, values).description, tolerances=base.tolerances)
    described = as_in_a_file(truth)
    measured = configuration.with_section(
        "experiment",
        truth=described,
        strut_length=tuple(np.add(section.strut_length, off["strut_length"]).tolist()),
        force_constant=error.model_copy(update=constants),
        delay=section.delay + sum(off["delay"]),
        clock=section.clock + sum(off["clock"]),
    )
    truth = replace(truth, description=described)
    return DrawnMachine(replace(measured, truth=truth), entries, values)


def _product(stated: float, drawn: float) -> float:
    return (1 + stated) * (1 + drawn) - 1
