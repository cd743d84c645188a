"""`identification:` of a robot file that an estimate wrote: how its values are known."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.errors import refusal
from expdesign.configuration.fields import LONGEST_NAME, Text, at_least, one_of
from expdesign.configuration.quantity import NotNegative, Number
from expdesign.configuration.section import Section

IDENTIFIED_ROBOT = "identified-robot.yaml"
"""The robot that an estimate found, in its run folder."""

IDENTIFIED = "-identified"
"""What the name of a robot ends in that an estimate found."""

JudgedAs = Literal["accepted", "doubtful", "not judged"]

Matrix = tuple[tuple[Number, ...], ...]


def machine_name(robot: str) -> str:
    """Return the name of the machine that a robot describes: its own, however it was identified."""
    return robot.removesuffix(IDENTIFIED)


def identified_name(robot: str) -> str:
    """Return the name of the robot that an estimate of this one found; of a long one, its own."""
    name = machine_name(robot) + IDENTIFIED
    return name if len(name) <= LONGEST_NAME else robot


class IdentifiedDeviation(Section):
    """One number that was not known exactly, SI."""

    name: Text
    """As in tables/deviations.csv."""
    tolerance: Annotated[Number, NotNegative]
    value: Number
    """Estimate, which the robot's geometry, gravity and constants have in them; zero where it was
    not estimated."""
    std: Annotated[Number, NotNegative]


class Identification(Section):
    """Where the robot's parameters come from, and their covariance, SI."""

    run: Text
    """Name of the run."""
    estimator: Text
    verdict: Annotated[JudgedAs, one_of(JudgedAs)]
    summary: Text = ""
    """The verdict in words."""
    parameters: Annotated[tuple[Text, ...], at_least(1, "parameters")]
    """Order of rows and columns."""
    constants: tuple[Text, ...] = ()
    """Constants of terms that were estimated with the parameters, ``cogging_pitch``: their rows and
    columns follow those of the parameters. c of them."""
    unconstrained: tuple[Number, ...] = ()
    """The estimate itself, where the robot's parameters are the nearest that bodies have."""
    covariance_random: Matrix
    """(m + c) × (m + c): what another recording of the machine draws anew."""
    covariance_systematic: Matrix
    """(m + c) × (m + c): what all recordings of the machine share."""
    deviations: tuple[IdentifiedDeviation, ...] = ()
    """What the systematic share comes from."""
    response: Matrix = ()
    """(m + c) × t: what parameters and constants are off by per unit of each deviation."""

    @model_validator(mode="after")
    def _sizes_fit(self) -> Identification:
        count, others = len(self.parameters), len(self.deviations)
        if len(self.unconstrained) not in (0, count):
            reason = "unconstrained does not fit the parameters"
            raise refusal(reason, f"{count} numbers", key="unconstrained")
        count += len(self.constants)
        for key, rows, columns in (
            ("covariance_random", count, count),
            ("covariance_systematic", count, count),
            ("response", count if others else 0, others),
        ):
            matrix = getattr(self, key)
            if len(matrix) != rows or any(len(row) != columns for row in matrix):
                reason = f"{key} does not fit the parameters, constants and deviations"
                raise refusal(reason, f"{rows} rows of {columns} numbers", key=key)
        return self

    @property
    def warnings(self) -> list[str]:
        """What is to be known where the robot is used."""
        if self.verdict == "accepted":
            return []
        words = f" ({self.summary})" if self.summary else ""
        return [
            f"the parameters come from the estimate of the run {self.run}, which is "
            f"{self.verdict}{words}"
        ]
