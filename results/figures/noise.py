"""The noise of forces and lengths: distribution and covariance, the paper's Figs. 4 and 5."""

from __future__ import annotations

import numpy as np
import scipy
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import RecordingDiagnosis
from estimation.diagnostics.noise_result import NoiseResult, correlation_of
from results.figures.drawing import (
    ALERT,
    BLUE,
    INK,
    STRUT_COLOURS,
    VERMILLION,
    draw_correlation,
    figure_definition,
    label_figure,
    name_places,
    strut_panels,
    write_centred,
    write_corner,
)
from results.notation import handy_unit, plain_number


@figure_definition(
    "noise_distribution",
    "Distribution of the force noise of each actuator and the normal curve with the same "
    "mean and standard deviation; skewness, excess kurtosis and the p-value of normality.",
    height=4.3,
)
def noise_distribution_figure(figure: Figure, pictures: NoiseResult | RecordingDiagnosis) -> None:
    """Draw a histogram per actuator; values beyond the axis count in its outer bins."""
    bins, test = pictures.histogram, pictures.force_normality
    reach = float(bins.high[-1])
    for j, axes in enumerate(strut_panels(figure, "Actuator", share=True)):
        axes.hist(
            bins.low,
            bins=[*bins.low.tolist(), reach],
            weights=bins.counts[:, j],
            density=True,
            color=STRUT_COLOURS[j],
            alpha=0.55,
            linewidth=0,
        )
        grid = np.linspace(-reach, reach, 400)
        curve = scipy.stats.norm.pdf(grid, test.mean[j], test.std[j])
        axes.plot(grid, curve, color=INK, linewidth=1.0)
        axes.set_xlim(-reach, reach)
        axes.grid(visible=False, axis="x")
        write_corner(
            axes,
            f"std {plain_number(test.std[j], 3)} N\nskew {_signed(test.skewness[j])}\n"
            f"kurt {_signed(test.kurtosis[j])}\np = {plain_number(test.p_values[j], 2)}",
        )
    label_figure(figure, "Noise of one force sample (N)", "Probability density (1/N)")


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


@figure_definition(
    "noise_quantiles",
    "Quantiles of the force noise of each actuator against those of the normal "
    "distribution. Grey: where each point lies with a probability of 95 % if the noise is normal.",
    height=4.6,
)
def noise_quantiles_figure(figure: Figure, pictures: NoiseResult | RecordingDiagnosis) -> None:
    """Draw quantiles in standard deviations, dense in the tails, with their 95 % band."""
    found = pictures.quantiles
    for j, axes in enumerate(strut_panels(figure, "Actuator", share=True)):
        axes.fill_between(
            found.normal, found.low, found.high, color="#e4e4e4", linewidth=0, zorder=1
        )
        axes.plot(found.normal, found.normal, color=INK, linewidth=0.8, zorder=2)
        axes.plot(
            found.normal, found.noise[:, j], ".", color=STRUT_COLOURS[j], markersize=2.4, zorder=3
        )
    label_figure(
        figure,
        "Quantile of the normal distribution (standard deviations)",
        "Quantile of the noise (standard deviations)",
    )


_DARK = 0.6
"""Correlation from which on text is white."""


@figure_definition(
    "noise_covariance",
    "Covariances of the noise: correlations (left) and standard deviations with their 95 % "
    "intervals (right) of forces (above) and strut lengths (below).",
    height=5.6,
)
def noise_covariance_figure(figure: Figure, pictures: NoiseResult | RecordingDiagnosis) -> None:
    """Draw the forces above and the lengths below."""
    noise = pictures.noise
    panels = figure.subplots(2, 2, gridspec_kw={"width_ratios": [1.15, 1.0]})
    forces, lengths = (
        ("N", r"forces, $\Sigma$", "$Q_{%d}$"),
        ("m", r"lengths, $\Delta$", "$q_{%d}$"),
    )
    _pair(panels[0], noise.force_covariance, noise.force_freedom, *forces)
    _pair(panels[1], noise.length_covariance, noise.length_freedom, *lengths)


def _pair(
    panels: NDArray[np.object_],
    covariance: Array,
    freedom: float,
    unit: str,
    title: str,
    channel: str,
) -> None:

    colours = LinearSegmentedColormap.from_list("correlation", [BLUE, "#ffffff", VERMILLION])
    std = np.sqrt(np.diag(covariance))
    correlation = correlation_of(covariance)
    names = [channel % j for j in range(1, len(std) + 1)]
    draw_correlation(panels[0], correlation, names, colours)
    for (i, j), value in np.ndenumerate(correlation):
        panels[0].text(
            j,
            i,
            "1" if i == j else f"{value:.2f}".replace("-", "−"),
            ha="center",
            va="center",
            fontsize="small",
            color="white" if abs(value) > _DARK else INK,
        )
    panels[0].set_title(f"Correlation of the {title}")
    shown = handy_unit(unit, std)
    axes = panels[1]
    error = shown.shown(std / np.sqrt(2 * freedom)) * 1.96 if np.isfinite(freedom) else None
    axes.bar(
        np.arange(len(std)),
        shown.shown(std),
        width=0.62,
        color=STRUT_COLOURS,
        yerr=error,
        error_kw={"ecolor": INK, "elinewidth": 0.9, "capsize": 2.5},
        zorder=2,
    )
    name_places(axes, names)
    axes.set_ylabel(shown.label("Standard deviation"))
    axes.set_title(f"Standard deviation of the {title.split(',', maxsplit=1)[0]}")


_HEADROOM = 0.25
"""Above the densities, for the words in the corners: a share of the axis."""


@figure_definition(
    "noise_spectrum",
    "Smoothed spectral density of the force noise of each actuator with its 95 % band, whose ends "
    "in the middle of the frequencies are in the corner; dashed: white noise of the same size. "
    "Marked: a hum of the mains, with its amplitude.",
    height=4.6,
)
def noise_spectrum_figure(figure: Figure, result: NoiseResult) -> None:
    """Draw density over frequency, both logarithmic; a hum is a line next to it."""
    found = result.force_density
    panels = strut_panels(figure, "Actuator", share=True)
    shown = found.frequency > 0
    if not np.any(shown):
        for axes in panels:
            write_centred(axes, "no two periods can be compared")
        return
    low, high = found.band()
    for j, axes in enumerate(panels):
        frequency = found.frequency[shown]
        axes.fill_between(
            frequency, low[shown, j], high[shown, j], color=STRUT_COLOURS[j], alpha=0.4, linewidth=0
        )
        axes.plot(frequency, found.density[shown, j], color=STRUT_COLOURS[j], linewidth=0.6)
        axes.axhline(found.white[j], color=INK, linewidth=0.8, dashes=(4, 2))
        # A band of few per cent is thinner than any line of a plot over decades.
        middle = int(np.argmin(np.abs(np.log(frequency**2 / (frequency[0] * frequency[-1])))))
        ends = [end[shown, j][middle] / found.density[shown, j][middle] - 1 for end in (low, high)]
        words = [f"95 %: {_percent(ends[0])} … {_percent(ends[1])} %"]
        for row in np.flatnonzero(found.amplitude[:, j] > 0):
            axes.axvline(found.frequency[row], color=ALERT, linewidth=0.9)
            words.append(
                f"{plain_number(found.frequency[row], 4)} Hz: "
                f"{plain_number(found.amplitude[row, j], 2)} N"
            )
        write_corner(axes, "\n".join(words))
        axes.set_xscale("log")
        axes.set_yscale("log")
    bottom, top = panels[0].get_ylim()
    panels[0].set_ylim(bottom, top * (top / bottom) ** _HEADROOM)
    label_figure(figure, "Frequency (Hz)", "Density of the force noise (N²/Hz)")


def _percent(share: float) -> str:
    return f"{'−' if share < 0 else '+'}{plain_number(abs(100 * share), 2)}"


SPECTRUM_FIGURES = (noise_spectrum_figure,)
"""Figures of a noise analysis in addition to `NOISE_FIGURES`."""

NOISE_FIGURES = (noise_distribution_figure, noise_quantiles_figure, noise_covariance_figure)
"""Figures of the noise, in the order of a report."""
