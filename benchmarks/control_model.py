"""Control models on ten thousand states: compiled by two compilers in two precisions, and run.

States are random within the robot's limits, with struts and cardan joints that slide by 1 mm/s at
least and no joint that locks: nearer to zero a sign of dry friction may be another one in single
precision, and where a joint locks what rests on its turn grows without bound.
"""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
import numpy as np
import pandas as pd
from fmpy.validation import validate_fmu

import expdesign
from constraints.arrays import Array
from estimation.controlmodel.formats import FLAGS, FORMATS, build, run_self_test
from estimation.controlmodel.model import ControlModel, random_states
from expdesign.mechanism.hexapod import POSE, actuator_names
from tests.controlmodel.machines import ORIGIN, every_term

TITLE = "Control models against the robot's own forces"

_STATES, _SEED = 10_000, 1
_PRECISIONS = {"double": (), "float": ("-DEXPDESIGN_FLOAT",)}
_LIMIT, _WITHIN = 230.0, "these at most"
"""Of PaLiDA's actuators, N: states that random accelerations take beyond it are told apart."""
_CALLED = ("pose", "rate", "acceleration")


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each robot, format, compiler and precision."""
    robots = {"palida": expdesign.load_robot("palida"), "every term, on threads": every_term()}
    for name, robot in robots.items():
        model = ControlModel(robot, ORIGIN, 0.0)
        states = np.split(random_states(robot, _STATES, _SEED), 3, axis=1)
        expected = robot.actuator_forces(*states)
        with TemporaryDirectory() as place:
            for row in _rows(model, Path(place), states, expected):
                yield {"robot": name, **row}


def _rows(
    model: ControlModel, folder: Path, states: list[Array], expected: Array
) -> Iterator[dict[str, Any]]:
    FORMATS["c"].make(model, folder)
    for compiler in filter(shutil.which, ("gcc", "clang")):
        for precision, flags in _PRECISIONS.items():
            source, test = f"{model.prefix}.c", f"{model.prefix}_selftest.c"
            library, program = (folder / f"{compiler}-{precision}{end}" for end in (".so", ""))
            build(compiler, folder, [source], str(library), "-shared", "-fPIC", *flags)
            build(compiler, folder, [source, test], str(program), *flags)
            timed = run_self_test([str(program)], folder, precision, compiler)
            found, status = _by_library(library, model.prefix, precision, states)
            yield {
                "made by": f"{compiler} {' '.join(FLAGS[:2])}",
                "precision": precision,
                **_deviation(found, expected),
                "status": "ok" if not np.any(status) else f"{np.count_nonzero(status)} failed",
                **{
                    f"call, us: {key}": f"{1e6 * value:.3g}"
                    for key, value in (
                        ("median", timed.median or np.nan),
                        ("99.9 %", timed.most or np.nan),
                        ("longest", timed.worst or np.nan),
                    )
                },
            }
    yield _row("NumPy", _by_module(model, folder, states), expected, "ok")
    yield _row("FMU in fmpy", *_by_fmu(model, folder, states, expected))


def _row(name: str, found: Array, expected: Array, status: str) -> dict[str, Any]:
    times = {f"call, us: {key}": "" for key in ("median", "99.9 %", "longest")}
    return {
        "made by": name,
        "precision": "double",
        **_deviation(found, expected),
        "status": status,
        **times,
    }


def _deviation(found: Array, expected: Array) -> dict[str, Any]:
    off, largest = (np.max(np.abs(each), axis=1) for each in (found - expected, expected))
    within = largest <= _LIMIT
    return {
        "states": len(off),
        "largest force, N": f"{np.max(largest):.0f}",
        "off by, N: median": f"{np.median(off):.1e}",
        "at most": f"{np.max(off):.1e}",
        f"of those within {_LIMIT:.0f} N": int(np.count_nonzero(within)),
        _WITHIN: f"{np.max(off[within]):.1e}",
    }


def _by_library(
    library: Path, prefix: str, precision: str, states: list[Array]
) -> tuple[Array, Array]:
    kind = np.dtype(np.float64 if precision == "double" else np.float32)
    given = [np.ascontiguousarray(part, kind) for part in states]
    found, status = np.empty_like(given[0]), np.zeros(len(given[0]))
    function: Callable[..., int] = getattr(ctypes.CDLL(str(library)), f"{prefix}_forces")
    for k in range(len(found)):
        status[k] = function(*(ctypes.c_void_p(part[k].ctypes.data) for part in (*given, found)))
    return found.astype(np.float64), status


def _by_module(model: ControlModel, folder: Path, states: list[Array]) -> Array:
    FORMATS["python"].make(model, folder)
    path = folder / f"{model.prefix}.py"
    spec = importlib.util.spec_from_file_location(model.prefix, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: Array = module.forces(*states)
    return found


def _by_fmu(
    model: ControlModel, folder: Path, states: list[Array], expected: Array
) -> tuple[Array, Array, str]:
    made = FORMATS["fmu"].make(model, folder)
    (name,) = made.files
    path = folder / name
    path.write_bytes(made.files[name])
    problems = validate_fmu(str(path))
    named = [f"{key}.{coordinate.name}" for key in _CALLED for coordinate in POSE]
    given = np.zeros(len(expected), dtype=[("time", float), *((n, float) for n in named)])
    given["time"] = np.arange(len(given))
    for column, values in zip(named, np.hstack(states).T, strict=True):
        given[column] = values
    steps = {"stop_time": len(given), "step_size": 1, "output_interval": 1}
    outputs = [f"forces[{j}]" for j in range(1, len(actuator_names("")) + 1)]
    result = fmpy.simulate_fmu(str(path), input=given, output=outputs, **steps)
    # What is given at the beginning of a step is there at its end.
    found = np.stack([result[each] for each in outputs], axis=1)[1:]
    return found, expected, "valid" if not problems else "; ".join(problems)


def summary(table: pd.DataFrame) -> str:
    """Return the worst of each precision."""
    worst = table.assign(off=table[_WITHIN].astype(float)).groupby("precision")["off"].max()
    flags = " ".join(FLAGS)
    return (
        f"all compiled with {flags}; where they keep {_LIMIT:.0f} N, forces are off by "
        f"{worst['double']:.1e} N at most in double and {worst['float']:.1e} N in single "
        "precision. The longest calls are those that another process interrupted"
    )
