"""Messages between a run and its worker processes: pickles through a pipe, lengths in front."""

from __future__ import annotations

import pickle
import struct
from typing import Any, Protocol

_LENGTH = struct.Struct("!Q")


class Pipe(Protocol):
    """An end of a pipe, without a buffer."""

    def read(self, size: int, /) -> bytes | None:
        """Return bytes that are there, at most `size`; none when the other end is closed."""

    def write(self, data: Any, /) -> int | None:
        """Write bytes, perhaps not all of them; return how many."""


def send(pipe: Pipe, message: Any) -> None:
    """Send a message.

    Raises
    ------
    OSError
        Nobody is at the other end.
    """
    data = pickle.dumps(message)
    rest = memoryview(_LENGTH.pack(len(data)) + data)
    while rest:
        rest = rest[pipe.write(rest) or 0 :]


def receive(pipe: Pipe) -> Any:
    """Wait for a message and return it.

    Raises
    ------
    EOFError
        There will be none: the other process has ended.
    """
    (length,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))
    return pickle.loads(_exactly(pipe, length))


def _exactly(pipe: Pipe, size: int) -> bytes:
    data = bytearray()
    while len(data) < size:
        part = pipe.read(size - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)
