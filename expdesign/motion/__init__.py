"""The motion that a machine executes: from rest at home, through the periods, back to rest."""

from expdesign.motion.executable import ExecutableMotion, Segment

__all__ = ["ExecutableMotion", "Segment"]
