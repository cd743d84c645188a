"""Ipopt through CasADi, with derivatives assembled outside its graph."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from constraints.arrays import Array
from expdesign.problem.program import Program, largest_excess
from expdesign.solver.interior_point import WEIGHT, BestIterate, IterationReport, Solution

_UNCHANGED = 2e-4
"""Relative change of the objective that counts as none."""
IPOPT_OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    "obj_scaling_factor": WEIGHT,
    "nlp_scaling_method": "none",
    "linear_solver": "mumps",
    # AMD: the default ordering was four times slower on 2 000 dense rows in an earlier study.
    "mumps_pivot_order": 0,
    # The rows are scaled already; the search for a better scaling took a third of the time.
    "mumps_permuting_scaling": 0,
    # One larger system instead of many solutions of a smaller one.
    "limited_memory_aug_solver": "extended",
    # It begins at an optimum: it stays near, and close to its bounds.
    "mu_strategy": "monotone",
    "bound_mult_init_method": "mu-based",
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
    "slack_bound_push": 1e-6,
    "slack_bound_frac": 1e-6,
    "tol": 1e-4,
    # Good enough: feasible, and the objective has not changed for five iterations. Without exact
    # second derivatives of the limits the dual residual converges slowly.
    "acceptable_tol": 1e-2,
    "acceptable_constr_viol_tol": 1e-3,
    "acceptable_compl_inf_tol": 1e-3,
    "acceptable_iter": 5,
    "acceptable_obj_change_tol": _UNCHANGED,
}
"""Ipopt's options of the last solve that no program changes."""


def last_options(rows: int, most: int) -> dict[str, Any]:
    """Return Ipopt's options of the last solve, with so many rows and at most so many iterations.

    It begins at an optimum. The barrier μ takes it away by up to rows · μ in the objective, and
    that is to be no more than what counts as no change. The curvature of all steps is kept: with
    the last six, and hundreds of rows near their bounds, the dual residual did not settle.
    """
    return {
        **IPOPT_OPTIONS,
        "mu_init": _UNCHANGED * WEIGHT / max(rows, 1),
        "max_iter": most,
        "limited_memory_max_history": most,
    }


class _Function(ca.Callback):
    """A function for Ipopt, computed by NumPy from its inputs as vectors.

    Attributes
    ----------
    interruption : KeyboardInterrupt or None
        Was raised here; Ipopt stops, but does not pass it on.
    """

    def __init__(
        self,
        name: str,
        inputs: Sequence[tuple[int, int]],
        outputs: Sequence[ca.Sparsity],
        compute: Callable[..., Sequence[Any]],
    ) -> None:
        ca.Callback.__init__(self)
        self._inputs, self._outputs, self._compute = inputs, outputs, compute
        self.interruption: KeyboardInterrupt | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._inputs[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._outputs[i]

    def eval(self, arg: Sequence[ca.DM]) -> Sequence[Any]:
        try:
            return self._compute(*(value.full().ravel() for value in arg))
        except KeyboardInterrupt as interruption:
            self.interruption = interruption
            raise


def solve_with_ipopt(
    program: Program,
    start: Array,
    *,
    options: Mapping[str, Any],
    report: IterationReport | None = None,
) -> Solution:
    """Minimise by quasi-Newton steps; return the last iterate whatever the status.

    Parameters
    ----------
    start : (z,)
        Initial variables.
    options : mapping
        Ipopt's own options (without the prefix ``ipopt.``).
    report : callable, optional
        Called once per iteration; False stops the solver.
    """
    counts = {"f": 0, "grad_f": 0, "g": 0, "jac_g": 0}
    memory: dict[str, tuple[bytes, Any]] = {}

    def at(part: str, x: Array, evaluate: Callable[[Array], Any]) -> Any:
        """Evaluate a part unless it is known at this point from the call before."""
        key = x.tobytes()
        if part not in memory or memory[part][0] != key:
            counts[part] += 1
            memory[part] = key, evaluate(x)
        return memory[part][1]

    def rows_jacobian(x: Array, _p: Array) -> list[Any]:
        rows = at("jac_g", x, program.linear_rows)
        return [rows.values, ca.DM(rows.jacobian())]

    iterations, best = itertools.count(1), BestIterate(start)

    def watch(x: Array, objective: Array, rows: Array, *_multipliers: Array) -> list[int]:
        violation = largest_excess(rows, program.row_lower, program.row_upper)
        now = next(iterations), float(objective[0]), violation
        best.offer(x, now[1], violation)
        return [0 if report is None or report(*now, x) else 1]

    size, count = start.size, program.row_lower.size
    dense, point = ca.Sparsity.dense, [(size, 1), (0, 0)]
    one, slope, column = dense(1, 1), dense(size, 1), dense(count, 1)
    cost = _Function("nlp_f", point, [one], lambda x, _: [at("f", x, program.cost)])
    rows = _Function("nlp_g", point, [column], lambda x, _: [at("g", x, program.rows)])
    sizes = {"x": size, "f": 1, "g": count, "lam_x": size, "lam_g": count, "lam_p": 0}
    outputs = [(sizes[ca.nlpsol_out(k)], 1) for k in range(ca.nlpsol_n_out())]
    functions = {
        "grad_f": _Function(
            "nlp_grad_f", point, [one, slope], lambda x, _: at("grad_f", x, program.cost_gradient)
        ),
        "jac_g": _Function("nlp_jac_g", point, [column, dense(count, size)], rows_jacobian),
        "iteration_callback": _Function("watch", outputs, [one], watch),
    }
    x, p = ca.MX.sym("x", size), ca.MX.sym("p", 0, 0)
    settings = {f"ipopt.{key}": value for key, value in options.items()}
    settings["ipopt.hessian_approximation"] = "limited-memory"
    solver = ca.nlpsol(
        "design",
        "ipopt",
        {"x": x, "f": cost(x, p), "g": rows(x, p)},
        {**settings, **functions, "print_time": False, "error_on_fail": False, "no_nlp_grad": True},
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
    for function in (cost, rows, *functions.values()):
        if function.interruption is not None:
            raise function.interruption
    statistics = solver.stats()
    status = str(statistics["return_status"])
    return Solution(
        x=solution["x"].full().ravel(),
        objective=float(solution["f"]),
        multipliers=solution["lam_g"].full().ravel(),
        status=status,
        iterations=int(statistics.get("iter_count", 0)),
        evaluations=counts,
        seconds=seconds,
        best=best.x,
    )
