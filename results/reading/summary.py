"""`design.json`: what the design came to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from constraints.arrays import Array
from results.reading.document import Document


@dataclass(frozen=True, eq=False)
class DesignSummary:
    """The numbers of `design.json` that results show.

    Attributes
    ----------
    criterion, scaling, status : str
    harmonics : int
    omega : float
        rad/s.
    lambda0 : (6,)
        m, rad.
    mu, nu : (6, n)
        m/s, rad/s.
    samples : int
        Samples of one period in the information.
    samples_per_period : float
        Controller steps of one period, a whole number wherever one fits the frequency's range.
    log_det_information, criterion_value : float or None
        None when the information matrix is singular.
    experiment_samples : int
    experiment_periods : float
        What the standard deviations of the experiment are predicted for.
    best_start : int or None
        The start that the design came from.
    warnings : tuple of str
    """

    criterion: str
    scaling: str
    status: str
    harmonics: int
    omega: float
    lambda0: Array
    mu: Array
    nu: Array
    samples: int
    samples_per_period: float
    log_det_information: float | None
    criterion_value: float | None
    experiment_samples: int
    experiment_periods: float
    best_start: int | None
    warnings: tuple[str, ...]

    @classmethod
    def read(cls, path: Path) -> DesignSummary:
        """Read the file; keys that are not known are left alone.

        Raises
        ------
        RunFolderError
            It is missing, no JSON, or a key is missing or of the wrong kind.
        """
        top = Document.read(path)
        experiment = top.section("predicted_std").section("experiment")
        harmonics = top.integer("harmonics")
        best = top.section("solver").optional("best_start")
        return cls(
            criterion=top.text("criterion"),
            scaling=top.text("scaling"),
            status=top.text("status"),
            harmonics=harmonics,
            omega=top.number("omega"),
            lambda0=top.array("lambda0", (6,)),
            mu=top.array("mu", (6, harmonics)),
            nu=top.array("nu", (6, harmonics)),
            samples=top.integer("samples"),
            samples_per_period=top.number("samples_per_period"),
            log_det_information=top.number_or_none("log_det_information"),
            criterion_value=top.number_or_none("criterion_value"),
            experiment_samples=experiment.integer("samples"),
            experiment_periods=experiment.number("periods"),
            best_start=None if best is None else int(best),
            warnings=tuple(str(warning) for warning in top.optional("warnings") or ()),
        )
