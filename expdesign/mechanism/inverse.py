"""The inverse of a symbolic matrix."""

from __future__ import annotations

import casadi as ca


def inverse(matrix: ca.SX) -> ca.SX:
    """Return the inverse of a matrix (n, n), as accurate as its condition allows.

    By QR factorisation, as `ca.inv` does (modified Gram–Schmidt: Golub, Van Loan 2013, sec. 5.2.8),
    but with n divisions in place of about 2 n²: a product with the root of a reciprocal is none.
    """
    columns = ca.horzsplit(matrix)
    directions: list[ca.SX] = []
    shares: list[list[ca.SX]] = []
    per_length: list[ca.SX] = []
    for column in columns:
        rest, own = column, list[ca.SX]()
        for direction in directions:
            own.append(ca.dot(direction, rest))
            rest = rest - own[-1] * direction
        per_length.append(ca.sqrt(1 / ca.dot(rest, rest)))
        directions.append(rest * per_length[-1])
        shares.append(own)
    rows: list[ca.SX] = []
    for i in reversed(range(len(columns))):
        row = directions[i].T
        for k, later in enumerate(reversed(rows), start=i + 1):
            row = row - shares[k][i] * later
        rows.append(row * per_length[i])
    return ca.vertcat(*reversed(rows))
