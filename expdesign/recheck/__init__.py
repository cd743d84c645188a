"""Checks of a motion that are independent of the optimiser, except for the graph."""
