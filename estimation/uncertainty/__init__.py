"""Uncertainty of estimates: intervals, differences, and physical consistency."""
