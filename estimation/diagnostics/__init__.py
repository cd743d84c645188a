"""Diagnosis of an estimate: residuals, tests of every assumption, and a verdict in words."""
