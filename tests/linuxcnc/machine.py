"""A hexapod under the real LinuxCNC, simulated and without a screen."""

import contextlib
import os
import pwd
import signal
import subprocess
from pathlib import Path
from tempfile import gettempdir

import numpy as np
from filelock import FileLock

INI = """[EMC]
VERSION = 1.1
MACHINE = hexapod
[DISPLAY]
DISPLAY = {folder}/play.py
MAX_FEED_OVERRIDE = 1.0
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = {folder}/machine.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = {period}
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = {folder}/machine.tbl
[HAL]
HALFILE = {folder}/machine.hal
[KINS]
KINEMATICS = genhexkins
JOINTS = 6
[TRAJ]
COORDINATES = X Y Z A B C
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
HOME = {home}
ARC_BLEND_ENABLE = 0
"""
AXIS = """[AXIS_{0}]
MIN_LIMIT = -9999
MAX_LIMIT = 9999
MAX_VELOCITY = {1}
MAX_ACCELERATION = {2}
"""
JOINT = """[JOINT_{0}]
TYPE = LINEAR
HOME = {1}
HOME_OFFSET = {1}
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
MIN_LIMIT = 1
MAX_LIMIT = 9999
MAX_VELOCITY = 1e4
MAX_ACCELERATION = 1e7
FERROR = 1
MIN_FERROR = 1
"""
HAL = """loadrt genhexkins
loadrt motmod servo_period_nsec={period} num_joints=6
addf motion-command-handler servo-thread
addf motion-controller servo-thread
net enable iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
{more}
loadrt sampler depth=60000 cfg=ffffff
addf sampler.0 servo-thread
setp sampler.0.enable 0
"""
PLAY = """#!/usr/bin/python3
import subprocess, sys, time
import linuxcnc

sys.stdout = sys.stderr = open("{folder}/play.txt", "w", buffering=1)

command, status = linuxcnc.command(), linuxcnc.stat()

def wait(done):
    while True:
        status.poll()
        if done():
            return
        time.sleep(0.01)

time.sleep(0.3)
for words in {first!r}:
    subprocess.run(words, shell=True, check=True)
command.state(linuxcnc.STATE_ESTOP_RESET); command.wait_complete()
command.state(linuxcnc.STATE_ON); command.wait_complete()
command.teleop_enable(0); command.wait_complete()
command.home(-1)
wait(lambda: all(status.homed[:6]))
sampler = subprocess.Popen(["halsampler", "{folder}/samples.txt"])
subprocess.run(["halcmd", "setp", "sampler.0.enable", "1"], check=True)
{body}
time.sleep(0.2)
status.poll()
print("still on:", status.task_state == linuxcnc.STATE_ON)
errors = linuxcnc.error_channel()
while (error := errors.poll()) is not None:
    print("error:", error[1])
sampler.terminate()
"""


# The queue is full before the first move, however busy this computer is.
AUTO = """command.mode(linuxcnc.MODE_AUTO); command.wait_complete()
command.program_open("{program}"); command.wait_complete()
command.feedrate(0.0); command.wait_complete()
command.auto(linuxcnc.AUTO_RUN, 0)
queued = -1
while queued < 0 or status.queue > queued:
    queued = status.queue
    time.sleep(0.5)
    status.poll()
command.feedrate(1.0)
time.sleep(0.2)
wait(lambda: status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and not status.queue)"""


def play(made, folder):
    """Run the G-code of an export with the limits and the geometry beside it.

    Returns the joint commands in every servo cycle from the last at rest on, (N, 6) in m.
    """
    geometry = made.path.with_suffix(".genhexkins.hal").read_text()
    nets = (f"net s{j} joint.{j}.motor-pos-cmd => joint.{j}.motor-pos-fb\n" for j in range(6))
    more = geometry + "".join(nets)
    pins = [f"net p{j} joint.{j}.pos-cmd => sampler.0.pin.{j}" for j in range(6)]
    limits = _values(made.path.with_suffix(".planner.ini"))
    samples, _ = run_linuxcnc(
        made.settings.task.robot, limits, more, pins, AUTO.format(program=made.path), folder
    )
    samples = samples / 1e3
    moved = np.flatnonzero(np.abs(np.diff(samples, axis=0)).max(axis=1) > 0)
    return samples[moved[0] : moved[-1] + 2]


def run_linuxcnc(robot, limits, hal, sampled, body, folder, first=()):
    """Home a robot and run lines of Python; return samples (N, 6) in mm and what was printed.

    The commands `first` are executed before the machine is switched on.
    """
    home = [*(1e3 * robot.home[:3]), 0, 0, 0]
    lengths = 1e3 * robot.inverse_kinematics(robot.home)
    period = limits["SERVO_PERIOD"][0]
    text = INI.format(folder=folder, period=period, home=" ".join(f"{value:.9g}" for value in home))
    axes = zip("XYZABC", limits["MAX_VELOCITY"], limits["MAX_ACCELERATION"], strict=True)
    text += "".join(AXIS.format(*axis) for axis in axes)
    text += "".join(JOINT.format(j, length) for j, length in enumerate(lengths))
    files = {
        "machine.ini": text,
        "machine.var": "",
        "machine.tbl": "",
        "machine.hal": HAL.format(period=period, more=hal) + "\n".join(sampled) + "\n",
        "play.py": PLAY.format(body=body, folder=folder, first=list(first)),
    }
    for name, content in files.items():
        (folder / name).write_text(content)
    (folder / "play.py").chmod(0o755)
    done = run_as_user(["linuxcnc", folder / "machine.ini"], folder)
    told = (folder / name for name in ("play.txt", "linuxcnc_debug.txt"))
    text = done.stdout + done.stderr + "".join(one.read_text() for one in told if one.exists())
    assert "still on: True" in text, text
    return np.loadtxt(folder / "samples.txt"), text


def _values(ini):
    """Return the values of every key of an INI file."""
    found = {}
    for line in ini.read_text().splitlines():
        key, equals, value = line.partition(" = ")
        if equals:
            found.setdefault(key, []).append(value)
    return found


def run_as_user(words, folder, **options):
    """Run a program of LinuxCNC in a folder; as nobody where this user is root."""
    if os.getuid() == 0:
        nobody = pwd.getpwnam("nobody")
        for path in (folder, *folder.rglob("*")):
            os.chown(path, nobody.pw_uid, nobody.pw_gid)
        options |= {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
        for parent in folder.parents:
            if not parent.stat().st_mode & 0o1:
                parent.chmod(parent.stat().st_mode | 0o1)
    environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "LANG": "C"}
    # A computer has one LinuxCNC at a time.
    with FileLock(Path(gettempdir()) / "linuxcnc-of-tests.lock"):
        try:
            return subprocess.run(
                words,
                cwd=folder,
                env=environment,
                check=False,
                timeout=90,
                **options,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
            )
        finally:
            _end_processes(folder)


def _end_processes(folder):
    """End what the programs left running in their folder: now and then rtapi_app stays."""
    for place in Path("/proc").glob("[0-9]*/cwd"):
        with contextlib.suppress(OSError):
            if place.resolve() == folder.resolve():
                os.kill(int(place.parent.name), signal.SIGKILL)
