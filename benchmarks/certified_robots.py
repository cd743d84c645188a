"""Every robot that ships: its default design and the motion from rest to rest, certified.

What is proved is held against what is found: by a million samples of the motion, one period of the
periods, and by local searches from a thousand instants of each of its segments for every limit.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

import expdesign
from constraints.arrays import Array
from expdesign.configuration.loading import load_run
from expdesign.experiment import DesignResult
from expdesign.information.fisher import SingularInformationError
from expdesign.library import robot_files
from expdesign.motion.executable import ExecutableMotion, Periods, Segment, moving_states
from expdesign.motion.planning import check_motion, executable_motion, jerk_limit
from expdesign.recheck.limit_check import Recheck
from expdesign.robot import LimitModel, robot_from

TITLE = "Robots that ship, certified"
POINTS, CENTERS = 1_000_000, 1000
_BLOCK, _LOCAL, _ROUNDS = 25_000, 9, 8
_ROUNDED = 1e-11
"""Of a sampled value, as a share of a limit's range."""
_ABOVE = "found above proved, at most"


def rows() -> Iterator[dict[str, Any]]:
    """Yield a row for each robot: what is proved of its design, and of that with its ways."""
    for robot in sorted(robot_files()):
        run = {"name": robot, "robot": robot, "design": {"seed": 0}, "workers": 2}
        result, left_out = _designed(run)
        began = time.process_time()
        motion = executable_motion(result.configuration, result.trajectory)
        planned = time.process_time()
        check = check_motion(result.configuration, motion)
        judged = time.process_time()
        orbit = Periods(motion.trajectory, motion.periods)
        jerk = jerk_limit(result.configuration, result.robot, orbit)
        found = _found(LimitModel.of(result.robot, jerk), motion)
        proved = np.array([one.proved for one in check.limits])
        yield {
            "robot": robot,
            "left out": ", ".join(left_out) or "–",
            "status": result.status,
            "log det F": f"{result.log_det_information:.3f}",
            "shrunk to": f"{result.solver.finish['shrink']:.5f}",
            **_proved("design", result.check),
            **_proved("rest to rest", check),
            "ways, CPU time": f"{planned - began:.1f} s",
            "certificate, CPU time": f"{judged - planned:.2f} s",
            _ABOVE: f"{np.max(found - proved):.1e}",
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


def _found(limits: LimitModel, motion: ExecutableMotion) -> Array:
    """Return the largest excess over each limit, (L,), that sampling and local searches find."""
    return np.max([_searched(limits, one, len(motion.segments)) for one in motion.segments], axis=0)


def _searched(limits: LimitModel, segment: Segment, parts: int) -> Array:
    duration = segment.trajectory.period if isinstance(segment, Periods) else segment.duration

    def excess(times: Array) -> Array:
        rows = limits.violations(moving_states(segment, times))
        return np.stack([np.max(rows[:, columns], axis=1) for columns in limits.columns], axis=1)

    times = np.linspace(0.0, duration, POINTS // parts)
    blocks = np.array_split(times, len(times) // _BLOCK)
    worst = np.max([np.max(excess(block), axis=0) for block in blocks], axis=0)
    starts = np.random.default_rng(0).uniform(0.0, duration, CENTERS)
    for limit in range(len(worst)):
        centers, width = starts, duration / CENTERS
        for _ in range(_ROUNDS):
            local = np.clip(centers[:, None] + np.linspace(-width, width, _LOCAL), 0.0, duration)
            found = excess(local.ravel())[:, limit].reshape(local.shape)
            centers = np.take_along_axis(local, np.argmax(found, axis=1)[:, None], axis=1)[:, 0]
            worst[limit] = max(worst[limit], np.max(found))
            width *= 3 / _LOCAL
    return worst


def _proved(what: str, check: Recheck) -> dict[str, Any]:
    closest = max(check.limits, key=lambda one: one.proved)
    return {
        f"{what}: certified": check.certified,
        f"{what}: proved excess, share of the range": f"{closest.proved:.1e} ({closest.key})",
    }


def summary(table: pd.DataFrame) -> str:
    """Return for how many everything is proved."""
    both = table["design: certified"] & table["rest to rest: certified"]
    wrong = (table[_ABOVE].astype(float) > _ROUNDED).sum()
    return (
        f"{int(both.sum())} of {len(table)} robots: every limit is proved to be kept at every "
        f"instant from rest to rest; in {wrong} something was found above what is proved. Default "
        f"runs, seed 0; {load_run({'name': 'n', 'robot': 'palida'}).run.design.starts} starts each."
    )
