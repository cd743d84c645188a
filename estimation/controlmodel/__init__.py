"""The identified robot in a form that a controller runs: C, Python, FMU, S-function."""

FOLDER = "model"
"""Of a run folder; in it a folder for each format."""
