"""Paths between rows over cells of time against the same in exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.enclosure.paths import PosePath, between_rows
from tests.enclosure.exact import assert_holds

KINDS = {"line": 1, "cubic": 2, "quintic": 3}


def drawn(seed, count, kind, step=1e-2):
    """Return times and what a table of this kind has at each: position, rate, acceleration."""
    rng = np.random.default_rng(seed)
    times = rng.uniform(0, 100) + np.cumsum(rng.uniform(0.1, 1, count)) * step
    sizes = 1.0, 1 / step, 1 / step**2
    return times, [size * rng.standard_normal((count, 2)) for size in sizes[: KINDS[kind]]]


def exact(times, rows, place, column):
    """Return the polynomial of a piece by powers of t − its begin, in fractions."""
    (p0, p1), *rest = ([Fraction(float(part[place + k, column])) for k in (0, 1)] for part in rows)
    h = Fraction(float(times[place + 1])) - Fraction(float(times[place]))
    if not rest:
        return [p0, (p1 - p0) / h]
    v0, v1 = rest[0]
    if len(rest) == 1:
        slope = (p1 - p0) / h
        return [p0, v0, (3 * slope - 2 * v0 - v1) / h, (v0 + v1 - 2 * slope) / h**2]
    a0, a1 = rest[1]
    position, rate = p1 - p0 - v0 * h - a0 * h**2 / 2, v1 - v0 - a0 * h
    return [
        *(p0, v0, a0 / 2),
        (10 * position - 4 * rate * h + (a1 - a0) * h**2 / 2) / h**3,
        (-15 * position + 7 * rate * h - (a1 - a0) * h**2) / h**4,
        (6 * position - 3 * rate * h + (a1 - a0) * h**2 / 2) / h**5,
    ]


@pytest.mark.parametrize("kind", KINDS)
@given(
    seed=st.integers(0, 2**32 - 1),
    step=st.sampled_from([1e-4, 1e-2, 1.0]),
    parts=st.sampled_from([1, 3, 1000, 10**8]),
)
@settings(max_examples=25)
def test_a_path_and_its_derivatives_are_held_in_parts_of_its_pieces(kind, seed, step, parts):
    times, rows = drawn(seed, 3, kind, step)
    rng = np.random.default_rng(seed)
    starts = times[:-1] + rng.integers(0, parts, 2) / parts * np.diff(times)
    ends = np.clip(starts + np.diff(times) / parts, None, times[1:])
    edges = np.stack([starts, ends], axis=1)
    path = between_rows(times, *rows)

    for derivative in range(4):
        models = path.over(edges)
        for cell in range(2):
            low, high, begin = (Fraction(float(t)) for t in (*edges[cell], times[cell]))
            for tau in (Fraction(-1), Fraction(1, 3), Fraction(1)):
                time = (low + high) / 2 + tau * (high - low) / 2 - begin
                for column in range(2):
                    powers = exact(times, rows, cell, column)
                    for _ in range(derivative):
                        powers = [k * c for k, c in enumerate(powers)][1:]
                    value = sum((c * time**k for k, c in enumerate(powers)), Fraction(0))
                    assert_holds(models[column], cell, tau, value)
        path = path.derivative


@pytest.mark.parametrize("kind", KINDS)
def test_a_path_is_as_narrow_as_its_rounding(kind):
    times, rows = drawn(7, 20, kind)
    edges = np.stack([times[:-1], times[1:]], axis=1)

    models = PosePath(between_rows(times, *rows)).models(edges)

    for derivative in range(3):
        part = models[2 * derivative : 2 * derivative + 2]
        largest = max(np.max(model.size) for model in part)
        # Half a step is a thousandth of a second at least: digits go as its powers.
        assert (
            max(np.max(model.radius) for model in part)
            <= 1e-12 * max(largest, 1.0) * 10**derivative
        )


def test_coordinates_are_those_of_their_axes():
    times, rows = drawn(3, 4, "cubic")
    source, factor, zero = np.array([1, 0]), np.array([-1000.0, 20.0]), np.array([0.5, -3.0])
    edges = np.stack([times[:-1], times[1:]], axis=1)[:2]

    models = between_rows(times, *rows).map_coordinates(source, factor, zero).over(edges)

    for place in range(2):
        for column in range(2):
            value = Fraction(float(rows[0][place, source[column]])) / Fraction(factor[column])
            assert_holds(models[column], place, Fraction(-1), value + Fraction(zero[column]))
