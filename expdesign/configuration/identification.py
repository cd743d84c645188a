"""`identification:` of a robot file from an estimate: origin and covariance of its values."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from expdesign.configuration.errors import refusal
from expdesign.configuration.fields import LONGEST_NAME, Text, at_least, one_of
from expdesign.configuration.quantity import NotNegative, Number
from expdesign.configuration.section import Section

IDENTIFIED_ROBOT = "identified-robot.yaml"
"""File of the estimated robot in a run folder."""

IDENTIFIED = "-identified"
"""Suffix of the name of an estimated robot."""

JudgedAs = Literal["accepted", "doubtful", "not judged"]

Matrix = tuple[tuple[Number, ...], ...]


def machine_name(robot: str) -> str:
    """Return the name of the machine for that of a robot, identified or not.

    Examples
    --------
    >>> machine_name("lab-identified")
    'lab'
    """
    return robot.removesuffix(IDENTIFIED)


def identified_name(robot: str) -> str:
    """Return the name for an estimate of a robot; the robot's name if it would become too long.

    Examples
    --------
    >>> identified_name("lab")
    'lab-identified'
    """
    name = machine_name(robot) + IDENTIFIED
    return name if len(name) <= LONGEST_NAME else robot


class IdentifiedDeviation(Section):
    """A quantity with a tolerance, SI."""

    name: Text
    """As in tables/deviations.csv."""
    tolerance: Annotated[Number, NotNegative]
    value: Number
    """Estimate, already applied to the robot's geometry, gravity and constants; zero if it was not
    estimated."""
    std: Annotated[Number, NotNegative]


class Identification(Section):
    """Origin of the robot's parameters, and their covariance, SI."""

    run: Text
    """Name of the run."""
    estimator: Text
    verdict: Annotated[JudgedAs, one_of(JudgedAs)]
    summary: Text = ""
    """The verdict in words."""
    parameters: Annotated[tuple[Text, ...], at_least(1, "parameters")]
    """Order of rows and columns."""
    constants: tuple[Text, ...] = ()
    """Constants of terms, estimated with the parameters: ``cogging_pitch``. Their c rows and
    columns follow those of the parameters."""
    unconstrained: tuple[Number, ...] = ()
    """Estimate before the projection to the nearest physically consistent parameters."""
    covariance_random: Matrix
    """(m + c) × (m + c): random share, new in every recording of the machine."""
    covariance_systematic: Matrix
    """(m + c) × (m + c): systematic share, common to all recordings of the machine."""
    deviations: tuple[IdentifiedDeviation, ...] = ()
    """Sources of the systematic share."""
    response: Matrix = ()
    """(m + c) × t: errors of parameters and constants per unit of each deviation."""

    @model_validator(mode="after")
    def _check_sizes(self) -> Identification:
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
        """Warnings for the use of the robot."""
        if self.verdict == "accepted":
            return []
        words = f" ({self.summary})" if self.summary else ""
        return [
            f"the parameters come from the estimate of the run {self.run}, which is "
            f"{self.verdict}{words}"
        ]
