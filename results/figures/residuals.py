"""Figures of errors: residual forces, errors of a prediction, and tracking errors."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import RecordingDiagnosis
from estimation.diagnostics.residuals import ForceResiduals
from estimation.feedforward.result import MEANINGS, CaseName, FeedforwardResult
from estimation.validation.validate import PredictionResiduals
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures import drawing
from results.notation import handy_unit

_BAND = 1.96
_REACH = 0.9995
"""Share of the residuals that the panels show: one outlier shall not flatten all six."""


def _residuals_seen(result: RecordingDiagnosis | PredictionResiduals) -> str:
    """Return the actuators that fail the test of lack of fit, and the largest statistic."""
    test = result.tests.lack_of_fit
    if test.refused or not np.any(np.isfinite(test.statistic)):
        return ""
    failed = ", ".join(str(j) for j, one in enumerate(test.failed, 1) if one) or "none"
    worst = int(np.nanargmax(test.statistic))
    largest = f"the largest F is {test.statistic[worst]:.2f}, of actuator {worst + 1}"
    return f"Actuators that fail: {failed}; {largest}."


@drawing.figure_definition(
    "residuals",
    "Residual force of each actuator over one period, mean over the periods. Dashed: where "
    "the noise alone leaves 95 % of it. F: bias against the scatter between the periods.",
    height=5.4,
    seen=_residuals_seen,
)
def residuals_figure(figure: Figure, result: RecordingDiagnosis) -> None:
    """Draw the residuals of an estimate over one period."""
    rest, test = result.residuals, result.tests.lack_of_fit
    for j, axes in enumerate(_residual_panels(figure, rest, rest.time, room=1.25)):
        if not test.refused:
            words = "bias" if test.failed[j] else "no bias"
            drawing.write_corner(axes, f"{words}: F = {test.statistic[j]:.2f}")


@drawing.figure_definition(
    "prediction",
    "Error of the predicted force of each actuator on a motion that was not used for the "
    "estimate. Dashed: where the noise alone leaves 95 % of it.",
    height=5.4,
    seen=_residuals_seen,
)
def prediction_figure(figure: Figure, motion: PredictionResiduals) -> None:
    """Draw the error of the prediction of a motion."""
    rest, test = motion.residuals, motion.tests.lack_of_fit
    panels = _residual_panels(figure, rest, rest.time - rest.time[0], room=1.3)
    for j, axes in enumerate(panels):
        if test.refused:
            drawing.write_corner(axes, "not tested")
            continue
        words = "fails" if test.failed[j] else "passes"
        drawing.write_corner(axes, f"{words}: F = {test.statistic[j]:.2f}")
        if test.failed[j]:
            axes.texts[-1].set_color(drawing.ALERT)
    figure.suptitle(motion.name, fontsize="medium")


def _residual_panels(
    figure: Figure, rest: ForceResiduals, time: Array, *, room: float
) -> tuple[Axes, ...]:
    """Draw the residuals with the band in which noise alone leaves 95 % of them."""
    height = 1.1 * float(np.max(np.quantile(np.abs(rest.forces), _REACH, axis=0)))
    height = max(height, 1.3 * _BAND * float(np.max(rest.std)))
    panels = drawing.strut_panels(figure, "Actuator", (3, 2), share=True)
    for j, axes in enumerate(panels):
        band = _BAND * rest.std[:, j]
        axes.plot(time, rest.forces[:, j], color=drawing.STRUT_COLOURS[j], linewidth=0.5, zorder=2)
        for sign in (1, -1):
            axes.plot(
                time,
                sign * band,
                color=drawing.MUTED,
                linewidth=0.8,
                linestyle=(0, (4, 2)),
                zorder=3,
            )
        axes.set_ylim(-height, room * height)
        axes.set_xlim(time[0], time[-1])
    drawing.label_figure(
        figure,
        "Time (s); dashed: 95 % range of the noise alone",
        "Measured − predicted force, mean over the periods (N)",
    )
    return panels


@drawing.figure_definition(
    "residual_dependence",
    "Residual force of each actuator, averaged in bins of its strut's length, speed, acceleration "
    "and load (the predicted force), with 95 % intervals from the noise. Above: share of the "
    "unexplained force that smooth functions of it explain, where the test of all actuators fails.",
    height=7.8,
)
def residual_dependence_figure(figure: Figure, result: RecordingDiagnosis) -> None:
    """Draw one row per strut: means in bins with their 95 % intervals."""
    columns = (("length", "m"), ("speed", "m/s"), ("acceleration", "m/s^2"), ("load", "N"))
    panels = figure.subplots(ACTUATORS, len(columns), sharex="col", sharey=True)
    shares = result.tests.harmonic_lack_of_fit.shares
    for column, (over, si) in enumerate(columns):
        rows = [row for row in result.dependence if row.over == over]
        unit = handy_unit(si, [row.centre for row in rows])
        for j in range(ACTUATORS):
            axes = panels[j, column]
            axes.axhline(0, color=drawing.MUTED, linewidth=0.7, zorder=1)
            bins = np.array(
                [(r.centre, r.mean, r.half_width) for r in rows if r.strut == j + 1]
            ).reshape(-1, 3)
            axes.errorbar(
                unit.shown(bins[:, 0]),
                bins[:, 1],
                yerr=bins[:, 2],
                fmt="o",
                markersize=1.6,
                color=drawing.STRUT_COLOURS[j],
                elinewidth=0.8,
                zorder=2,
            )
            if column == 0:
                axes.set_ylabel(f"{j + 1}", rotation=0, labelpad=10, va="center", weight="bold")
        panels[-1, column].set_xlabel(unit.label(over.capitalize()))
        share = f": {100 * shares[over]:.0f} %" if over in shares else ""
        panels[0, column].set_title(f"{over.capitalize()}{share}", fontsize="medium")
    figure.supylabel("Strut: mean residual force (N)", fontsize="medium")


@drawing.figure_definition(
    "position_periodic",
    "Search for forces that are periodic in each strut's length (cogging): statistic over "
    "the pitch, grey in the residuals, coloured with the effects that were found taken out. "
    "Dashed: significant over all struts and pitches (family level 0.1 %).",
    height=5.4,
)
def position_periodic_figure(figure: Figure, result: RecordingDiagnosis) -> None:
    """Draw the statistic over the pitch, of the residuals before and after the compensation."""
    tests = result.tests
    forces = {e.strut: e.force for e in tests.effects if e.force is not None}
    panels = drawing.strut_panels(figure, "Strut", (3, 2), share=True)
    for strut, (axes, scan) in enumerate(zip(panels, tests.position_periodic, strict=True)):
        rows = [row for row in result.pitches if row.strut == strut + 1]
        if not rows:
            drawing.write_centred(axes, "not scanned", color=drawing.MUTED)
            continue
        pitch = [1e3 * row.pitch for row in rows]
        if tests.effects:
            first = [row.statistic for row in rows]
            axes.plot(pitch, first, color=drawing.FAINT, linewidth=0.9, zorder=2)
        last = [row.statistic_with_effects for row in rows]
        axes.plot(pitch, last, color=drawing.STRUT_COLOURS[strut], linewidth=0.9, zorder=3)
        axes.axhline(
            scan.critical, color=drawing.ALERT, linewidth=0.9, linestyle=(0, (4, 2)), zorder=4
        )
        force = forces.get(strut)
        if force is not None:
            drawing.write_corner(
                axes,
                f"position-periodic:\n{force.amplitude:.3g} ± {force.amplitude_std:.1g} N\n"
                f"pitch {1e3 * force.pitch:.3f} mm",
            )
    shared, critical = panels[0], tests.position_periodic[0].critical
    shared.set_xscale("log")
    drawing.label_decades(shared.xaxis)
    linear = 2 * critical if np.isfinite(critical) else 60.0
    shared.set_yscale("symlog", linthresh=linear, linscale=1.6)
    shared.set_ylim(bottom=0)
    drawing.label_figure(figure, "Pitch (mm)", "Statistic (χ² of sine and cosine)")


DIAGNOSTIC_FIGURES = (residuals_figure, residual_dependence_figure, position_periodic_figure)
"""Figures of the residuals, in the order of a report."""


_COLOURS: dict[CaseName, str] = {
    "none": drawing.GREY,
    "gravity": drawing.ORANGE,
    "nominal": drawing.VERMILLION,
    "identified": drawing.BLUE,
    "true": drawing.GREEN,
}


@drawing.figure_definition(
    "feedforward",
    "Error of the position over one period under the same controller, feed-forward by "
    "feed-forward. Above: distance of the TCP from its place; below: rms error of each strut.",
    height=5.0,
)
def feedforward_figure(figure: Figure, result: FeedforwardResult) -> None:
    """Draw the TCP's error over time, and the rms errors of the struts."""
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    cases = [each.case for each in result.cases]
    unit = handy_unit("m", [each.max_position for each in result.cases])
    for case, tracking in zip(cases, result.tracking, strict=True):
        look = {"linestyle": (0, (2, 1.5))} if case == "true" else {}
        above.plot(
            tracking.time,
            unit.shown(tracking.position),
            color=_COLOURS[case],
            linewidth=0.9,
            **look,
        )
    above.set_yscale("log")
    drawing.label_decades(above.yaxis)
    above.set_xlim(0, result.tracking[0].time[-1])
    above.set_xlabel("Time (s)")
    above.set_ylabel(unit.label("Error of the TCP"))
    struts = handy_unit("m", [row.rms for row in result.rows])
    width = 0.5 / len(cases)
    for place, case in enumerate(cases):
        sizes = [row.rms for row in result.rows if row.case == case]
        middle = np.arange(ACTUATORS) + (place - (len(cases) - 1) / 2) * width
        below.plot(middle, struts.shown(sizes), "o", color=_COLOURS[case], markersize=4.5)
    below.set_yscale("log")
    drawing.label_decades(below.yaxis)
    drawing.name_places(below, [f"strut {j}" for j in range(1, ACTUATORS + 1)])
    below.set_ylabel(struts.label("Rms error"))
    handles = [
        Line2D([], [], color=_COLOURS[case], linewidth=2.0, label=MEANINGS[case]) for case in cases
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
