"""Benefit of the identified model: the twin under a position controller with feed-forward."""
