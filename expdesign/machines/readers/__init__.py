"""Formats that a machine is read from: one module each, with its `FORMAT`."""
