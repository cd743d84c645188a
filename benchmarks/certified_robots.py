"""Every robot that ships: its default design and the motion from rest to rest, certified."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pandas as pd

import expdesign
from expdesign.configuration.loading import load_run
from expdesign.experiment import DesignResult
from expdesign.information.fisher import SingularInformationError
from expdesign.library import robot_files
from expdesign.motion import check_motion, executable_motion
from expdesign.recheck.limit_check import Recheck
from expdesign.robot import robot_from

TITLE = "Robots that ship, certified"


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each robot: what is proved of its design, and of that with its ways."""
    for robot in sorted(robot_files()):
        run = {"name": robot, "robot": robot, "design": {"seed": 0}, "workers": 2}
        result, left_out = _designed(run)
        began = time.process_time()
        motion = executable_motion(result.configuration, result.trajectory)
        planned = time.process_time()
        check = check_motion(result.configuration, motion)
        yield {
            "robot": robot,
            "left out": ", ".join(left_out) or "–",
            "status": result.status,
            "log det F": f"{result.log_det_information:.3f}",
            "shrunk to": f"{result.search.finished.shrink:.5f}",
            **_proved("design", result.check),
            **_proved("rest to rest", check),
            "ways, CPU time": f"{planned - began:.1f} s",
            "certificate, CPU time": f"{time.process_time() - planned:.2f} s",
        }


def _designed(run: dict[str, Any]) -> tuple[DesignResult, tuple[str, ...]]:
    """Return the design for all parameters that some motion shows, and the others."""
    try:
        return expdesign.design(run), ()
    except SingularInformationError as error:
        names = robot_from(load_run(run).robot).parameter_names
        left_out = tuple(error.unexcited)
        kept = [name for name in names if name not in left_out]
        return expdesign.design(run | {"design": run["design"] | {"parameters": kept}}), left_out


def _proved(what: str, check: Recheck) -> dict[str, Any]:
    closest = max(check.limits, key=lambda one: one.proved)
    return {
        f"{what}: certified": check.certified,
        f"{what}: proved excess, share of the range": f"{closest.proved:.1e} ({closest.key})",
    }


def summary(table: pd.DataFrame) -> str:
    """Return for how many everything is proved."""
    both = table["design: certified"] & table["rest to rest: certified"]
    return (
        f"{int(both.sum())} of {len(table)} robots: every limit is proved to be kept at every "
        f"instant from rest to rest. Default runs, seed 0; {load_run('palida').run.design.starts} "
        "starts each."
    )
