"""What a sample takes in the graph's functions of PaLiDA, one core: JSON of µs, run by run."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from expdesign.configuration import load_run
from expdesign.experiment.setup import plan_search
from expdesign.solver.feasibility import random_start
from expdesign.solver.phases import coarse_points

_SAMPLES = 2000
_LONG_ENOUGH = 0.5
"""Seconds for each figure."""


def main(repetitions: int) -> None:
    """Write how long each function takes for a sample, `repetitions` times."""
    plan = plan_search(load_run("palida"))
    problem, limits = plan.problem, plan.problem.limits
    problem.compile()
    width, level = plan.widths[-1], problem.criterion.levels[-1]
    points = coarse_points(problem.variables.harmonics)
    x = random_start(problem, np.random.default_rng(0), points, width)
    phases = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    states = problem.states(x, phases)
    poses = states[:, :6], states[:, 6:12], states[:, 12:18]
    cost = replace(problem.cost, samples=_SAMPLES)
    functions: dict[str, Callable[[], object]] = {
        "regressor": lambda: plan.evaluator.robot.regressor(*poses),
        "limits": lambda: limits.smooth_values(states, width),
        "limits with their Jacobian": lambda: limits.smooth_slopes(states, width),
        "cost": lambda: cost.value(x, width, level),
        "cost with gradient": lambda: cost.gradient(x, width, level),
        "cost with gradient and Hessian": lambda: cost.derivatives(x, width, level),
    }
    found = {
        name: [_microseconds(one) for _ in range(repetitions)] for name, one in functions.items()
    }
    json.dump(found, sys.stdout)


def _microseconds(function: Callable[[], object]) -> float:
    function()
    calls, began = 0, time.perf_counter()
    while time.perf_counter() - began < _LONG_ENOUGH:
        function()
        calls += 1
    return (time.perf_counter() - began) / calls / _SAMPLES * 1e6


if __name__ == "__main__":
    main(int(sys.argv[1]))
