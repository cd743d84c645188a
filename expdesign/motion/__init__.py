"""The motion that a machine executes: from rest at home, through the periods, back to rest."""

from typing import TYPE_CHECKING

from expdesign.loading import names_loaded_when_used

if TYPE_CHECKING:
    from expdesign.motion.planning import executable_motion
    from expdesign.motion.ramp_problem import check_motion

__all__ = ["check_motion", "executable_motion"]

# Modules of motions are used by what neither plans nor proves one.
__getattr__ = names_loaded_when_used(
    __name__,
    {
        "check_motion": "expdesign.motion.ramp_problem",
        "executable_motion": "expdesign.motion.planning",
    },
)
