"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""

from results.design import design_figures
from results.errors import MissingFileError, RunFolderError
from results.estimate import estimate_figures
from results.record import DesignRecord
from results.validation import validation_figures

__all__ = [
    "DesignRecord",
    "MissingFileError",
    "RunFolderError",
    "design_figures",
    "estimate_figures",
    "validation_figures",
]
