"""`noise:` of robot and run together: covariances that are symmetric and positive definite."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.document import Document
from expdesign.configuration.noise_section import NoiseDescription
from expdesign.configuration.problem import Key, Problem
from expdesign.configuration.resolved import ResolvedNoise, read_only

_FAMILIES = ("force", "length")
_TOLERANCE = 1e-9
_SMALLEST_EIGENVALUE = 1e-10


@dataclass(frozen=True)
class NoiseSource:
    """The section ``noise:`` of a file, and where it stands."""

    noise: NoiseDescription
    document: Document
    key: Key


def resolve_noise(
    sources: Sequence[NoiseSource],
) -> tuple[NoiseDescription | None, ResolvedNoise | None, list[Problem]]:
    """Merge the noise of robot and run.

    Parameters
    ----------
    sources : sequence of NoiseSource
        Later ones override earlier ones key by key. A later covariance takes the place of an
        earlier standard deviation and correlation, a later standard deviation that of an
        earlier covariance.

    Returns
    -------
    description : NoiseDescription or None
        The merged section; None without sources.
    noise : ResolvedNoise or None
        None without sources or with problems.
    problems : list of Problem
    """
    if not sources:
        return None, None, []
    merged: dict[str, Any] = {}
    places: dict[str, NoiseSource] = {}
    problems: list[Problem] = []
    for source in sources:
        given = {k: v for k, v in source.noise if v is not None}
        for family in _FAMILIES:
            std, covariance = f"{family}_std", f"{family}_covariance"
            if covariance in given and (std in given or f"{family}_correlation" in given):
                other = std if std in given else f"{family}_correlation"
                problems.append(_both(source, covariance, other))
            if covariance in given:
                merged.pop(std, None)
                merged.pop(f"{family}_correlation", None)
            if std in given:
                merged.pop(covariance, None)
        merged |= given
        places |= dict.fromkeys(given, source)
    if problems:
        return None, None, problems
    covariances: list[Array | None] = []
    for family in _FAMILIES:
        covariance_of_family, found = _family(family, merged, places)
        covariances.append(covariance_of_family)
        problems += found
    if problems:
        return None, None, problems
    return NoiseDescription(**merged), ResolvedNoise(*covariances), []


def _both(source: NoiseSource, covariance: str, other: str) -> Problem:
    return source.document.problem(
        (*source.key, covariance),
        f"{covariance} and {other} are both given",
        f"{covariance}, or a standard deviation with an optional correlation",
    )


def _family(
    family: str, merged: dict[str, Any], places: dict[str, NoiseSource]
) -> tuple[Array | None, list[Problem]]:
    std, correlation = merged.get(f"{family}_std"), merged.get(f"{family}_correlation")
    covariance = merged.get(f"{family}_covariance")
    if covariance is not None:
        name = f"{family}_covariance"
        shape, scale = np.array(covariance, dtype=np.float64), np.ones(len(covariance))
    elif std is not None:
        name = f"{family}_std" if correlation is None else f"{family}_correlation"
        scale = np.array(std, dtype=np.float64)
        shape = np.eye(len(std)) if correlation is None else np.array(correlation)
    elif correlation is not None:
        name = f"{family}_correlation"
        message = f"{name} is given without {family}_std"
        return None, [_problem(name, places, message, f"{family}_std with it")]
    else:
        return None, []
    with np.errstate(all="ignore"):
        complaint = _complaint(shape)
        if (
            complaint is None
            and std is not None
            and np.max(np.abs(np.diag(shape) - 1)) > _TOLERANCE
        ):
            complaint = "the diagonal of a correlation is not 1"
        matrix = (shape + shape.T) / 2 * np.outer(scale, scale)
        finite = np.all(np.isfinite(matrix)) and np.all(np.diag(matrix) > 0)
    if complaint is None and not finite:
        complaint = "the values are too large or too small to be squared"
    if complaint is not None:
        return None, [_problem(name, places, complaint, "a symmetric positive definite matrix")]
    return read_only(matrix), []


def _complaint(matrix: Array) -> str | None:
    """Say why a matrix is no covariance; None when it is one."""
    diagonal = np.diag(matrix)
    if np.any(diagonal <= 0):
        j = int(np.argmax(diagonal <= 0)) + 1
        return f"not positive definite: the entry [{j}][{j}] is {diagonal[j - 1]:g}"
    # Judged free of units and of different magnitudes of the struts.
    scale = np.sqrt(diagonal)
    scaled = matrix / scale / scale[:, None]
    if not np.all(np.isfinite(scaled)):
        return "the entries differ too much in magnitude"
    difference = np.abs(scaled - scaled.T)
    if np.max(difference) > _TOLERANCE:
        i, j = (int(n) for n in np.unravel_index(np.argmax(difference), difference.shape))
        return (
            f"not symmetric: the entry [{i + 1}][{j + 1}] is {matrix[i, j]:g}, "
            f"[{j + 1}][{i + 1}] is {matrix[j, i]:g}"
        )
    smallest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    if smallest < _SMALLEST_EIGENVALUE:
        return f"not positive definite: the smallest eigenvalue of the correlation is {smallest:g}"
    return None


def _problem(name: str, places: dict[str, NoiseSource], message: str, allowed: str) -> Problem:
    source = places[name]
    return source.document.problem((*source.key, name), message, allowed)
