"""A format whose library does what damaged files make libraries do; the file says what."""

import os
import signal
import sys
import time

import numpy as np

from estimation.data.formats import FileFormat
from estimation.data.table import RawTable, RecordedColumn


def read(path, section):
    match path.read_text():
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            time.sleep(60)
        case "hoard":
            np.ones(10**12)
        case "exit":
            sys.exit(3)
        case "chat":
            print("a library that prints")  # noqa: T201 - that is the point
            os.write(1, b"and writes")
    return RawTable(path, {"t": np.arange(3.0)}, {"t": RecordedColumn("t", "t")})


FORMAT = FileFormat(title="unruly", extensions=(), read=read, may_crash=True)
