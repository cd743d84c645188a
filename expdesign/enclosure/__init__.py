"""Enclosures: what a motion does at every instant, proved, and not at sampled ones only."""
