"""Runs with every stage, killed at random moments, resumed, and compared with one that was not.

Half of the signals are SIGKILL, half SIGTERM. After each, no process of the run is left, no
traceback was written, every file is whole and the manifest is true. A run that has come to its end
in spite of all has the same files as one that was left alone, and the next begins in a new folder.
"""

import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from expdesign.configuration.robot import load_robot_description
from tests.killed_runs import contents, environment, stages, untrue

TITLE = "runs that are killed at random moments and resumed"
_COMMAND = [sys.executable, "-m", "expdesign", "run"]
_LONGEST_END = 120.0


def add_options(parser):
    parser.add_argument("--kills", type=int, default=50, help="how many signals are sent")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--longest", type=float, metavar="S", help="until a signal; half a run")
    parser.add_argument("--folder", type=Path, help="where the runs are made and left")


def run(arguments):
    place = arguments.folder or Path(tempfile.mkdtemp(prefix="expdesign-kills-"))
    place.mkdir(parents=True, exist_ok=True)
    file = place / "run.yaml"
    file.write_text(json.dumps(every_stage()), encoding="utf-8")
    began = time.monotonic()
    status, messages = _life(file, place / "alone", None, signal.SIGKILL)
    whole = time.monotonic() - began
    if status:
        print(f"the run that is left alone failed: {messages[-500:]}")
        return False
    print(f"left alone: {whole:.0f} s", flush=True)
    wanted, random_ = contents(place / "alone"), random.Random(arguments.seed)
    # No longer than half of it all: the stages that are done are kept.
    longest = arguments.longest or whole / 2
    number, wrong, ended, sent = 1, [], 0, 0
    while sent < arguments.kills or (place / f"{number}").exists():
        folder = place / f"{number}"
        last = sent >= arguments.kills
        kind = random_.choice((signal.SIGKILL, signal.SIGTERM))
        delay = None if last else random_.uniform(0, longest)
        status, messages = _life(file, folder, delay, kind)
        sent += status != 0 and not last
        found = [*_amiss(status, messages, kind), *_spoilt(folder)]
        if status == 0:
            ended += 1
            found += _differences(wanted, contents(folder))
            if not found:
                shutil.rmtree(folder)
            number += 1
        done = "" if status == 0 or not (folder / "manifest.json").is_file() else stages(folder)
        at = "not at all" if delay is None else f"after {delay:.1f} s"
        print(f"{sent} {kind.name} {at}: exit {status} {done} {found or ''}", flush=True)
        wrong += found
        if last and status:
            wrong.append(f"the run does not end: {messages[-500:]}")
            break
    print(f"{sent} signals, {ended} runs came to their end, {len(wrong)} findings")
    if not wrong and arguments.folder is None:
        shutil.rmtree(place)
    elif wrong:
        print(f"see {place}; again: make soak ARGS='kills --seed {arguments.seed}'")
    return not wrong


def every_stage():
    """Return the run: PaLiDA with the limits that are quick to build, and little of everything."""
    robot = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    for key in ("actuator_force", "jacobian_condition", "strut_clearance"):
        del robot["limits"][key]
    return {
        "name": "killed",
        "robot": robot,
        "trajectory": {
            "harmonics": 2,
            "frequency": [0.2, 0.6],
            "samples": 24,
            "controller_period": 0.01,
        },
        "design": {
            "starts": 2,
            "search": "restarts",
            "seed": 0,
            "smoothing": [0.4],
            "max_iterations": 4,
        },
        "experiment": {"sampling": 100, "periods": 3},
        "montecarlo": {"repetitions": 6, "estimators": ["ls"]},
        "estimate": {"estimators": ["ls"]},
        "validate": [{"motion": "circle", "periods": 3}],
        "export": [{"format": "xps-pvt", "segment": 0.02, "tolerance": 2e-4, "scale": 0.3}],
        "report": {"figures": ["svg"]},
        "workers": 2,
    }


def _life(file, folder, delay, kind):
    """Run until the signal, or to the end; return exit status and messages."""
    process = subprocess.Popen(
        [*_COMMAND, str(file), "--out", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    try:
        if delay is not None:
            try:
                process.wait(delay)
            except subprocess.TimeoutExpired:
                process.send_signal(kind)
        # Its workers have the same pipe: it ends with the last of them.
        limit = None if delay is None else _LONGEST_END
        _, messages = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        process.kill()
        return None, "processes of the run are left"
    return process.returncode, messages


def _amiss(status, messages, kind):
    if status is None:
        yield messages
    elif status not in (0, 1, -kind):
        yield f"exit status {status}"
    if "Traceback" in messages:
        yield f"a traceback: {messages[-1500:]}"


def _spoilt(folder):
    """Yield the files that are not whole, or not what the manifest says."""
    for path in folder.rglob("*.json"):
        try:
            json.loads(path.read_bytes())
        except ValueError:
            yield f"{path} is not whole"
    # To this one a stage may have added before its entry was written.
    yield from (
        f"{file} is not as the manifest says" for file in untrue(folder) if file != "columns.json"
    )


def _differences(wanted, found):
    for name in sorted(wanted.keys() | found.keys()):
        if wanted.get(name) != found.get(name):
            yield f"{name} differs"
