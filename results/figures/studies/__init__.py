"""Figures of comparisons on the digital twin: designs, estimators, validations."""
