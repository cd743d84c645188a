"""Ipopt through CasADi, fed with derivatives that are assembled outside its graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import casadi as ca
import numpy as np

from constraints.arrays import Array

Curvature = Literal["gauss-newton", "limited-memory"]

COMMON_OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    "mu_strategy": "adaptive",
    "linear_solver": "mumps",
    # AMD: the default ordering was four times slower on 2 000 dense rows in an earlier study.
    "mumps_pivot_order": 0,
    "nlp_scaling_method": "none",
    # Good enough: feasible, and the objective has stood still for five iterations. Without exact
    # second derivatives of the limits the last digits of the dual residual take long.
    "acceptable_tol": 1e-2,
    "acceptable_compl_inf_tol": 1e-3,
    "acceptable_iter": 5,
    "acceptable_obj_change_tol": 2e-4,
}
"""Ipopt's options of every solve; who solves adds how exactly the rows are to be kept."""


class NonlinearProgram(Protocol):
    """minimise f(x) subject to lower ≤ x ≤ upper and row_lower ≤ g(x) ≤ row_upper."""

    lower: Array
    upper: Array
    row_lower: Array
    row_upper: Array

    def cost(self, x: Array) -> float:
        """Return f."""

    def cost_derivatives(self, x: Array) -> tuple[float, Array, Array]:
        """Return f, its gradient (z,) and a positive semidefinite Hessian (z, z)."""

    def cost_gradient(self, x: Array) -> tuple[float, Array]:
        """Return f and its gradient (z,)."""

    def rows(self, x: Array) -> Array:
        """Return g, (r,)."""

    def rows_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return g and its Jacobian, (r, z)."""


@dataclass(frozen=True)
class Iteration:
    """What Ipopt reports once per iteration: objective and largest violation."""

    number: int
    objective: float
    violation: float


@dataclass(frozen=True)
class IpoptResult:
    """Where Ipopt stopped, and why.

    Attributes
    ----------
    multipliers : (r,)
        Lagrange multipliers of the rows; positive at the upper bound.
    status : str
        Ipopt's return status, e.g. ``"Solve_Succeeded"``.
    converged : bool
        True for ``Solve_Succeeded`` and ``Solved_To_Acceptable_Level``.
    evaluations : mapping
        Number of calls of f, g, their derivatives and the Hessian.
    """

    x: Array
    objective: float
    multipliers: Array
    status: str
    converged: bool
    iterations: int
    evaluations: Mapping[str, int]
    seconds: float


@dataclass
class _Evaluations:
    """Remembers the last point, and counts how often each part was really evaluated."""

    program: NonlinearProgram
    counts: dict[str, int] = field(
        default_factory=lambda: {"f": 0, "grad_f": 0, "g": 0, "jac_g": 0}
    )
    _memory: dict[str, tuple[bytes, Any]] = field(default_factory=dict)

    def at(self, part: str, x: Array, evaluate: Callable[[Array], Any]) -> Any:
        key = x.tobytes()
        known = self._memory.get(part)
        if known is None or known[0] != key:
            self.counts[part] += 1
            known = (key, evaluate(x))
            self._memory[part] = known
        return known[1]


class _Part(ca.Callback):
    """One function that Ipopt calls, computed by NumPy."""

    def __init__(
        self,
        name: str,
        inputs: list[tuple[int, int]],
        outputs: list[ca.Sparsity],
        compute: Callable[..., list[Any]],
    ) -> None:
        ca.Callback.__init__(self)
        self._inputs, self._outputs, self._compute = inputs, outputs, compute
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._inputs[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._outputs[i]

    def eval(self, arg: Sequence[ca.DM]) -> list[Any]:
        return self._compute(*(value.full().ravel() for value in arg))


class _Watch(ca.Callback):
    """Ipopt's iteration callback: reports, and stops when asked to."""

    def __init__(self, size: int, rows: int, report: Callable[[Iteration, Array], bool]) -> None:
        ca.Callback.__init__(self)
        self._shape = {"x": size, "f": 1, "g": rows, "lam_x": size, "lam_g": rows, "lam_p": 0}
        self._report = report
        self.bounds: tuple[Array, Array] = (np.empty(0), np.empty(0))
        self._count = 0
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[ca.nlpsol_out(i)], 1)

    def eval(self, arg: Sequence[ca.DM]) -> list[Any]:
        x = arg[0].full().ravel()
        objective, rows = float(arg[1]), arg[2].full().ravel()
        lower, upper = self.bounds
        violation = float(np.max(np.maximum(lower - rows, rows - upper), initial=0.0))
        self._count += 1
        go_on = self._report(Iteration(self._count, objective, violation), x)
        return [0 if go_on else 1]


def solve_with_ipopt(
    program: NonlinearProgram,
    start: Array,
    *,
    options: Mapping[str, Any],
    curvature: Curvature = "gauss-newton",
    report: Callable[[Iteration, Array], bool] | None = None,
) -> IpoptResult:
    """Minimise; return the last iterate whatever the status.

    Parameters
    ----------
    start : (z,)
        Initial variables.
    options : mapping
        Ipopt's own options (without the prefix ``ipopt.``).
    curvature : {"gauss-newton", "limited-memory"}
        Hessian of the Lagrangian: the cost's own positive semidefinite one, without the rows'
        curvature; or Ipopt's limited-memory quasi-Newton approximation of the whole.
    report : callable, optional
        Called once per iteration with the iterate; False stops the solver.
    """
    memory = _Evaluations(program)
    size, count = start.size, program.row_lower.size
    dense, column = ca.Sparsity.dense, (size, 1)

    def cost(x: Array, _p: Array) -> list[Any]:
        return [memory.at("f", x, program.cost)]

    def gradient(x: Array, _p: Array) -> list[Any]:
        if curvature == "limited-memory":
            value, slope = memory.at("grad_f", x, program.cost_gradient)
        else:
            value, slope, _ = memory.at("grad_f", x, program.cost_derivatives)
        return [value, slope]

    def rows(x: Array, _p: Array) -> list[Any]:
        return [memory.at("g", x, program.rows)]

    def jacobian(x: Array, _p: Array) -> list[Any]:
        values, matrix = memory.at("jac_g", x, program.rows_jacobian)
        return [values, ca.DM(matrix)]

    def hessian(x: Array, _p: Array, weight: Array, _rows: Array) -> list[Any]:
        _, _, matrix = memory.at("grad_f", x, program.cost_derivatives)
        return [ca.triu(ca.DM(weight[0] * matrix))]

    none = (0, 0)
    parts = [
        _Part("nlp_f", [column, none], [dense(1, 1)], cost),
        _Part("nlp_grad_f", [column, none], [dense(1, 1), dense(size, 1)], gradient),
        _Part("nlp_g", [column, none], [dense(count, 1)], rows),
        _Part("nlp_jac_g", [column, none], [dense(count, 1), dense(count, size)], jacobian),
        _Part(
            "nlp_hess_l",
            [column, none, (1, 1), (count, 1)],
            [ca.Sparsity.upper(size)],
            hessian,
        ),
    ]
    x = ca.MX.sym("x", size)
    p = ca.MX.sym("p", 0, 0)
    nlp = {"x": x, "f": parts[0](x, p), "g": parts[2](x, p)}
    watch = _Watch(size, count, report or (lambda _iteration, _x: True))
    watch.bounds = (program.row_lower, program.row_upper)
    settings = {f"ipopt.{key}": value for key, value in options.items()}
    if curvature == "limited-memory":
        settings["ipopt.hessian_approximation"] = "limited-memory"
    solver = ca.nlpsol(
        "design",
        "ipopt",
        nlp,
        {
            **settings,
            "grad_f": parts[1],
            "jac_g": parts[3],
            "hess_lag": parts[4],
            "iteration_callback": watch,
            "print_time": False,
            "error_on_fail": False,
            "no_nlp_grad": True,
        },
    )
    began = time.perf_counter()
    solution = solver(
        x0=start,
        lbx=program.lower,
        ubx=program.upper,
        lbg=program.row_lower,
        ubg=program.row_upper,
    )
    seconds = time.perf_counter() - began
    statistics = solver.stats()
    status = str(statistics["return_status"])
    return IpoptResult(
        x=solution["x"].full().ravel(),
        objective=float(solution["f"]),
        multipliers=solution["lam_g"].full().ravel(),
        status=status,
        converged=status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"},
        iterations=int(statistics.get("iter_count", 0)),
        evaluations=dict(memory.counts),
        seconds=seconds,
    )
