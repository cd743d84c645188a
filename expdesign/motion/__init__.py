"""The motion that a machine executes: from rest at home, through the periods, back to rest."""

from expdesign.motion.executable import ExecutableMotion, Segment
from expdesign.motion.limits import check_motion
from expdesign.motion.planning import executable_motion
from expdesign.motion.ramp import NoRampError
from expdesign.motion.record import RecordedMotion

__all__ = [
    "ExecutableMotion",
    "NoRampError",
    "RecordedMotion",
    "Segment",
    "check_motion",
    "executable_motion",
]
