"""A hexapod under the real LinuxCNC, simulated and without a screen."""

import os
import pwd
import subprocess
from dataclasses import dataclass

import numpy as np

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
HALFILE = LIB:basic_sim.tcl -no_use_hal_manualtoolchange -no_sim_spindle -no_simulated_home
HALFILE = {folder}/geometry.hal
HALFILE = {folder}/sample.hal
[KINS]
KINEMATICS = genhexkins
JOINTS = 6
[TRAJ]
COORDINATES = X Y Z A B C
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
HOME = {home}
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
FERROR = 1000
MIN_FERROR = 1000
"""
SAMPLE = """loadrt sampler depth=60000 cfg=ffffff
addf sampler.0 servo-thread
setp sampler.0.enable 0
"""
PLAY = """#!/usr/bin/python3
import subprocess, time
import linuxcnc

command, status = linuxcnc.command(), linuxcnc.stat()

def wait(done):
    while True:
        status.poll()
        if done():
            return
        time.sleep(0.01)

time.sleep(0.3)
command.state(linuxcnc.STATE_ESTOP_RESET); command.wait_complete()
command.state(linuxcnc.STATE_ON); command.wait_complete()
command.teleop_enable(0); command.wait_complete()
command.home(-1)
wait(lambda: all(status.homed[:6]))
command.mode(linuxcnc.MODE_AUTO); command.wait_complete()
command.program_open("{program}"); command.wait_complete()
sampler = subprocess.Popen(["halsampler", "{folder}/samples.txt"])
subprocess.run(["halcmd", "setp", "sampler.0.enable", "1"], check=True)
command.auto(linuxcnc.AUTO_RUN, 0)
time.sleep(0.2)
wait(lambda: status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and not status.queue)
time.sleep(0.2)
errors = linuxcnc.error_channel()
while (error := errors.poll()) is not None:
    print("error:", error[1])
sampler.terminate()
"""


@dataclass(frozen=True)
class Played:
    """Joint commands in every servo cycle from the last at rest on, (N, 6) in m, and messages."""

    lengths: np.ndarray
    messages: str


def play(made, folder):
    """Run the G-code of an export on its robot, with the limits and the geometry beside it."""
    robot, limits = made.settings.task.robot, made.path.with_suffix(".planner.ini")
    home = [*(1e3 * robot.home[:3]), 0, 0, 0]
    lengths = 1e3 * robot.inverse_kinematics(robot.home)
    values = _values(limits)
    text = INI.format(
        folder=folder,
        period=values["SERVO_PERIOD"][0],
        home=" ".join(f"{value:.9g}" for value in home),
    )
    axes = zip("XYZABC", values["MAX_VELOCITY"], values["MAX_ACCELERATION"], strict=True)
    text += "".join(AXIS.format(*axis) for axis in axes)
    text += "".join(JOINT.format(j, length) for j, length in enumerate(lengths))
    nets = (f"net s{j} joint.{j}.pos-cmd => sampler.0.pin.{j}\n" for j in range(6))
    files = {
        "machine.ini": text,
        "machine.var": "",
        "machine.tbl": "",
        "geometry.hal": made.path.with_suffix(".genhexkins.hal").read_text(),
        "sample.hal": SAMPLE + "".join(nets),
        "play.py": PLAY.format(program=made.path, folder=folder),
    }
    for name, content in files.items():
        (folder / name).write_text(content)
    (folder / "play.py").chmod(0o755)
    done = run_as_user(["linuxcnc", folder / "machine.ini"], folder)
    text = done.stdout + done.stderr
    samples = np.loadtxt(folder / "samples.txt") / 1e3
    moved = np.flatnonzero(np.abs(np.diff(samples, axis=0)).max(axis=1) > 0)
    return Played(samples[moved[0] : moved[-1] + 2], text)


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
    return subprocess.run(
        words,
        cwd=folder,
        env=environment,
        check=False,
        timeout=120,
        **options,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
