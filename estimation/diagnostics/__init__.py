"""How well an estimate fits: residuals, tests of every assumption, and a verdict in words."""

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Finding, Outcome, Status, Verdict
from estimation.diagnostics.noise_analysis import analyse_noise
from estimation.diagnostics.record import Diagnosis, ExperimentDiagnosis

__all__ = [
    "Diagnosis",
    "ExperimentDiagnosis",
    "Finding",
    "Outcome",
    "Status",
    "Verdict",
    "analyse_noise",
    "diagnose",
]
