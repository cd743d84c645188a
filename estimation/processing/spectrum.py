"""Noise spectrum, smoothed with a width chosen by the data, and the filter that whitens the noise.

The spectrum at a line is the mean over its neighbours without the line itself. Weights from it are
then independent of the line's own contrasts, and a variance computed from these (a sandwich
estimator) is valid for any weights. Only a line that exceeds its neighbours, such as a drive's hum,
keeps its own size. The spectrum is flattened before smoothing by an autoregressive model of each
channel (prewhitening: Blackman and Tukey, 1958). Model order and number of neighbours are those
that predict the omitted lines best (Beltrão and Bloomfield, J. Time Series Analysis 8, 1987).

Weighting every line of the DFT with the inverse of its 6 × 6 spectrum C̄ is equivalent to filtering
measurement and model with H, H C̄ Hᴴ = Σ, and weighting with Σ⁻¹ (Pintelon and Schoukens, *System
Identification*, 2012, chapter 9): every method for white noise is valid after the filter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as sla
from scipy.special import fdtrc

from constraints.arrays import Array, ComplexArray, Mask
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity, series_of

_ORDERS = (0, 1, 2, 4, 8)
_HALF_WIDTHS = (8, 24, 72, 216)
_FEWEST_FREEDOM = 24.0
"""Smallest number of complex degrees of freedom of a smoothed 6 × 6 spectrum."""
_CLEARLY_BETTER = 5.0
"""Gain in log likelihood, minus one per parameter, below which noise counts as white."""
_STANDING_OUT = 0.01
"""Probability of a false peak among all lines."""
_FEWEST_CONTRASTS = 6
"""Smallest number of contrasts for a separate size of each channel at one line."""
_MIDDLE_WIDTH = 32
"""Number of neighbours in the search for peaks."""


@dataclass(frozen=True, eq=False)
class SmoothedSpectrum:
    """Assumed noise spectrum of one sample at every line, a candidate among several."""

    smooth: ComplexArray
    """(L, 6, 6), or (6, 6) if constant: smoothed spectrum after prewhitening."""
    own: Array
    """(L, 6), relative size of peaks; 1 for all other lines."""
    standing_out: Mask
    """(L,), peaks, which keep their own size."""
    filters: ComplexArray
    """(L, 6), response of the prewhitening filters."""
    constant: Array
    """(L, 6), correction of the model at the line of a constant; 1 for all other lines."""
    freedom: float
    """Median of the lines' complex degrees of freedom."""
    order: int
    """Order of the autoregressive model."""
    half_width: int | None
    """Neighbours to either side; None: all lines."""
    likelihood: float
    """Whittle's, minus the number of parameters."""

    @cached_property
    def matrices(self) -> ComplexArray:
        """(L, 6, 6)."""
        return _colour_test(self.smooth, self.own * self.constant / self.filters)

    @property
    def words(self) -> str:
        """Description of the smoothing."""
        parts = [
            "the mean over all lines"
            if self.half_width is None
            else f"the mean over ± {self.half_width} lines",
            f"after an autoregressive model of order {self.order}" if self.order else "",
            f"{np.count_nonzero(self.standing_out)} lines by themselves"
            if np.any(self.standing_out)
            else "",
        ]
        return ", ".join(part for part in parts if part)


def smoothed_spectrum(
    lines: NoiseLines, covariance: Array, *, always: bool = False
) -> SmoothedSpectrum | None:
    """Return the spectrum that predicts the lines best; None if that is white noise of Σ.

    With `always`, the best spectrum that is not constant is returned, if there is one.
    """
    white, *others = _candidates(lines, covariance)
    best = max(others, key=lambda each: each.likelihood, default=None)
    better = best is not None and best.likelihood > white.likelihood + _CLEARLY_BETTER
    found = best if best is not None and (better or always) else white
    constant = found.order == 0 and found.half_width is None and not np.any(found.standing_out)
    return None if constant else found


def _candidates(lines: NoiseLines, covariance: Array) -> Iterator[SmoothedSpectrum]:
    """Yield spectra, white noise first, with Whittle's likelihood minus their parameters."""
    widest = lines.samples // 4 - 1
    middle, widths = (
        [w for w in some if w <= widest and lines.freedom * w >= _FEWEST_FREEDOM]
        for some in ((min(_MIDDLE_WIDTH, widest),), _HALF_WIDTHS)
    )
    for order in _ORDERS:
        filters = _prewhitening(lines, order)
        constant_size = _constant_size(lines, filters)
        flat = replace(lines, matrices=_colour_test(lines.matrices, filters))
        mean = flat.covariance if order else covariance
        everyone = np.ones(len(flat.matrices))
        constant = mean.astype(np.complex128), everyone * lines.freedom * lines.samples / 2
        *_, (reference, freedom) = constant, *_neighbours(flat, middle, everyone)
        size = _own_size(flat, reference, freedom)
        standing_out = np.any(size != 1.0, axis=1)
        means = _neighbours(flat, widths, np.where(standing_out, 0.0, 1.0))
        for width, (smooth, freedom) in zip((None, *widths), (constant, *means), strict=True):
            if not np.all(np.isfinite(smooth)):
                continue
            own = size * np.sqrt(_diagonal(reference) / _diagonal(smooth))
            own = np.where(standing_out[:, None], own, 1.0)
            parameters = order * flat.matrices.shape[1]
            likelihood = _likelihood(flat, smooth, own, filters) - parameters
            sizes = smooth, own, standing_out, filters, constant_size
            yield SmoothedSpectrum(*sizes, float(np.median(freedom)), order, width, likelihood)


def _diagonal(matrices: ComplexArray) -> Array:
    return np.asarray(np.einsum("...ii->...i", matrices).real)


def _trace_and_log_det(lines: NoiseLines, spectrum: ComplexArray) -> tuple[Array, Array]:
    """Return tr S⁻¹ C of every line, (L,), and log |det S|, for a spectrum (L, 6, 6) or (6, 6).

    Gauss's elimination in [S | C] of all lines at once: LAPACK's calls for each line take longer.
    """
    left, right = (
        np.array(np.moveaxis(np.broadcast_to(each, lines.matrices.shape), 0, -1), order="C")
        for each in (spectrum, lines.matrices)
    )
    channels = range(len(left))
    for k in channels:
        factors = left[k + 1 :, k] / left[k, k].real
        left[k + 1 :, k + 1 :] -= factors[:, None] * left[k, k + 1 :]
        right[k + 1 :] -= factors[:, None] * right[k]
    pivots = np.einsum("iil->il", left).real.copy()
    for k in reversed(channels):
        right[k] /= pivots[k]
        right[:k] -= left[:k, k][:, None] * right[k]
    # Rounding of a silent channel's zeros has either sign.
    return np.einsum("iil->l", right).real, np.sum(np.log(np.abs(pivots)), axis=0)


def _prewhitening(lines: NoiseLines, order: int) -> ComplexArray:
    """Return the response of each channel's prediction error filter, (L, 6), by Yule and Walker."""
    count, channels = lines.matrices.shape[:2]
    if order == 0 or lines.samples <= 2 * order:
        return np.ones((count, channels), dtype=np.complex128)
    correlation = np.fft.irfft(_diagonal(lines.matrices), lines.samples, axis=0)[: order + 1]
    filters = [
        np.concatenate([[1.0], -sla.solve_toeplitz(own[:-1], own[1:])]) for own in correlation.T
    ]
    return np.fft.rfft(np.transpose(filters), lines.samples, axis=0)


def _constant_size(lines: NoiseLines, filters: ComplexArray) -> Array:
    """Return the factor on the model's amplitude at the line of a constant, (L, 6).

    No contrast shows that line. The model A(z) extrapolates to it: with a memory of τ = 1 / A(1)
    samples of n, log S(0) has the variance v = 8 τ / n and a bias of −v (Marriott and Pope, 1954).
    S(0) is increased by the bias and by twice the variance.
    """
    size = np.ones(filters.shape)
    variance = 8 / np.abs(filters[0]) / (lines.samples * (lines.freedom + 1))
    size[0] = np.exp(3 * variance / 2)
    return size


def divide_spectrum(matrices: ComplexArray, response: ComplexArray) -> ComplexArray:
    """Return the spectrum, (L, 6, 6), of noise whose lines are divided by a response, (L, 6)."""
    return _colour_test(matrices, 1 / response)


def _colour_test(matrices: ComplexArray, response: ComplexArray) -> ComplexArray:
    """Return D C Dᴴ of every line for a response of the channels, (L, 6)."""
    return matrices * response[:, :, None] * response.conj()[:, None, :]


def _neighbours(
    lines: NoiseLines, widths: Sequence[int], kept: Array
) -> Iterator[tuple[ComplexArray, Array]]:
    """Yield means over ± width lines without the line itself, (L, 6, 6), and their freedom.

    Adjacent lines that share a contrast with it are left out, too. NaN without any kept line.
    """
    samples, count, most = lines.samples, len(kept), max(widths, default=0)
    own = np.arange(count)
    offsets = (-1, 0, 1) if lines.adjacent_shared else (0,)
    # The weights of the lines are summed with them, in a last column.
    values = np.column_stack([(lines.matrices * kept[:, None, None]).reshape(count, -1), kept])
    # Beyond zero and N/2 follow the conjugates of the same lines.
    circle = np.concatenate([values, values[1 : samples - count + 1].conj()[::-1]])
    around = np.arange(-most, count + most)
    sums = np.cumsum(np.concatenate([np.zeros_like(circle[:1]), circle[around % samples]]), axis=0)
    near = [circle[(own + offset) % samples] for offset in offsets]
    for width in widths:
        total = sums[most + width + 1 :][:count] - sums[most - width :][:count]
        for offset, excluded in zip(offsets, near, strict=True):
            total -= excluded
            conjugate = -(own + offset) % samples
            distance = np.minimum((own - conjugate) % samples, (conjugate - own) % samples)
            again = np.flatnonzero((distance >= len(offsets) // 2 + 1) & (distance <= width))
            total[again] -= circle[conjugate[again]]
        # Whole numbers except for the rounding of the sums.
        weight = np.rint(total[:, -1].real)
        twice = np.maximum(width - own, 0) + np.maximum(own + width - samples // 2, 0)
        share = np.where(weight > 0, 1 / np.maximum(weight, 1.0), np.nan)
        means = (total[:, :-1] * share[:, None]).reshape(lines.matrices.shape)
        yield means, lines.freedom * np.maximum(weight - twice, 1.0)


def _own_size(lines: NoiseLines, spectrum: ComplexArray, freedom: Array) -> Array:
    """Return the relative size of lines that exceed the spectrum, (L, 6): 1 for all others."""
    count, channels = len(lines.matrices), spectrum.shape[1]
    doubled = multiplicity(lines.samples) * lines.freedom
    level = _STANDING_OUT / count / 2
    each = _diagonal(lines.matrices) / _diagonal(spectrum)
    whole = _trace_and_log_det(lines, spectrum)[0] / channels
    # Of the F distribution, beyond the ratio.
    line_out = fdtrc(channels * doubled, 2 * freedom, whole) < level
    channel_out = fdtrc(doubled[:, None], 2 * freedom[:, None], each) < level / channels
    size = np.where(line_out[:, None], whole[:, None], 1.0)
    if lines.freedom < _FEWEST_CONTRASTS:
        return np.sqrt(size)
    return np.sqrt(np.where(channel_out, each, size))


def _likelihood(flat: NoiseLines, smooth: ComplexArray, own: Array, filters: ComplexArray) -> float:
    """Return Whittle's log likelihood of the lines, each predicted by its smoothed neighbours.

    `flat` are the lines after the prewhitening filters, (L, 6); the likelihood refers to the
    original ones.
    """
    scaled = replace(flat, matrices=_colour_test(flat.matrices, 1 / own.astype(np.complex128)))
    ratio, logarithm = _trace_and_log_det(scaled, smooth)
    logarithm = logarithm + 2 * np.sum(np.log(own / np.abs(filters)), axis=1)
    weight = multiplicity(flat.samples) / 2 * flat.freedom
    return float(-np.sum(weight * (logarithm + ratio)))


def contrasts(periods: Array) -> Array:
    """Return the contrasts of repeated periods, (M, N, 6): pure noise, (M − 1, N, 6).

    Every period minus the mean of the previous ones, scaled to the variance of one sample. No model
    is involved and, unlike deviations from the mean, contrasts of independent noise are
    independent.

    Examples
    --------
    >>> contrasts(np.array([[[1.0]], [[3.0]]])).round(3).tolist()
    [[[1.414]]]
    """
    before = np.cumsum(periods, axis=0)[:-1]
    number = np.arange(1, len(periods), dtype=float)[:, None, None]
    return (periods[1:] - before / number) * np.sqrt(number / (number + 1))


@dataclass(frozen=True, eq=False)
class NoiseLines:
    """Spectrum of one sample's noise in six channels at the lines of a period."""

    matrices: ComplexArray
    """(N // 2 + 1, 6, 6), Hermitian; their mean over all N lines is the covariance of a sample."""
    samples: int
    """N, of a period."""
    freedom: float
    """Complex degrees of freedom of every line (number of contrasts); inf if it was given."""
    adjacent_shared: bool = False
    """Whether adjacent lines share a contrast, as with an even number of periods."""

    @classmethod
    def of(cls, periods: Array) -> NoiseLines:
        """Estimate the spectrum from successive periods, (M, N, 6), M ≥ 2.

        A signal that repeats in every period has every M-th line of the whole recording; the M − 1
        lines about each of them are noise. Noise with a long memory jumps between the ends of a
        period. The jumps are in the spectra of single periods, but hardly in these lines, nor in
        the mean over the periods.
        """
        count, samples, channels = periods.shape
        half, last = count // 2, samples // 2
        lines = np.fft.fft(periods.reshape(-1, channels), axis=0) / np.sqrt(count * samples)
        weights = np.ones(2 * half + 1)
        weights[half] = 0.0
        if count % 2 == 0:
            weights[[0, -1]] = 0.5  # of the two lines that are equally near
        about = count * np.arange(last + 1)[:, None] + np.arange(-half, half + 1)
        noise = lines[about % len(lines)]
        matrices = np.einsum("m,lmi,lmj->lij", weights / (count - 1), noise, noise.conj())
        return cls(matrices, samples, float(count - 1), adjacent_shared=count % 2 == 0)

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample: the mean over all N lines."""
        times = multiplicity(self.samples) / self.samples
        return np.asarray(np.einsum("l,lij->ij", times, self.matrices.real))

    def first(self, kept: int | None) -> NoiseLines:
        """Return the first lines, those of a period with fewer samples; None: all lines."""
        if kept is None:
            return self
        return replace(self, matrices=self.matrices[:kept], samples=2 * kept - 1)

    def spread(self, columns: ComplexArray) -> tuple[Array, Array]:
        """Return Σ Re vᴴ C v over all N lines for columns v, (L, 6, k): (k, k).

        Also the variance of its diagonal, (k,), since C is estimated: zero if it was given.
        """
        mixed = np.matmul(self.matrices, columns) * multiplicity(self.samples)[:, None, None]
        flat, other = (each.reshape(-1, columns.shape[2]) for each in (columns, mixed))
        spread = flat.real.T @ other.real + flat.imag.T @ other.imag
        return spread, self._variance(columns.conj() * mixed)

    def _variance(self, shares: ComplexArray) -> Array:
        """Return the variance of a sum over lines and channels, (L, 6, k): (k,)."""
        if not np.isfinite(self.freedom):
            return np.zeros(shares.shape[2])
        # The two real lines have half the freedom of the others.
        relative = 2 / multiplicity(self.samples)[:, None] / self.freedom
        return np.sum(np.sum(shares.real, axis=1) ** 2 * relative / (1 + relative), axis=0)


_ROUNDING = 1e-16
"""Size of rounding errors of Lᵀ C̄ L at a line, relative to its largest eigenvalue."""
_SHOWN = 0.1
"""Largest remaining share of a jump."""


@dataclass(frozen=True, eq=False)
class WhiteningFilter:
    """Scaling and circular filter for series of one period; the filtered noise is white.

    Lines without weight are left out: of K lines remains a series of 2 K − 1 samples.
    """

    gain: ComplexArray
    """(K, 6, 6), H, Hermitian, of the first lines."""
    samples: int
    """N."""
    spectrum: ComplexArray
    """(N // 2 + 1, 6, 6), C̄ of one sample's noise."""
    smoothing: str
    """Origin of the spectrum in words."""
    freedom: float
    """Degrees of freedom of one line's spectrum; inf if it was given."""
    loss: float
    """Ratio of the actual variance of an estimate to that stated by weights from this spectrum."""
    size: Array | None = None
    """(N, 6), size of the noise by which series are divided first; None: it is constant."""

    @property
    def lag(self) -> int | None:
        """Samples before a sample that its filtered value depends on; None: all of a period."""
        return None

    @property
    def count(self) -> int:
        """Number N' of samples of the filtered series."""
        kept = len(self.gain)
        return self.samples if kept == self.samples // 2 + 1 else 2 * kept - 1

    def __call__(self, values: Array) -> Array:
        """Return series, (N, 6, …), scaled and filtered, (N', 6, …)."""
        return series_of(self._through(self.scale(values)), self.count)

    def adjoint(self, values: Array) -> Array:
        """Return Fᵀ y, (N, 6, …), of series, (N', 6, …), for this linear operation F."""
        return self.scale(series_of(self._through(values), self.samples))

    def scale(self, values: Array) -> Array:
        """Return series, (N, 6, …), divided by the size of the noise."""
        if self.size is None:
            return values
        return values / self.size.reshape(*self.size.shape, *(1,) * (values.ndim - 2))

    def rows(self, values: Array) -> Array:
        """Return real and imaginary parts of the filtered lines, (2 K, 6, …).

        Their inner products are those of the filtered series.
        """
        lines = self._through(self.scale(values))
        lines *= np.sqrt(multiplicity(self.count)).reshape(-1, *(1,) * (lines.ndim - 1))
        return np.concatenate([lines.real, lines.imag])

    def block(self, values: Array, rows: slice, before: int) -> Array:
        """Return rows of the filtered series, (n, 6, …), from a whole period."""
        return self(values)[rows.start - before : rows.stop]

    def reach(self, std: Array) -> int:
        """Return the reach of a jump's effect, in filtered samples: a quarter of them at most.

        The jump has the size of the noise's standard deviation, (6,), in one channel; its remaining
        effect is the sum of the impulse response from there on. (A share of the response itself is
        no measure: with more memory it decays alike, but is larger.)
        """
        impulse = np.zeros((self.samples, ACTUATORS, ACTUATORS))
        impulse[0] = np.diag(std)
        response = series_of(self._through(impulse), self.count)
        left = np.abs(np.cumsum(response[self.count // 2 : 0 : -1], axis=0))[::-1]
        shown = np.any(left > _SHOWN * std[:, None], axis=(1, 2))
        return min(int(np.max(np.flatnonzero(shown) + 1, initial=0)), self.count // 4)

    def _through(self, values: Array) -> ComplexArray:
        """Return the filtered lines, (K, 6, …), of series, (n, 6, …)."""
        lines = lines_of(values)[: len(self.gain)]
        flat = np.matmul(self.gain, lines.reshape(*lines.shape[:2], -1))
        return np.asarray(flat.reshape(lines.shape), dtype=np.complex128)


def filter_to(covariance: Array, spectrum: ComplexArray) -> ComplexArray:
    """Return the Hermitian H with H C̄ Hᴴ = Σ of every line that is nearest to unity."""
    # The geometric mean of Σ and C̄⁻¹: L (Lᵀ C̄ L)^(−1/2) Lᵀ with Σ = L Lᵀ.
    root = np.linalg.cholesky(covariance)
    values, vectors = np.linalg.eigh(root.T @ spectrum @ root)
    # Noise that an unknown low pass has taken leaves rounding errors of either sign.
    least = _ROUNDING * np.max(values, axis=-1, keepdims=True)
    values = np.maximum(values, np.maximum(least, np.finfo(np.float64).tiny))
    half = root @ vectors / values[:, None] ** 0.25
    return np.asarray(half @ half.conj().transpose(0, 2, 1))


def given_filter(covariance: Array, spectrum: ComplexArray, samples: int) -> WhiteningFilter:
    """Return the filter for noise with a known spectrum at the lines of a period."""
    gain = filter_to(covariance, spectrum)
    return WhiteningFilter(gain, samples, spectrum, "the spectrum given", freedom=np.inf, loss=1.0)


def scaling_filter(covariance: Array, samples: int) -> WhiteningFilter:
    """Return the filter that leaves white noise of this covariance unchanged."""
    every = (samples // 2 + 1, *covariance.shape)
    unity = np.broadcast_to(np.eye(len(covariance), dtype=np.complex128), every)
    spectrum = np.broadcast_to(covariance.astype(np.complex128), every)
    return WhiteningFilter(unity, samples, spectrum, "white", freedom=np.inf, loss=1.0)


def estimated_filter(
    lines: NoiseLines, covariance: Array, *, always: bool = False
) -> WhiteningFilter | None:
    """Return the filter for measured lines; None if white noise is not rejected.

    With `always`, the best filter is returned; None only for periods with too few samples to
    smooth.
    """
    found = smoothed_spectrum(lines, covariance, always=always)
    if found is None:
        return None
    gain, freedom = filter_to(covariance, found.matrices), found.freedom
    return WhiteningFilter(
        gain, lines.samples, found.matrices, found.words, 2 * freedom, _loss(freedom)
    )


def _loss(freedom: float, channels: int = ACTUATORS) -> float:
    """Return E[C̄⁻¹ C C̄⁻¹] / E[C̄⁻¹] of a complex Wishart matrix C̄: 1 for infinite freedom."""
    if np.isinf(freedom):
        return 1.0
    # With fewer, the mean of the inverse does not exist.
    nu = max(freedom, channels + 2.0)
    return nu**2 / ((nu - channels) ** 2 - 1)
