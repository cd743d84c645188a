"""Fisher information and the criteria that judge it."""
