"""Jobs of the tests of clusters, which workers import."""

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Square:
    """Result of a job."""

    number: int
    square: int


def build():
    """Return what all jobs use."""
    return 2


def slow_square(power, monitor, number, seconds):
    """Return the square of a number after a time; at once after a stop."""
    if not monitor.stop_requested():
        time.sleep(seconds)
    return Square(number, number**power)
