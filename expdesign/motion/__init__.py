"""The motion that a machine executes: from rest at home, through the periods, back to rest."""

from expdesign.motion.executable import ExecutableMotion, Segment
from expdesign.motion.limits import check_motion
from expdesign.motion.planning import executable_motion
from expdesign.motion.ramp import NoRampError
from expdesign.motion.record import motion_from_record, motion_to_record

__all__ = [
    "ExecutableMotion",
    "NoRampError",
    "Segment",
    "check_motion",
    "executable_motion",
    "motion_from_record",
    "motion_to_record",
]
