"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""

from results.design import design_figures
from results.errors import MissingFileError, RunFolderError
from results.record import DesignRecord
from results.study import study_figures
from results.study_record import StudyRecord

__all__ = [
    "DesignRecord",
    "MissingFileError",
    "RunFolderError",
    "StudyRecord",
    "design_figures",
    "study_figures",
]
