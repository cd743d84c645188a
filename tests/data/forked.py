"""Readers of recordings in a copy of this process: as safe as a process of its own, and at once."""

import faulthandler
import os
import pickle
import resource
import signal
import warnings

_SECONDS = 60
_MEMORY = 8_000_000_000


def load_forked(file_format, path, section):
    """Take the place of `FileFormat._load_apart`, what a crash leads to is the same.

    It starts Python anew, which takes a second; tests of it are in test_own_process.py, and every
    format's round trip goes through it.
    """
    source, sink = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: the copy uses none
        child = os.fork()
    if child == 0:
        faulthandler.disable()  # a crash is an answer, its traceback no part of the output
        signal.alarm(_SECONDS)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _answer(file_format, path, section, sink)
    os.close(sink)
    with os.fdopen(source, "rb") as stream:
        said = stream.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        raise file_format._damaged(path, f"its library crashed ({name})")
    answer = pickle.loads(said)
    if isinstance(answer, BaseException):
        raise answer
    return answer


def _answer(file_format, path, section, sink):
    try:
        answer = file_format.load_here(path, section)
    except BaseException as error:  # noqa: BLE001 - all of it goes back to the test
        answer = error
    with os.fdopen(sink, "wb") as stream:
        stream.write(pickle.dumps(answer))
    os._exit(0)
