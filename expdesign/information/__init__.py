"""Fisher information and the criteria of optimality."""
