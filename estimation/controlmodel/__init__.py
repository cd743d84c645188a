"""The identified robot in a form that a controller runs: C, Python, FMU, S-function."""
