"""What takes inputs from outside: for each kind how a hostile one is made, and what it is given to.

A target is a function of a folder and a random generator that makes an input there, gives it to
the program, and returns the exit status. The same seed makes the same input.
"""

import atexit
import functools
import json
import random
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from estimation.data.reading import read_measurement
from estimation.identification.result import EstimationResult
from estimation.montecarlo.result import MonteCarloResult
from estimation.twin.truth import Truth
from estimation.validation.validate import ValidationResult
from expdesign.configuration import DataSection, InputError, export_section, load_run, resolved_yaml
from expdesign.configuration.robot import load_robot_description
from expdesign.experiment import DesignResult
from expdesign.export.definition import TableError
from expdesign.export.exporting import file_name, resolve_settings
from expdesign.export.result import ExportResult
from expdesign.export.row_times import divided_times, ideal_rows, uniform_times, whole_motion
from expdesign.export.table_file import read_table_file
from expdesign.library import robot_files, run_files
from expdesign.runfolder.manifest import Manifest
from tests.data.recordings import WRITERS, recording
from tests.export.motions import task
from tests.fuzz.mutation import (
    HOSTILE,
    at,
    changed_bytes,
    changed_json,
    changed_lines,
    changed_yaml,
    places,
)
from tests.fuzz.oracle import CANARY, call, command, whole
from tests.machines.machines_of import FOLDER as MACHINES
from tests.machines.simulated import mjcf, sdf
from tests.report.html import Page
from tests.tiny_run import run_every_stage

FREE = ("title", "description", "warnings", "message", "source", "sentence", "advice", "origin")
"""Keys of records whose texts come from outside, in part."""

SECRETS = ("secret.yaml", "secret.json", "secret.csv", "secret")
RECORDS = (DesignResult, EstimationResult, ValidationResult, MonteCarloResult, Truth, Manifest)
EXPORTS = (
    *({"format": name} for name in ("csv", "pvt-csv", "xps-pvt", "pmac-pvt", "linuxcnc-gcode")),
    *({"format": name} for name in ("linuxcnc-strut", "pi-wave", "mat")),
    *({"format": "ros2", "encoding": encoding} for encoding in ("yaml", "mcap")),
)


@functools.cache
def run_folder():
    """Make a run folder with every stage, once in a process."""
    folder = Path(tempfile.mkdtemp()) / "run"
    atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
    run_every_stage(folder)
    shutil.rmtree(folder / "figures")
    return folder


# --- run and robot files --------------------------------------------------------------------------


@functools.cache
def _runs():
    shipped = [yaml.safe_load(path.read_text(encoding="utf-8")) for path in run_files().values()]
    every_key = yaml.safe_load(resolved_yaml(load_run("palida-sweep")))
    full = yaml.safe_load(resolved_yaml(load_run("palida")))
    return [*shipped, full, {**every_key, "robot": "palida"}]


@functools.cache
def _robots():
    return [yaml.safe_load(path.read_text(encoding="utf-8")) for path in robot_files().values()]


def _secrets(folder):
    """Write files that are none of ours; return their paths, which an input may name."""
    for name in SECRETS:
        text = f"- {CANARY}\n- {CANARY}: [{CANARY}\n" if name == "secret.yaml" else f"{CANARY}\n"
        (folder / name).write_text(text)
    return tuple(str(folder / name) for name in SECRETS)


def run_file(folder, rng):
    """A run file, checked."""
    hostile = (*HOSTILE, *_secrets(folder))
    path = folder / "run.yaml"
    path.write_bytes(changed_yaml(rng.choice(_runs()), rng, hostile))
    return command("check", path, *(["--json"] if rng.random() < 0.2 else []))


def robot_file(folder, rng):
    """A robot file that a run names, checked."""
    hostile = (*HOSTILE, *_secrets(folder))
    (folder / "robot.yaml").write_bytes(changed_yaml(rng.choice(_robots()), rng, hostile))
    path = folder / "run.yaml"
    path.write_text("name: fuzz\nrobot: robot.yaml\ndesign: {}\n")
    return command("check", path)


# --- recordings -----------------------------------------------------------------------------------


@functools.cache
def _recording(name):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        WRITERS[name](path, recording())
        return path.read_bytes()


@functools.cache
def _palida():
    return load_robot_description("palida")


def _read(path, rng):
    options = (
        {},
        {},
        {"decimal": ",", "delimiter": ";"},
        {"time": "stamped"},
        {"start": "10 ms"},
        {"offset": "home"},
    )
    return call(read_measurement, path, DataSection(**rng.choice(options)), _palida())


def measurement(folder, rng):
    """A recording as text."""
    content = _recording("recording.csv")
    change = rng.choice((changed_lines, changed_lines, changed_bytes))
    path = folder / "recording.csv"
    path.write_bytes(change(content, rng))
    return _read(path, rng)


def binary_recording(folder, rng, names=("mf4", "mcap", "db3", "h5", "mat")):
    """A recording in a binary format."""
    name = f"recording.{rng.choice(names)}"
    path = folder / name
    path.write_bytes(changed_bytes(_recording(name), rng))
    return _read(path, rng)


# --- controller tables ----------------------------------------------------------------------------


@functools.cache
def _table(number):
    """Return a table that was not checked, and what it was made with."""
    section = export_section(**EXPORTS[number], segment="50 ms")
    settings = resolve_settings(section, task())
    motion = settings.task.motion
    if settings.step is not None:
        times = uniform_times(motion, settings.step)
    else:
        times = divided_times(motion, [0.05] * len(motion.segments))
    times = settings.form.written_times(times, settings)
    rows = ideal_rows(settings, times)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file_name(section)
        if settings.form.whole:
            rows = replace(rows, columns=whole_motion(settings.task, times))
        settings.form.write(path, rows, settings)
        return path.name, path.read_bytes(), settings


def _given_back(path, settings):
    try:
        read_table_file(path, settings)
    except TableError as error:  # as `find_table_file` does
        raise InputError(str(error), path) from error


def table(folder, rng):
    """An exported table, given back."""
    name, content, settings = _table(rng.randrange(len(EXPORTS)))
    text = name.rpartition(".")[2] not in ("mat", "mcap")
    change = rng.choice((changed_lines, changed_bytes)) if text else changed_bytes
    path = folder / name
    path.write_bytes(change(content, rng))
    return call(_given_back, path, settings)


# --- records of a run folder ----------------------------------------------------------------------


def record(folder, rng):
    """A file of a run folder, read with the record that it is of."""
    place = folder / "run"
    shutil.copytree(run_folder(), place)
    files = sorted(p for p in place.rglob("*") if p.suffix in (".json", ".csv", ".yaml"))
    _change(rng.choice(files), rng)
    statuses = [call(kind.read, place) for kind in RECORDS]
    statuses.append(call(ExportResult.read, place / "exports" / "exports.json"))
    statuses.append(call(load_run, place / "run.yaml"))
    return max(statuses)


def report(folder, rng):
    """A run folder of which a file was changed, reported."""
    place = folder / "run"
    shutil.copytree(run_folder(), place)
    files = sorted(p for p in place.rglob("*") if p.suffix in (".json", ".csv", ".yaml"))
    _change(rng.choice(files), rng)
    status = command("report", place)
    whole_but(place, files)
    return status


def whole_but(place, files):
    """Refuse half-written files, but for those that we have damaged ourselves."""
    for path in files:
        path.unlink(missing_ok=True)
    whole(place)


MARKUP = "</script></title></style>\"'><x-evil onload=evil()>&amp;<!-- \\input{evil} $ % #_^~ {"
"""Ends whatever it stands in, where it is not written as the text that it is."""


def markup(folder, rng):
    """A run folder with HTML and LaTeX in place of some of its texts, reported."""
    place = folder / "run"
    shutil.copytree(run_folder(), place)
    for path in (*place.glob("*.json"), place / "run.yaml"):
        read, write = (json.loads, json.dumps)
        if path.suffix == ".yaml":
            read, write = yaml.safe_load, functools.partial(yaml.safe_dump, sort_keys=False)
        data = read(path.read_text(encoding="utf-8"))
        texts = [p for p in places(data) if isinstance(at(data, p), str)]
        wanted = [p for p in texts if p[-1] in FREE or any(key in FREE for key in p)]
        for *inside, key in rng.sample(wanted, min(len(wanted), rng.randint(1, 4))):
            at(data, inside)[key] = MARKUP
        path.write_text(write(data), encoding="utf-8")
    status = command("report", place)
    if status == 0:
        page = Page((place / "report.html").read_text(encoding="utf-8"))
        assert "x-evil" not in page.tags
    for path in place.rglob("*.tex"):
        assert "\\input{evil}" not in path.read_text(encoding="utf-8")
    return status


def _change(path, rng):
    content = path.read_bytes()
    change = {".json": changed_json, ".csv": changed_lines}.get(path.suffix, changed_bytes)
    path.write_bytes(change(content, rng))


# --- machines of other programs -------------------------------------------------------------------


@functools.cache
def _machines():
    from scipy.io import savemat

    found = {path.name: path.read_bytes() for path in MACHINES.iterdir() if path.suffix != ".md"}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "platform.mat"
        angle = np.arange(6) * np.pi / 3
        base = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        savemat(path, {"pos_base": base, "pos_top": 0.6 * base + [0, 0, 1], "top_mass": 10.0})
        # Its first bytes tell when it was written.
        found[path.name] = b"MATLAB 5.0 MAT-file".ljust(116) + path.read_bytes()[116:]
    return found | {"model.xml": mjcf().encode(), "model.sdf": sdf().encode()}


def machine(folder, rng, quick=False):
    """A file of another program that describes a machine, made a robot file, and that checked."""
    machines = _machines()
    names = sorted(name for name in machines if not name.endswith(".hal"))
    name = rng.choice(names)
    if quick and name == "platform.mat":  # read in a process that takes a second to start
        return 0
    path = folder / name
    path.write_bytes(rng.choice((changed_lines, changed_bytes))(machines[name], rng))
    files = [path]
    if name.endswith(".ini"):
        other = folder / "mill.hal"
        other.write_bytes(machines["mill.hal"])
        files.append(other)
        if rng.random() < 0.5:
            path.write_bytes(machines[name])
            other.write_bytes(changed_lines(machines["mill.hal"], rng))
    out = folder / "out"
    given = [word for file in files for word in ("--from", file)]
    status = command("init", "lab", *given, "--out", out, "--json")
    if status == 0:
        status = command("check", out / "lab-run.yaml")
    elif out.exists():
        assert not list(out.iterdir())
    if out.exists():
        whole(out)
    return status


TARGETS = {
    "run": run_file,
    "robot": robot_file,
    "measurement": measurement,
    "binary": binary_recording,
    "table": table,
    "record": record,
    "report": report,
    "markup": markup,
    "machine": machine,
}


def attempt(name, seed, number, folder, **options):
    """Make input `number` of a seed and give it to the program; return the exit status."""
    return TARGETS[name](folder, random.Random(f"{name} {seed} {number}"), **options)


def seeds_text(name, seed, number):
    """Return the command that does the same again."""
    return f'make soak ARGS="inputs --target {name} --seed {seed} --number {number}"'
