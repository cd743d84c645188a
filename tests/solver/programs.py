"""Nonlinear programs whose solutions are known."""

import numpy as np

INF = np.inf


class DenseRows:
    """Rows about a point whose Jacobian is a matrix."""

    def __init__(self, values, matrix):
        self.values, self.matrix = values, matrix

    def jacobian(self):
        return self.matrix

    def jacobian_product(self, step):
        return self.matrix @ step

    def transposed_product(self, weights):
        return self.matrix.T @ weights

    def curvature(self, weights):
        return self.matrix.T @ (weights[:, None] * self.matrix)


class Counted:
    """A program that counts its own calls."""

    def __init__(self, bounds, row_bounds):
        self.lower, self.upper = (np.array(side, dtype=float) for side in bounds)
        self.row_lower, self.row_upper = (np.array(side, dtype=float) for side in row_bounds)
        self.calls = {
            "cost": 0,
            "cost_derivatives": 0,
            "cost_gradient": 0,
            "rows": 0,
            "jacobian": 0,
        }

    def cost(self, x):
        self.calls["cost"] += 1
        return float(self.f(x))

    def cost_derivatives(self, x):
        self.calls["cost_derivatives"] += 1
        return float(self.f(x)), self.slope(x), self.curvature(x)

    def cost_gradient(self, x):
        self.calls["cost_gradient"] += 1
        return float(self.f(x)), self.slope(x)

    def rows(self, x):
        self.calls["rows"] += 1
        return self.g(x)

    def linear_rows(self, x):
        self.calls["jacobian"] += 1
        return DenseRows(self.g(x), self.row_slopes(x))


class Quadratic(Counted):
    """½ xᵀ H x − cᵀ x, row_lower ≤ A x ≤ row_upper."""

    H = np.array([[3.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])
    c = np.array([1.0, -2.0, 3.0])
    A = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [0.0, 1.0, 1.0]])

    def f(self, x):
        return 0.5 * x @ self.H @ x - self.c @ x

    def slope(self, x):
        return self.H @ x - self.c

    def curvature(self, x):
        return self.H

    def g(self, x):
        return self.A @ x

    def row_slopes(self, x):
        return self.A


class Fit(Counted):
    """Sum of squares of (x₀ − 2, 2 (x₁ − 1)) on and inside the unit circle."""

    def f(self, x):
        return (x[0] - 2) ** 2 + 4 * (x[1] - 1) ** 2

    def slope(self, x):
        return np.array([2 * (x[0] - 2), 8 * (x[1] - 1)])

    def curvature(self, x):
        return np.diag([2.0, 8.0])

    def g(self, x):
        return np.array([x @ x])

    def row_slopes(self, x):
        return 2 * x[None, :]


class Rosenbrock(Counted):
    """Least squares with the minimum 0 at (1, 1); no rows."""

    def f(self, x):
        return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2

    def _residual_slopes(self, x):
        return np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])

    def slope(self, x):
        residuals = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        return 2 * self._residual_slopes(x).T @ residuals

    def curvature(self, x):
        return 2 * self._residual_slopes(x).T @ self._residual_slopes(x)

    def g(self, x):
        return np.empty(0)

    def row_slopes(self, x):
        return np.empty((0, 2))


def quadratic():
    return Quadratic(([-INF] * 3, [INF] * 3), ([-INF, 5.0, -INF], [0.5, INF, 100.0]))


def rosenbrock():
    return Rosenbrock(([-INF] * 2, [INF] * 2), ([], []))
