"""Checks of a motion that share nothing with the optimiser but the graph."""
