"""Levels of the tests: the share of sound experiments that each family of them may reject."""

from __future__ import annotations

LACK_OF_FIT = 0.01
"""Over the six actuators."""
COLUMNS = 0.01
"""Over all columns."""
POSITION_PERIODIC = 0.001
"""Over six struts and all pitches."""
DELAY = 0.01
NOISE = 0.001
"""Each of whiteness, normality, outliers and drift, over six channels. Long records show what
matters beyond any doubt; what they hardly show need not alarm anybody."""
CHI_SQUARE = 0.001
"""Over both tails of forces and lengths."""
