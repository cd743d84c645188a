"""Limits of a finished design at instants that no solver has seen, computed from definitions.

Random instants, and then a search around the worst of them: neither the recheck's grid nor its
refinements nor its model are used.
"""

import numpy as np

TOLERANCE = 1e-6
POINTS = 6000
CANDIDATES, DRAWS, ROUNDS = 6, 40, 6


def worst_excess(result, seed=0):
    """Return the largest excess of every limit over one period, as a share of its range."""
    rng = np.random.default_rng(seed)
    period = result.trajectory.period
    times = period * (np.arange(POINTS) + rng.random(POINTS)) / POINTS
    found = excesses(result, times)
    centers = {}
    for key, values in found.items():
        peaks = (values >= np.roll(values, 1)) & (values >= np.roll(values, -1))
        order = np.argsort(np.where(peaks, -values, np.inf))[:CANDIDATES]
        centers[key] = times[order]
    best = {key: float(np.max(values)) for key, values in found.items()}
    width = 2 * period / POINTS
    for _ in range(ROUNDS):
        near = {
            key: at[:, None] + width * rng.uniform(-1, 1, (CANDIDATES, DRAWS))
            for key, at in centers.items()
        }
        flat = excesses(result, np.concatenate([at.ravel() for at in near.values()]))
        for k, (key, at) in enumerate(near.items()):
            part = slice(k * at.size, (k + 1) * at.size)
            values = flat[key][part].reshape(at.shape)
            centers[key] = at[np.arange(CANDIDATES), np.argmax(values, axis=1)]
            best[key] = max(best[key], float(np.max(values)))
        width *= 4 / DRAWS
    return best


def assert_limits_kept(result):
    worst = worst_excess(result)
    assert [limit.key for limit in result.robot.limits] == [c.key for c in result.check.limits]
    for check in result.check.limits:
        assert worst[check.key] <= TOLERANCE, check.key
        # Nothing worse is found than the recheck says, and what it says is the case at its moment.
        assert worst[check.key] <= check.violation + TOLERANCE, check.key
        # Where a rate turns a force jumps: both sides of that moment count.
        there = excesses(result, check.time + np.array([-1e-9, 0, 1e-9]))[check.key]
        assert np.min(np.abs(there - check.violation)) <= TOLERANCE, check.key
        assert check.violation <= check.proved <= TOLERANCE, check.key
    assert result.check.passed


def excesses(result, times):
    """Return the excess of the worst row of every limit, (N,) each."""
    found = quantities(result, times)
    return {
        limit.key: excess(found[limit.key], limit.lower, limit.upper)
        for limit in result.robot.limits
    }


def quantities(result, times):
    """Return the limited quantities at times, (N, rows) each, from their definitions."""
    robot = result.robot
    motion = result.trajectory.sample(times)
    struts = robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
    phi, theta, psi = motion.pose[:, 3:].T
    zero, one = np.zeros(len(times)), np.ones(len(times))

    def stacked(*rows):
        return np.array([list(row) for row in rows]).transpose(2, 0, 1)

    about_x = stacked(
        (one, zero, zero), (zero, np.cos(phi), -np.sin(phi)), (zero, np.sin(phi), np.cos(phi))
    )
    about_y = stacked(
        (np.cos(theta), zero, np.sin(theta)),
        (zero, one, zero),
        (-np.sin(theta), zero, np.cos(theta)),
    )
    about_z = stacked(
        (np.cos(psi), -np.sin(psi), zero), (np.sin(psi), np.cos(psi), zero), (zero, zero, one)
    )
    rotation = about_x @ about_y @ about_z
    description = result.configuration.robot.description
    base = np.array(description.base_joints)
    arms = np.array(description.platform_joints) @ rotation.transpose(0, 2, 1)
    tips = motion.pose[:, None, :3] + arms
    along = tips - base
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    turning = np.cross(arms, along) / description.limits["characteristic_length"]
    return {
        "strut_length": struts.length,
        "strut_speed": struts.length_rate,
        "strut_acceleration": struts.length_acceleration,
        "alpha": struts.alpha,
        "beta": struts.beta,
        "actuator_force": robot.actuator_forces(motion.pose, motion.rate, motion.acceleration),
        "position": motion.pose[:, :3],
        "tilt": np.arccos(np.clip(rotation[:, 2, 2], -1, 1))[:, None],
        "jacobian_condition": np.linalg.cond(np.concatenate([along, turning], axis=2))[:, None],
        "strut_clearance": clearances(base, tips),
    }


def clearances(base, tips):
    """Smallest distance of the segments of every pair of struts, (N, 15)."""
    return np.array(
        [
            segment_distance(base[i], tips[:, i], base[j], tips[:, j])
            for i in range(6)
            for j in range(i + 1, 6)
        ]
    ).T


def segment_distance(a, b, c, d):
    """Of the segments a b and c d, at N instants: inside, or with one end of one of them."""

    def to_segment(p, q, r):
        share = np.sum((p - q) * (r - q), axis=-1) / np.sum((r - q) ** 2, axis=-1)
        foot = q + np.clip(share, 0, 1)[:, None] * (r - q)
        return np.linalg.norm(p - foot, axis=-1)

    ends = np.min(
        [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)], axis=0
    )
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (np.sum(x * y, axis=1) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=1), np.sum(v * w, axis=1)
    det = uu * vv - uv**2
    s, t = (uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det
    inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    between = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.where(inside, between, ends)


def excess(values, lower, upper):
    """Return the excess of the worst row, (N,), as a share of the range (or of |bound|)."""
    lower, upper = np.atleast_1d(lower).astype(float), np.atleast_1d(upper).astype(float)
    both = np.isfinite(lower) & np.isfinite(upper)
    one = np.abs(np.where(np.isfinite(lower), lower, upper))
    with np.errstate(invalid="ignore"):
        scale = np.where(both, upper - lower, one)
    return np.max(np.maximum(lower - values, values - upper) / scale, axis=1)
