"""Interruptions of a run: Ctrl-C, and the signals by which a system ends a process.

SIGTERM (`kill`, a shutdown, a queueing system) and SIGHUP (the terminal is closed) have the effect
of the first Ctrl-C, however often they come: some systems send them twice. Only a further Ctrl-C
discards the work that the first one lets finish.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from _thread import start_new_thread
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType
from typing import Any

ENDING: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals that ask a process to end."""

_DELAY = 0.01
"""s."""
_IMPORTING = "<frozen importlib._bootstrap>"


@contextmanager
def interruptible(
    note: Callable[[str], None], kept: str, abandons: str = "", abandoned: str = ""
) -> Iterator[Callable[[], bool]]:
    """Treat an interruption as a request to stop, and a further Ctrl-C as the end.

    It provides a function that returns whether to stop, in other threads than the main one always
    False, since these receive no signals. `note` receives the first message, with what is `kept`
    ("finished repetitions are kept") and what a further Ctrl-C `abandons` ("discards the design";
    empty: not mentioned), and after that one the text `abandoned`, if there is any.
    """
    stop = threading.Event()

    def say(text: str) -> None:
        # The signal may arrive within another message, and the terminal may be gone.
        with suppress(OSError, RuntimeError):
            note(text)

    def request_stop(number: int, frame: FrameType | None) -> None:
        if not stop.is_set():
            stop.set()
            say(_stop_message(number, kept, abandons))
        elif number == signal.SIGINT:
            if abandoned:
                say(abandoned)
            _interrupt(number, frame)

    with _handle_signals(request_stop, wanted=(signal.SIGINT,)):
        yield stop.is_set


def _stop_message(number: int, kept: str, abandons: str) -> str:
    """Return the message after the first interruption; it names signals other than Ctrl-C."""
    pressed = number == signal.SIGINT
    stopping = "stopping" if pressed else f"stopping, as {signal.Signals(number).name} asks"
    text = f"{stopping}: {kept}"
    if abandons:
        # Only Ctrl-C does this, also after another signal; then it was not pressed before.
        text += f"; Ctrl-C {'again ' if pressed else ''}{abandons}"
    return f"{text} …"


@contextmanager
def raise_interruptions(while_importing: Callable[[], Any]) -> Iterator[None]:
    """Let every interruption raise `KeyboardInterrupt`, not only Ctrl-C.

    An exception in code that cannot raise, such as the finaliser of an object, is raised later.
    During the import of a module `while_importing` ends the process: an exception would leave half
    a module behind, become another exception, or be lost in C code.
    """

    def raise_later(what: sys.UnraisableHookArgs) -> None:
        if issubclass(what.exc_type, KeyboardInterrupt):
            # This function cannot raise either.
            start_new_thread(_interrupt_later, ())
        else:
            before(what)

    before, sys.unraisablehook = sys.unraisablehook, raise_later
    _while_importing.append(while_importing)
    try:
        with _handle_signals(_interrupt):
            yield
    finally:
        _while_importing.remove(while_importing)
        sys.unraisablehook = before


@contextmanager
def clean_up(action: Callable[[], None]) -> Iterator[None]:
    """Call an action at the end of the context, also if the process ends during an import."""
    entry = os.getpid(), action
    _clean_ups.append(entry)
    try:
        yield
    finally:
        try:
            action()
        finally:
            _clean_ups.remove(entry)


@contextmanager
def without_interruptions() -> Iterator[None]:
    """Ignore interruptions, while the report of one is written."""
    with _handle_signals(lambda _number, _frame: None):
        yield


def has_raised() -> bool:
    """Return whether an interruption was raised as an exception in this process."""
    return _raised.is_set()


def ignore_interruptions() -> None:
    """Ignore interruptions from now on: the process is about to end with its status."""
    for number in ENDING:
        if signal.getsignal(number) is not None:
            signal.signal(number, signal.SIG_IGN)


Reaction = Callable[[int, FrameType | None], Any]


class _Handler(partial[Any]):
    """A handler of this module, which another handler of this module may replace."""


_while_importing: list[Callable[[], Any]] = []
_clean_ups: list[tuple[int, Callable[[], None]]] = []
"""With the process: a copy by `os.fork` cleans nothing up."""
_raised = threading.Event()


def _interrupt(_number: int, frame: FrameType | None) -> None:
    if _while_importing and _is_importing(frame):
        for process, action in reversed(_clean_ups):
            with suppress(Exception):
                if process == os.getpid():
                    action()
        _while_importing[-1]()
    _raised.set()
    raise KeyboardInterrupt


def _interrupt_later() -> None:
    time.sleep(_DELAY)
    main = threading.main_thread().ident
    if main is not None:
        signal.pthread_kill(main, signal.SIGINT)  # also during a system call


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether a frame is within the import of a module."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORTING:
            return True
        frame = frame.f_back
    return False


@contextmanager
def _handle_signals(react: Reaction, *, wanted: Collection[int] = ()) -> Iterator[None]:
    """Handle the signals that end a process.

    Handlers of the program stay in place, and ignored signals stay ignored, such as SIGHUP under
    `nohup`, unless the signal is `wanted`.
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
