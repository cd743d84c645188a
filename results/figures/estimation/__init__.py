"""Figures of an estimate's diagnostics; each is drawn from an `ExperimentDiagnosis`."""
