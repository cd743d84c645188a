"""Functions of the robot's graph, keyed by the code and the data that they are made of.

To build a graph with all its derivatives takes longer than to load its machine code. A graph is
built only where there is no machine code with the key of its kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial, wraps
from typing import ParamSpec

from expdesign.evaluation.batch import BatchFunction, Graph, NamedFunction
from expdesign.evaluation.content import content_key

_Arguments = ParamSpec("_Arguments")


def kernel(state: Callable[_Arguments, Graph]) -> Callable[_Arguments, BatchFunction]:
    """Return for a function that states a graph one that returns the evaluation of the graph.

    The evaluation is made once per arguments. These are hashable: terms and limits, and settings.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> @kernel
    ... def multiples(factor: float) -> Graph:
    ...     x = ca.SX.sym("x", 2)
    ...     return Graph("multiples", [x], [], [factor * x])
    >>> multiples(2.0)(np.array([[1.0, 3.0]]))[0].tolist()
    [[2.0, 6.0]]
    """
    made: dict[Hashable, BatchFunction] = {}

    @wraps(state)
    def function(*given: _Arguments.args, **named: _Arguments.kwargs) -> BatchFunction:
        key = given, *sorted(named.items())
        if key not in made:
            made[key] = NamedFunction(partial(state, *given, **named), content_key(state, key))
        return made[key]

    return function
