"""The finite Fourier series of the pose, equations (13) and (14) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, FiniteFloat, GetCoreSchemaHandler, Strict, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from constraints.arrays import Array, Mask
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.runfolder import JsonFile, described


class PoseSamples(NamedTuple):
    """Pose and its time derivatives at N instants; m, rad, s. All (N, 6)."""

    pose: Array
    rate: Array
    acceleration: Array


@dataclass(frozen=True)
class FourierTrajectory:
    """λ_i(t) = λ0_i + Σ_k [μ_ik/(kω) sin kωt − ν_ik/(kω) cos kωt], k = 1 … n.

    12 n + 7 variables: λ0, μ, ν and ω.

    Examples
    --------
    >>> import numpy as np
    >>> rates = np.zeros((6, 2))
    >>> rates[0, 0] = 0.1
    >>> trajectory = FourierTrajectory(2 * np.pi, np.zeros(6), rates, np.zeros((6, 2)))
    >>> trajectory.period, trajectory.harmonics, trajectory.sample([0.0]).rate[0].round(6).tolist()
    (1.0, 2, [0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    """

    omega: float
    """ω, rad/s."""
    lambda0: Array
    """(6,), centre of the motion: m, rad."""
    mu: Array
    nu: Array
    """μ and ν (6, n), rate amplitudes of the harmonics: m/s, rad/s."""

    def __post_init__(self) -> None:
        """Freeze the arrays and refuse wrong shapes."""
        if not (np.isfinite(self.omega) and self.omega > 0):
            raise ValueError(f"omega must be positive, not {self.omega}")
        size = np.shape(self.mu)
        if len(size) != 2 or size[1] < 1:  # noqa: PLR2004 - rows and columns
            raise ValueError(f"mu has the shape {size}, not (6, n) with n ≥ 1")
        for name, shape in (
            ("lambda0", (COORDINATES,)),
            ("mu", (COORDINATES, size[1])),
            ("nu", (COORDINATES, size[1])),
        ):
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != shape:
                raise ValueError(f"{name} has the shape {value.shape}, not {shape}")
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{name} has values that are not finite")
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return number of harmonics, frequency, and period."""
        rate = f"{self.frequency:.6g} Hz"
        return f"FourierTrajectory({self.harmonics} harmonics of {rate}, {self.period:.6g} s)"

    @classmethod
    def from_displacements(
        cls, omega: float, center: ArrayLike, sine: ArrayLike, cosine: ArrayLike
    ) -> FourierTrajectory:
        """Build from displacement amplitudes: a = μ/(kω) of sin kωt, b = −ν/(kω) of cos kωt."""
        sine, cosine = np.asarray(sine, dtype=float), np.asarray(cosine, dtype=float)
        if sine.ndim != 2 or sine.shape != cosine.shape:  # noqa: PLR2004 - rows and columns
            raise ValueError(f"amplitudes of shapes {sine.shape} and {cosine.shape}, not (6, n)")
        orders = omega * np.arange(1, sine.shape[1] + 1)
        return cls(omega, np.asarray(center, dtype=float), sine * orders, -cosine * orders)

    def vector(self) -> Array:
        """Return (12 n + 7,): per coordinate λ0, μ, ν; last ω."""
        table = np.concatenate([self.lambda0[:, None], self.mu, self.nu], axis=1)
        return np.append(table.ravel(), self.omega)

    @property
    def harmonics(self) -> int:
        """Number n of harmonics."""
        return int(self.mu.shape[1])

    @property
    def period(self) -> float:
        """T = 2π/ω, s."""
        return float(2 * np.pi / self.omega)

    @property
    def frequency(self) -> float:
        """Base frequency, Hz."""
        return float(self.omega / (2 * np.pi))

    @property
    def sine(self) -> Array:
        """(6, n) displacement amplitudes of sin kωt: m, rad."""
        return self.mu / (self.omega * np.arange(1, self.harmonics + 1))

    @property
    def cosine(self) -> Array:
        """(6, n) displacement amplitudes of cos kωt: m, rad."""
        return -self.nu / (self.omega * np.arange(1, self.harmonics + 1))

    def sample(self, times: ArrayLike) -> PoseSamples:
        """Return pose, rate and acceleration at the times given, in s; any number of them."""
        basis = PhaseBasis.at(self.omega * np.atleast_1d(np.asarray(times, float)), self.harmonics)
        table = np.concatenate([self.lambda0[:, None], self.sine, self.cosine], axis=1)
        return basis.samples(table, self.omega)

    def sample_times(self, count: int) -> Array:
        """Return `count` equidistant times of one period from 0, without its end, s."""
        return self.period * np.arange(count) / count

    def shifted(self, time: float) -> FourierTrajectory:
        """Return the same motion, started `time` seconds later on its orbit."""
        phase = self.omega * time * np.arange(1, self.harmonics + 1)
        cos, sin = np.cos(phase), np.sin(phase)
        return FourierTrajectory(
            self.omega, self.lambda0, self.mu * cos + self.nu * sin, self.nu * cos - self.mu * sin
        )

    def scaled(self, factor: float, home: Array) -> FourierTrajectory:
        """Return home + F (λ(F t) − home) for the factor F and the pose home, (6,): m, rad."""
        center = home + factor * (self.lambda0 - home)
        # μ and ν are amplitudes of rates.
        return FourierTrajectory(
            factor * self.omega, center, factor**2 * self.mu, factor**2 * self.nu
        )


MOST_HARMONICS = 60
HARMONIC_LEVEL = 1e-3
"""Of an estimated motion: most harmonics, and family-wise level at which one exceeds the noise."""


@dataclass(frozen=True)
class PhaseBasis:
    """1, sin kφ, cos kφ at N phases φ = ωt, with the derivatives to φ. All (N, 2 n + 1)."""

    value: Array
    first: Array
    second: Array

    @classmethod
    def at(cls, phases: Array, harmonics: int) -> PhaseBasis:
        """Evaluate the basis at the phases (N,), rad."""
        orders = np.arange(1, harmonics + 1)
        angle = np.multiply.outer(phases, orders)
        sin, cos = np.sin(angle), np.cos(angle)
        one, zero = np.ones((phases.size, 1)), np.zeros((phases.size, 1))
        return cls(
            np.concatenate([one, sin, cos], axis=1),
            np.concatenate([zero, orders * cos, -orders * sin], axis=1),
            np.concatenate([zero, -(orders**2) * sin, -(orders**2) * cos], axis=1),
        )

    def samples(self, table: Array, omega: float) -> PoseSamples:
        """Return the motion at ω of centre and displacement amplitudes, (6, 2 n + 1): m, rad."""
        return PoseSamples(
            self.value @ table.T,
            omega * (self.first @ table.T),
            omega**2 * (self.second @ table.T),
        )


_LARGEST, _SLOWEST = 1e6, 1e-6
"""Bounds of sizes and of ω, m, rad, s: no machine is near them, and nothing overflows within."""

_Number = Annotated[FiniteFloat, Strict(), Field(ge=-_LARGEST, le=_LARGEST)]


class _Lists:
    """An array stored as lists of numbers, one for each coordinate of the pose."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_after_validator_function(
            _array,
            handler.generate_schema(self.kind),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda array: array),
        )


def _array(values: list[Any], info: ValidationInfo) -> Array:
    if len(values) != COORDINATES:
        raise ValueError(f"there are {len(values)} entries where {COORDINATES} are needed")
    harmonics = info.data.get("harmonics")
    lengths = {len(value) for value in values if isinstance(value, list)}
    if harmonics is not None and lengths - {harmonics}:
        found = " and ".join(map(str, sorted(lengths - {harmonics})))
        raise ValueError(f"a list has {found} entries where the {harmonics} harmonics are needed")
    return np.array(values, dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class FourierKeys:
    """The keys of a trajectory in a file."""

    harmonics: Annotated[
        int, Field(ge=1, strict=True), described("1", "number n of harmonics, at least 1")
    ]
    omega: Annotated[_Number, Field(ge=_SLOWEST), described("rad/s", "base frequency")]
    lambda0: Annotated[
        Array, _Lists(list[_Number]), described("m, rad", "centre of the motion, six numbers")
    ]
    mu: Annotated[
        Array,
        _Lists(list[list[_Number]]),
        described("m/s, rad/s", "rate amplitudes of cos kωt, six lists of n numbers"),
    ]
    nu: Annotated[
        Array,
        _Lists(list[list[_Number]]),
        described("m/s, rad/s", "rate amplitudes of sin kωt, six lists of n numbers"),
    ]

    @property
    def trajectory(self) -> FourierTrajectory:
        """The trajectory itself."""
        return FourierTrajectory(self.omega, self.lambda0, self.mu, self.nu)


def fourier_keys(trajectory: FourierTrajectory) -> dict[str, Any]:
    """Return the values of the keys, for types with further keys."""
    return {name: getattr(trajectory, name) for name in FourierKeys.__dataclass_fields__}


@dataclass(frozen=True, eq=False, kw_only=True)
class TrajectoryFile(FourierKeys, JsonFile):
    """The trajectory in a `design.json`, for the stages that use it."""

    FILE: ClassVar[str] = "design.json"
    WRITTEN_BY: ClassVar[str] = (
        "`expdesign design`, or by hand: JSON with harmonics, omega, lambda0, mu and nu"
    )
    WRITTEN_BY_HAND: ClassVar[bool] = True
    robot: Annotated[str | None, described("", "name of the robot that it was designed for")] = None
    status: Annotated[str | None, described("", "how the design ended")] = None


FARTHEST = 0.05
"""Largest change of the period, as a share of it, to avoid a hum."""


_ROUNDING = 1e-9


@dataclass(frozen=True)
class HumDistance:
    """A hum, and the nearest multiple of a motion's frequency."""

    frequency: float
    """Of the hum, Hz."""
    multiple: int
    distance: float
    """Absolute distance, Hz."""
    lines: float
    """Distance in lines of the recording's spectrum."""

    @property
    def kept(self) -> bool:
        """Whether it is at least one line of the recording away."""
        return self.lines >= 1 - _ROUNDING


@dataclass(frozen=True)
class KnownHum:
    """Frequencies of hums, and the number of periods of the recording.

    A hum at a multiple of the motion's frequency repeats in every period: it cannot be separated
    from the motion's own forces, and it biases the parameters. At a distance of one line of the
    recording's spectrum (one over its duration) it averages out over the recording.

    Examples
    --------
    >>> import numpy as np
    >>> (mains,) = KnownHum((50.0,), periods=10).distances(2 * np.pi * 0.4995)
    >>> mains.multiple, round(mains.distance, 4), mains.kept
    (100, 0.05, True)
    """

    frequencies: tuple[float, ...]
    """Hz."""
    periods: float

    def distances(self, omega: float) -> tuple[HumDistance, ...]:
        """Return the distance of each hum from the multiples of ω, rad/s."""
        base, found = omega / (2 * np.pi), []
        for frequency in self.frequencies:
            turns = frequency / base
            off = abs(turns - round(turns))
            found.append(HumDistance(frequency, round(turns), off * base, off * self.periods))
        return tuple(found)

    def avoided(self, periods: Array) -> Mask:
        """Return whether every hum is at least one line away, (K,), for periods (K,), s."""
        turns = np.multiply.outer(periods, np.array(self.frequencies))
        off = np.abs(turns - np.round(turns)) * self.periods
        return np.asarray(np.all(off >= 1 - _ROUNDING, axis=1))


def round_period(
    omega: float, bounds: tuple[float, float], step: float, hum: KnownHum | None = None
) -> tuple[float, int]:
    """Return the nearest ω, rad/s, with a period of whole controller steps, s, and their number.

    If another one within `FARTHEST` keeps the multiples of ω away from every hum, it is preferred.
    If no whole number of steps fits between the bounds, it is a `ValueError`.

    Examples
    --------
    >>> import numpy as np
    >>> omega, steps = round_period(2 * np.pi / 2.0004, (1.0, 10.0), 1e-3)
    >>> steps
    2000
    """
    slack = 1e-12
    fewest = int(np.ceil(2 * np.pi / (bounds[1] * step) * (1 - slack)))
    most = int(np.floor(2 * np.pi / (bounds[0] * step) * (1 + slack)))
    if fewest > most:
        raise ValueError("no period within the frequency bounds is a whole number of steps")
    steps = int(np.clip(np.rint(2 * np.pi / (omega * step)), fewest, most))
    if hum is not None and hum.frequencies:
        reach = int(FARTHEST * steps)
        near = np.arange(max(fewest, steps - reach), min(most, steps + reach) + 1)
        near = near[hum.avoided(step * near.astype(np.float64))]
        if len(near):
            steps = int(near[np.argmin(np.abs(near - 2 * np.pi / (omega * step)))])
    return 2 * np.pi / (steps * step), steps
