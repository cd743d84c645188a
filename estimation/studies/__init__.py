"""Comparisons on the digital twin: of designs, of estimators, of tests."""

from estimation.studies.design_study import DesignStudy, run_design_study
from estimation.studies.identification_study import IdentificationStudy, run_identification_study
from estimation.studies.refusal import refuse_unfit_study
from estimation.studies.validation_study import ValidationStudy, run_validation_study

__all__ = [
    "DesignStudy",
    "IdentificationStudy",
    "ValidationStudy",
    "refuse_unfit_study",
    "run_design_study",
    "run_identification_study",
    "run_validation_study",
]
