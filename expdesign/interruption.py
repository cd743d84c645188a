"""How a run is interrupted: Ctrl-C, and the signals by which a system ends a process.

SIGTERM (`kill`, a shutdown, a queueing system) and SIGHUP (the terminal is closed) do what the
first Ctrl-C does, however often they come: some systems send them twice. Only Ctrl-C gives up what
the first one let be completed.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from _thread import interrupt_main, start_new_thread
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

ENDING = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    if hasattr(signal, name)
)
"""The signals that ask a process to end, as far as the system has them."""

_SOON = 0.01
"""s."""
_IMPORTING = "<frozen importlib._bootstrap>"


@contextmanager
def interruptible(
    note: Callable[[str], None], kept: str, abandons: str = "", abandoned: str = ""
) -> Iterator[Callable[[], bool]]:
    """Take an interruption as a request to stop, a second Ctrl-C as the end.

    Parameters
    ----------
    note : callable
        Takes what is said after the first interruption, and when a Ctrl-C follows it.
    kept : str
        What becomes of the work, for the first of these: "the repetitions that are done are kept".
    abandons : str
        What a Ctrl-C after it does, for the same: "abandons the design"; empty: nothing is said.
    abandoned : str
        What is said when a Ctrl-C follows; empty: nothing.

    Yields
    ------
    callable
        Tells whether to stop. In a thread of its own, where signals do not arrive, it never does.
    """
    stop = threading.Event()

    def say(text: str) -> None:
        # In the midst of another message there is no place for one; a terminal may be gone.
        with suppress(OSError, RuntimeError):
            note(text)

    def ask(number: int, frame: FrameType | None) -> None:
        if not stop.is_set():
            stop.set()
            say(_stopping(number, kept, abandons))
        elif number == signal.SIGINT:
            if abandoned:
                say(abandoned)
            _interrupt(number, frame)

    with _handled(ask, wanted=(signal.SIGINT,)):
        yield stop.is_set


def _stopping(number: int, kept: str, abandons: str) -> str:
    """Return what is said after the first interruption: by its name, unless it is Ctrl-C."""
    pressed = number == signal.SIGINT
    stopping = "stopping" if pressed else f"stopping, as {signal.Signals(number).name} asks"
    text = f"{stopping}: {kept}"
    if abandons:
        # Only Ctrl-C does, also after another signal; that it was not pressed before.
        text += f"; Ctrl-C {'again ' if pressed else ''}{abandons}"
    return f"{text} …"


@contextmanager
def raising(while_importing: Callable[[], Any]) -> Iterator[None]:
    """Let every interruption raise `KeyboardInterrupt`, not Ctrl-C alone.

    Not one is lost to code that cannot raise, such as the end of an object: it is raised after it.

    Parameters
    ----------
    while_importing : callable
        Ends the process: what it does while a module is being imported. An exception would leave
        half a module behind there, turn into another one, or be lost: there is code in C about it.
    """

    def again(what: UnraisableHookArgs) -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            # Not here and now: this cannot raise either.
            start_new_thread(_interrupt_soon, ())
        else:
            before(what)

    before, sys.unraisablehook = sys.unraisablehook, again
    _while_importing.append(while_importing)
    try:
        with _handled(_interrupt):
            yield
    finally:
        _while_importing.remove(while_importing)
        sys.unraisablehook = before


@contextmanager
def ignored() -> Iterator[None]:
    """Leave interruptions alone: what is interrupted has only to say so."""
    with _handled(lambda _number, _frame: None):
        yield


def has_raised() -> bool:
    """Tell whether an interruption was raised as an exception in this process."""
    return _raised.is_set()


def ignore() -> None:
    """Leave interruptions alone from now on: the process has only to end, with its status."""
    for number in ENDING:
        if signal.getsignal(number) is not None:
            signal.signal(number, signal.SIG_IGN)


Reaction = Callable[[int, FrameType | None], Any]


class _Handler:
    """A handler of ours: one that another of ours may take the place of."""

    def __init__(self, react: Reaction) -> None:
        self._react = react

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self._react(number, frame)


_while_importing: list[Callable[[], Any]] = []
_raised = threading.Event()


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _while_importing and _imports(frame):
        _while_importing[-1]()
    _raised.set()
    raise KeyboardInterrupt


def _interrupt_soon() -> None:
    time.sleep(_SOON)
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, signal.SIGINT)  # also where it waits for the system
    else:
        interrupt_main()


def _imports(frame: FrameType | None) -> bool:
    """Tell whether a module is being imported there."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            return True
        frame = frame.f_back
    return False


@contextmanager
def _handled(react: Reaction, *, wanted: Collection[int] = ()) -> Iterator[None]:
    """Handle the signals that end a process.

    Those that a program handles in its own way are left to it, and one that is ignored stays so,
    such as SIGHUP under `nohup`; but not where it is `wanted`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = (signal.SIG_DFL, signal.default_int_handler)
    before: dict[int, Any] = {}
    try:
        for number in ENDING:
            current = signal.getsignal(number)
            if number in wanted or current in usual or isinstance(current, _Handler):
                before[number] = current
                signal.signal(number, _Handler(react))
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
