"""The digital twin: simulated measurements of a designed motion, with their truth."""

from estimation.twin.experiment import Twin
from estimation.twin.truth import Truth

__all__ = ["Truth", "Twin"]
