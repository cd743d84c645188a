"""How well an estimate fits: residuals, tests of every assumption, and a verdict in words."""
