"""Measured data: recordings, and their files in many formats."""
