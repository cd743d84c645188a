"""Machine code of functions of many samples for this processor, compiled once and cached."""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np
import platformdirs

from constraints.arrays import Array
from expdesign.evaluation.block_loop import ENTRY, Lanes
from expdesign.evaluation.content import content_key
from expdesign.evaluation.vector_code import UnknownInstructionError, scratch_size, vector_code
from expdesign.progress import report_progress
from expdesign.runfolder.files import atomic_write, foreign_access, foreign_folder

VIRTUAL_MACHINE = "casadi virtual machine"
SWITCH = "EXPDESIGN_EVALUATOR"
"""Environment variable; ``virtual-machine`` disables machine code."""
CACHE = "EXPDESIGN_CACHE"
"""Environment variable: the folder of the cache instead of the user's own."""

_MOST = 256 * 2**20
"""Largest size of the cache, bytes; the entry that was unused for the longest time is removed."""
_ALIGNED = 64
"""Alignment of LLVM's vectors, bytes."""

_lock = Lock()


@dataclass(frozen=True)
class Form:
    """Shapes of a function's inputs and outputs."""

    inputs: tuple[int, ...]
    """Elements of each."""
    varying: int
    """Number of inputs, the first ones, that differ from sample to sample."""
    shapes: tuple[tuple[int, int], ...]
    """Rows and columns of every output."""
    places: tuple[tuple[int, ...], ...]
    """Places of the nonzeros of every output, row by row; only these elements are written."""

    @property
    def sizes(self) -> list[int]:
        """Elements of every output."""
        return [rows * columns for rows, columns in self.shapes]


class MachineCode:
    """A compiled function that evaluates a graph for many samples; threads may share it.

    Parameters
    ----------
    address : int
        Of the function of `vector_code`.
    form : Form
        Of the function.
    scratch : int
        Numbers of its working memory.
    """

    def __init__(self, address: int, form: Form, scratch: int) -> None:
        pointer, table = ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p)
        kinds = (table, pointer, table, ctypes.c_int64, pointer)
        self._evaluate = ctypes.CFUNCTYPE(None, *kinds)(address)
        self.form = form
        self._scratch, self._sizes = scratch, form.sizes

    def __call__(self, varying: Sequence[Array], fixed: Sequence[Array]) -> list[Array]:
        """Evaluate without checks: varying inputs (N, rows), fixed ones (rows,) → (N, elements)."""
        count = len(varying[0])
        inputs = [np.ascontiguousarray(value, dtype=np.float64) for value in varying]
        shared = np.concatenate([np.ravel(value) for value in fixed] or [np.empty(0)])
        outputs = [np.zeros((count, size)) for size in self._sizes]
        scratch = np.empty(self._scratch + _ALIGNED // 8)
        aligned = -(-scratch.ctypes.data // _ALIGNED) * _ALIGNED
        if count:
            self._evaluate(
                _addresses(inputs), shared.ctypes.data, _addresses(outputs), count, aligned
            )
        return outputs


def _addresses(arrays: Sequence[Array]) -> Any:
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))


def evaluator() -> str:
    """Return the evaluator of graphs for many samples, in words."""
    if not is_usable():
        return VIRTUAL_MACHINE
    return f"machine code for {_host()[1]} by llvmlite {version('llvmlite')}"


def kept_code(key: str) -> MachineCode | None:
    """Return the machine code that is cached under a kernel's key, or None."""
    if not is_usable():
        return None
    with _lock:
        entry = _read(_digest(key))
        content = None if entry is None else _read(entry.decode())
        return None if content is None else _load(content)


def machine_code(
    function: ca.Function, form: Form, key: str | None, *, compiling: bool
) -> MachineCode | None:
    """Return a function's machine code from the cache or, if asked, newly compiled.

    The cache finds it by its instructions, and by the kernel's key if there is one. None if it is
    neither cached nor compiled, or if this processor or an instruction is not supported.
    """
    if not is_usable():
        return None
    entry = _digest(f"{form} {function.serialize()}")
    with _lock:
        content = _read(entry)
        if content is None:
            if not compiling:
                return None
            report_progress(f"compiling {function.name()}")
            lanes = _lanes()
            try:
                text = vector_code(function, form.varying, form.places, form.sizes, lanes)
                code = _compile(text)
            except (UnknownInstructionError, RuntimeError):
                return None  # RuntimeError: LLVM's own
            scratch = scratch_size(function, form.varying, lanes)
            described = json.dumps({"form": asdict(form), "scratch": scratch})
            content = described.encode() + b"\n" + code
            _keep(entry, content)
        if key is not None:
            _keep(_digest(key), entry.encode())
        return _load(content)


def _digest(what: str) -> str:
    """Return a name in the cache for this processor and this version of the code generator."""
    described = f"{_emitter()} {_host()} {version('llvmlite')} {what}"
    return hashlib.sha256(described.encode()).hexdigest()


def is_usable() -> bool:
    """Return whether machine code is enabled, and can be compiled and loaded here."""
    return os.environ.get(SWITCH, "") != "virtual-machine" and _is_loadable()


@cache
def _is_loadable() -> bool:
    """Return whether this process compiles and loads a function without content."""
    try:
        _entry_address(_compile(f"define void @{ENTRY}() {{ ret void }}"))
    except (ImportError, OSError, RuntimeError):  # RuntimeError: LLVM's own
        return False
    return True


@cache
def _emitter() -> str:
    """Return a digest of the functions that write and call machine code."""
    return str(content_key(vector_code, scratch_size, _compile, MachineCode))


@cache
def _llvm() -> Any:
    # Loaded on first use: small evaluations do without.
    import llvmlite.binding as llvm  # noqa: PLC0415

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def _host() -> tuple[str, str, str]:
    """Return the system, the processor and the processor's features."""
    llvm = _llvm()
    features = llvm.get_host_cpu_features().flatten()
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), features


@cache
def _lanes() -> Lanes:
    """Return the lanes of one register: with more, each value takes two of the few registers."""
    return Lanes(8 if "+avx512f" in _host()[2].split(",") else 4)


@cache
def _target() -> Any:
    triple, name, features = _host()
    target = _llvm().Target.from_triple(triple)
    # Straight-line code has little to gain from more optimisation, which takes much longer.
    return target.create_target_machine(
        cpu=name, features=features, opt=1, jit=True, codemodel="jitdefault"
    )


def _compile(text: str) -> bytes:
    return bytes(_target().emit_object(_llvm().parse_assembly(text)))


_engines: list[Any] = []
"""Engines of all loaded functions: machine code lives as long as its engine."""


def _load(content: bytes) -> MachineCode:
    """Load an entry of the cache: the function's form as JSON, and its machine code."""
    described, _, code = content.partition(b"\n")
    known = json.loads(described)
    form = {key: _tuples(value) for key, value in known["form"].items()}
    return MachineCode(_entry_address(code), Form(**form), known["scratch"])


def _entry_address(code: bytes) -> int:
    """Load machine code; return the address of its function."""
    llvm = _llvm()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return int(engine.get_function_address(ENTRY))


def _tuples(value: Any) -> Any:
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value


def cache_warning() -> str:
    """Return, once, the reason why this process does not use the cache; empty without one."""
    _folder()
    return _refused.pop() if _refused else ""


_refused: list[str] = []
_own: list[Path] = []
"""Temporary folder of this process; it is used even if others may write above it."""


def _folder() -> Path:
    """Return the folder of the cache; a temporary one where other users may write to the usual one.

    Machine code runs with the rights of this user. Workers inherit the temporary folder, and it is
    removed at the end of this process.
    """
    given = os.environ.get(CACHE)
    if _own and given == str(_own[0].parent):
        return _own[0]
    root = Path(given) if given else platformdirs.user_cache_path("expdesign")
    folder = root / "kernels"
    with suppress(OSError):
        if not (reason := _unsafe(folder)):
            return folder
        own = tempfile.mkdtemp(prefix="expdesign-cache-")
        atexit.register(_remove, own, os.getpid())
        os.environ[CACHE] = own
        _own[:] = [Path(own) / "kernels"]
        _own[0].mkdir(mode=0o700)
        _refused.append(
            f"{reason}: machine code from there is not run. It is compiled again for this run; "
            f"{CACHE} may name another folder"
        )
        return _own[0]
    return folder


def _unsafe(folder: Path) -> str:
    for place in (folder.parent, folder):
        place.mkdir(parents=True, exist_ok=True, mode=0o700)
    return foreign_folder(folder)


def _remove(folder: str, process: int) -> None:
    if os.getpid() == process:  # not in a copy of it
        shutil.rmtree(folder, ignore_errors=True)


def _read(entry: str) -> bytes | None:
    """Return the content of an entry whose hash is right."""
    path = _folder() / entry
    with suppress(OSError):
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as stream:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode) or foreign_access(status):
                return None
            content = stream.read()
        digest, code = content[:32], content[32:]
        if hashlib.sha256(code).digest() == digest:
            with suppress(OSError):
                os.utime(path)
            return code
    return None


def _keep(entry: str, content: bytes) -> None:
    """Write an entry with its hash; without room on the disk the next process compiles again."""
    folder = _folder()
    with suppress(OSError):
        with atomic_write(folder / entry, 0o600) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
        used = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime)
        taken = sum(path.stat().st_size for path in used)
        while taken > _MOST:
            taken -= used[0].stat().st_size
            used.pop(0).unlink()
