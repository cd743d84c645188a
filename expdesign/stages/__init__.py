"""Stages of a run: what each needs, does and writes, and the run that does them in order."""
