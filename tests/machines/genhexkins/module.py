"""LinuxCNC's kinematics module genhexkins, its own C as its package ships it, called from here."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np

MODULE = Path("/usr/lib/linuxcnc/modules/genhexkins.so")
_HAL = Path(__file__).with_name("hal.c")
_STRUTS, _MOST_JOINTS, _COORDINATES = 6, 16, 9


class Genhexkins:
    """The module in this process: one machine at a time, in its units and degrees."""

    def __init__(self, folder):
        library = folder / "hal.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, _HAL], check=True)
        self._hal = ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
        self._hal.pin.restype = ctypes.c_void_p
        self._module = ctypes.CDLL(str(MODULE))
        assert self._module.rtapi_app_main() == 0
        self._pose = (ctypes.c_double * _COORDINATES)()
        self._joints = (ctypes.c_double * _MOST_JOINTS)()
        self._flags = (ctypes.c_ulong * 2)()
        # The first solution of the forward kinematics starts from a pose that the module remembers.
        self.pose(np.ones(_STRUTS), np.zeros(_STRUTS))

    def set(self, lines):
        """Set pins as HAL does with `setp` lines."""
        for line in lines:
            words = line.partition("#")[0].replace("=", " ").split()
            if words[:1] == ["setp"]:
                self.pin(words[1]).value = float(words[2])

    def pin(self, name):
        place = self._hal.pin(name.encode())
        assert place is not None, name
        return ctypes.c_double.from_address(place)

    def lengths(self, poses):
        """Return the joints (N, 6) for poses (N, 6): x, y, z, and A, B, C in degrees."""
        found = np.empty((len(poses), _STRUTS))
        for k, pose in enumerate(poses):
            self._pose[:] = [*pose, 0, 0, 0]
            args = (self._pose, self._joints, self._flags, self._flags)
            assert self._module.kinematicsInverse(*args) == 0
            found[k] = self._joints[:_STRUTS]
        return found

    def pose(self, lengths, guess):
        """Return the pose (6,) that it finds for joints (6,), beginning at a guess (6,)."""
        self._pose[:] = [*guess, 0, 0, 0]
        self._joints[:_STRUTS] = list(lengths)
        args = (self._joints, self._pose, self._flags, self._flags)
        self.failed = self._module.kinematicsForward(*args) != 0
        return np.array(self._pose[:_STRUTS])
