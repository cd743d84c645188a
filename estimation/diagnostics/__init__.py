"""How well an estimate fits: residuals, tests of every assumption, and a verdict in words."""

from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.entry import Diagnosis, diagnose
from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.noise_analysis import NoiseAnalysis, analyse_noise
from estimation.diagnostics.verdict import Status, Verdict

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
