"""`make bench`: measure the claims that are too long for the tests, and write their tables.

Every benchmark is a module with ``TITLE``, ``rows()`` and ``summary(table)``. Its table goes to
``benchmarks/tables/<name>.md`` row by row, with the command and the date. A benchmark with
``SECTIONS`` has a table for each, ``rows(section, repetitions)``, and its sections can be named
after it: ``python benchmarks/run.py montecarlo nominal --repetitions 20``.
"""

from __future__ import annotations

import argparse
import datetime
import importlib
import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

NAMES = (
    "design_seeds",
    "condition",
    "harmonics",
    "montecarlo",
    "roundtrip",
    "departures",
    "term_selection",
    "multibody",
    "tolerances",
    "constants",
    "calls",
    "control_model",
    "screws",
    "imported",
    "own_machine",
    "payload",
    "certificate",
    "certified_robots",
    "feedforward",
    "base_parameters",
    "speed",
    "physical_consistency",
    "mutants",
    "folders",
    "kills",
