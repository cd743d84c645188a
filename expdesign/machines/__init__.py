"""Robot file and run file of a machine that somebody has: written for the first time."""
