"""File formats of measurements, one per file: each declares a ``FORMAT``."""
