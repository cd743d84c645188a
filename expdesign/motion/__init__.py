"""The motion that a machine executes: from rest at home, through the periods, back to rest."""

from expdesign.motion.limits import check_motion
from expdesign.motion.planning import executable_motion

__all__ = ["check_motion", "executable_motion"]
