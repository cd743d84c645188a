"""How well an estimate fits: residuals, tests of every assumption, and a verdict in words."""

from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.noise_analysis import NoiseAnalysis, analyse_noise
from estimation.diagnostics.verdict import Diagnosis, Status, Verdict, diagnose

__all__ = [
    "Diagnosis",
    "ExperimentDiagnosis",
    "Finding",
    "NoiseAnalysis",
    "Outcome",
    "Status",
    "Verdict",
    "analyse_noise",
    "diagnose",
]
