"""Functions of many samples as machine code of this processor, made once and kept in a cache."""

from __future__ import annotations

import ctypes
import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
import platformdirs
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.block_loop import ENTRY, Lanes
from expdesign.evaluation.vector_code import (
    UnknownInstructionError,
    scratch_size,
    vector_code,
)
from expdesign.progress import tell
from expdesign.runfolder.atomic import written_beside

VIRTUAL_MACHINE = "casadi virtual machine"
SWITCH = "EXPDESIGN_EVALUATOR"
"""Variable of the environment; ``virtual-machine`` leaves everything to CasADi."""
CACHE = "EXPDESIGN_CACHE"
"""Variable of the environment: the folder in place of the user's own for such things."""

_MOST = 256 * 2**20
"""Bytes that the cache takes; what was not used for the longest time is removed."""
_ALIGNED = 64
"""Bytes, as LLVM's vectors are."""

_lock = Lock()


class MachineCode:
    """A function that evaluates a graph for many samples; threads may share it.

    Parameters
    ----------
    address : int
        Of `vector_code`'s function.
    scratch : int
        Numbers that it needs to work with.
    sizes : sequence of int
        Elements of every output.
    spare : int
        Numbers that it may read and write behind each array.
    """

    def __init__(self, address: int, scratch: int, sizes: Sequence[int], spare: int) -> None:
        pointer, table = ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p)
        kinds = (table, pointer, table, ctypes.c_int64, pointer)
        self._evaluate = ctypes.CFUNCTYPE(None, *kinds)(address)
        self._scratch, self._sizes, self._spare = scratch, sizes, spare

    def __call__(self, varying: Sequence[Array], fixed: Sequence[Array]) -> list[Array]:
        """Evaluate: varying inputs as (N, rows), fixed ones as (rows,); (N, elements) come back.

        The sizes are not checked.
        """
        count = len(varying[0])
        inputs = [
            np.ascontiguousarray(value, dtype=np.float64)
            if value.shape[1] >= self._spare
            else np.append(value, np.zeros(self._spare))
            for value in varying
        ]
        shared = np.concatenate([np.ravel(value) for value in fixed] or [np.empty(0)])
        outputs = [np.zeros(count * size + self._spare) for size in self._sizes]
        scratch = np.empty(self._scratch + _ALIGNED // 8)
        aligned = -(-scratch.ctypes.data // _ALIGNED) * _ALIGNED
        if count:
            self._evaluate(
                _addresses(inputs), shared.ctypes.data, _addresses(outputs), count, aligned
            )
        return [
            output[: count * size].reshape(count, size)
            for output, size in zip(outputs, self._sizes, strict=True)
        ]


def _addresses(arrays: Sequence[Array]) -> Any:
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))


def evaluator() -> str:
    """Return what evaluates the graph for many samples, in words."""
    if not _usable():
        return VIRTUAL_MACHINE
    return f"machine code for {_host()[1]} by llvmlite {version('llvmlite')}"


def machine_code(
    function: ca.Function,
    varying: int,
    places: Sequence[NDArray[np.intp]],
    sizes: Sequence[int],
    *,
    compiling: bool,
) -> MachineCode | None:
    """Return a function's machine code, from the cache or, if asked, newly compiled.

    None where it is not in the cache, where it is not wanted or where it cannot be.

    Parameters
    ----------
    function, varying, places, sizes
        See `vector_code`.
    compiling : bool
        Whether to make it where the cache does not have it.
    """
    if not _usable():
        return None
    rows = [place.tolist() for place in places]
    described = f"{_emitter()} {_host()} {version('llvmlite')} {varying} {rows} {list(sizes)}"
    digest = hashlib.sha256(described.encode() + function.serialize().encode())
    key = digest.hexdigest()
    with _lock:
        code = _read(key)
        if code is None:
            if not compiling:
                return None
            tell(f"compiling {function.name()}")
            try:
                code = _compiled(vector_code(function, varying, rows, sizes, _lanes()))
            except (UnknownInstructionError, RuntimeError):
                return None  # RuntimeError: LLVM's own
            _keep(key, code)
        scratch = scratch_size(function, varying, _lanes())
        return MachineCode(_loaded(code), scratch, sizes, _lanes().count)


def _usable() -> bool:
    """Tell whether machine code is wanted, and can be made for this processor."""
    if os.environ.get(SWITCH, "") == "virtual-machine":
        return False
    try:
        _target()
    except (ImportError, OSError, RuntimeError):
        return False
    return True


@cache
def _emitter() -> str:
    """Return a hash of what writes the code: what another version wrote is another code."""
    folder = Path(__file__).parent
    sources = [(folder / name).read_bytes() for name in ("vector_code.py", "block_loop.py")]
    return hashlib.sha256(b"".join(sources)).hexdigest()


@cache
def _llvm() -> Any:
    # Only who evaluates much waits for it.
    import llvmlite.binding as llvm  # noqa: PLC0415

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def _host() -> tuple[str, str, str]:
    """Return system, processor and what the processor can do."""
    llvm = _llvm()
    features = llvm.get_host_cpu_features().flatten()
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), features


@cache
def _lanes() -> Lanes:
    """Return as many as a register holds: with more, a value takes two of the few there are."""
    return Lanes(8 if "+avx512f" in _host()[2].split(",") else 4)


@cache
def _target() -> Any:
    triple, name, features = _host()
    target = _llvm().Target.from_triple(triple)
    # Straight-line code has little to gain from more optimisation, which takes much longer.
    return target.create_target_machine(
        cpu=name, features=features, opt=1, jit=True, codemodel="jitdefault"
    )


def _compiled(text: str) -> bytes:
    return bytes(_target().emit_object(_llvm().parse_assembly(text)))


_engines: list[Any] = []
"""Machine code lives as long as what it was loaded with, and may be called until the end."""


def _loaded(code: bytes) -> int:
    """Load machine code; return the address of `ENTRY`."""
    llvm = _llvm()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return int(engine.get_function_address(ENTRY))


def _folder() -> Path:
    given = os.environ.get(CACHE)
    return (Path(given) if given else platformdirs.user_cache_path("expdesign")) / "kernels"


def _read(key: str) -> bytes | None:
    path = _folder() / key
    with suppress(OSError):
        content = path.read_bytes()
        digest, code = content[:32], content[32:]
        if hashlib.sha256(code).digest() == digest:
            with suppress(OSError):
                os.utime(path)
            return code
    return None


def _keep(key: str, code: bytes) -> None:
    """Write machine code into the cache, with its hash; without room it is made again next time."""
    folder = _folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with written_beside(folder / key) as beside:
            beside.write_bytes(hashlib.sha256(code).digest() + code)
        used = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime)
        taken = sum(path.stat().st_size for path in used)
        while taken > _MOST:
            taken -= used[0].stat().st_size
            used.pop(0).unlink()
