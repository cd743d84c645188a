"""Which terms a selection finds, and what the intervals are worth after it.

PaLiDA on the best stored design, measured on the twin: 200 periods of 250 samples, 50 000 in all,
as 30 periods at 1 kHz have. The machine has the terms of a section; the user's robot file has none
of them, and every other term of the catalogue is a candidate. The whole way is that of `expdesign
estimate`, by Gauss–Markov; in `…-ml` by Maximum Likelihood.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies import claim_row, summary
from constraints.arrays import Mask
from estimation.diagnostics.linearisation import linearise
from estimation.diagnostics.residual_covariance import held_out_residual_covariance
from estimation.diagnostics.residuals import lack_of_fit
from estimation.identification import Estimation, estimate_parameters, prepare_experiment
from estimation.identification.term_selection import Selection
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration, load_run
from expdesign.configuration.experiment import ValidationMotion
from expdesign.configuration.robot import load_robot_description
from expdesign.motion.benchmark import motion_of_run
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

__all__ = ["SECTIONS", "TITLE", "rows", "summary"]

TITLE = "Selection of terms"
PERIODS, SAMPLES = 200, 250
_AS_TEN = 67
"""Periods that have as many samples as ten at 1 kHz."""
VALIDATED = 20
"""Runs whose prediction of another motion is tested."""

_PITCH = 0.03
_EVERYTHING = ("stribeck", "drive_inertia", "force_offset", "asymmetric_friction", "cogging")
_CANDIDATES: list[Any] = [
    {"stribeck": {"velocity": 0.05}},
    "drive_inertia",
    "force_offset",
    "load_friction",
    {"cable": {"rest_length": 0.6}},
    "asymmetric_friction",
    "quadratic_friction",
    "cubic_friction",
    {"cogging": {"pitch": _PITCH}},
    "cogging_second",
    {"gravity_compensation": {"base_x": 0.0, "base_y": 0.0, "base_z": 0.0, "length": 0.65}},
    {"payload": {"x": 0.05}},
]

Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A machine with further terms."""

    planted: tuple[str, ...] = ()
    noise: Mapping[str, Any] = field(default_factory=dict)
    others: tuple[str, ...] = ()
    """Criteria that choose, too, beside Schwarz's."""
    estimators: tuple[str, ...] = ("gm",)
    """The last one's intervals and prediction are judged."""
    periods: int = PERIODS
    judged: bool = True
    """False: the term is too weak for these data, and nothing is claimed of it."""


SECTIONS = {
    "clean": Case(others=("f", "holdout")),
    "clean-coloured": Case(noise={"force_spectrum": {"ar": 0.9}}),
    "cogging": Case(("cogging",)),
    "stribeck": Case(("stribeck",)),
    "stribeck-weak": Case(("stribeck",), others=("f",), periods=_AS_TEN, judged=False),
    "asymmetric": Case(("asymmetric_friction", "force_offset")),
    "screw": Case(("drive_inertia",)),
    "all": Case(_EVERYTHING, others=("f", "holdout")),
    "all-ml": Case(_EVERYTHING, estimators=("gm", "ml")),
}
"""Cogging: 12 N at 30 mm. Stribeck: 40 % of the dry friction, at 50 mm/s. Asymmetric: dry and
viscous friction are 20 % more when extending, and as much less when retracting. Screw: 1 kg of
drive inertia. The weak case has a third of the samples, as ten periods at 1 kHz have."""


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield what is found in a section."""
    case, count = SECTIONS[section], repetitions or 100
    found = [_run(section, number) for number in range(1, count + 1)]
    right = frozenset(case.planted)
    for by in ("bic", *case.others):
        chosen = [one.chosen[by] for one in found]
        yield from _choices(by, right, chosen, judged=case.judged and by == "bic")
    everything, planted = [one.held for one in found], [one.held_planted for one in found]
    yield _coverage("95 % intervals of all parameters after it", everything, judge=case.judged)
    if right:
        yield _coverage("of those of the planted terms", planted, judge=case.judged)
    unlike = [one for one in found if one.chosen["bic"] != right]
    if unlike and len(unlike) < len(found):
        yield _coverage(
            "of runs that chose another model", [one.held for one in unlike], judge=False
        )
    passes = [one.passes for one in found if one.passes is not None]
    yield _predicts(passes, judge=case.judged)
    yield claim_row("dispersion", f"{np.mean([one.dispersion for one in found]):.3f} in the mean")
    if right:
        yield _strength(section)


def _choices(
    by: str, right: frozenset[str], chosen: list[frozenset[str]], *, judged: bool
) -> Iterator[Row]:
    """Yield how often the right terms were chosen, and how often no other."""
    count = len(chosen)

    def share(what: str, hits: int, least: float) -> Row:
        text = f"{100 * hits / count:.0f} % of {count}"
        return claim_row(f"{by}: {what}", text, hits >= least * count if judged else None)

    exact = sum(one == right for one in chosen)
    if right:
        contains = sum(one >= right for one in chosen)
        yield share("the planted terms are chosen in 95 % or more", contains, 0.95)
        yield share("no others in 85 % or more", exact, 0.85)
    else:
        yield share("nothing is added in 90 % or more", exact, 0.9)
    wrong = Counter(
        " ".join([*(f"+{name}" for name in sorted(one - right)), *(f"-{n}" for n in right - one)])
        for one in chosen
        if one != right
    )
    if wrong:
        yield claim_row(
            f"{by}: what else was chosen (+) or missed (-)",
            "; ".join(f"{text}: {n}" for text, n in wrong.most_common()),
        )


def _coverage(what: str, held: list[Mask], *, judge: bool = True) -> Row:
    """Return how many intervals hold the truth; the runs are independent, parameters are not."""
    shares = np.array([np.mean(one) for one in held if len(one)])
    if not len(shares):
        return claim_row(what, "none was chosen")
    share = float(np.mean(np.concatenate(held)))
    error = float(np.std(shares, ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else np.nan
    text = f"{100 * share:.1f}{f' ± {100 * error:.1f}' if np.isfinite(error) else ''} %"
    claim = f"{what} hold the truth in 92 … 97 %" if judge else what
    return claim_row(claim, text, 0.92 <= share <= 0.97 if judge else None)  # noqa: PLR2004


def _predicts(passes: list[Mask], *, judge: bool) -> Row:
    """Return how often all actuators pass the lack-of-fit test on a circle."""
    count = sum(bool(np.all(one)) for one in passes)
    return claim_row(
        "all six actuators pass the test of a prediction that was not fitted (level 1 %)",
        f"{count} of {len(passes)}",
        count >= 0.9 * len(passes) if judge else None,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """What one run found."""

    chosen: Mapping[str, frozenset[str]]
    held: Mask
    held_planted: Mask
    passes: Mask | None
    dispersion: float


def _run(section: str, number: int) -> _Found:
    case, run = SECTIONS[section], configuration(section)
    twin, own = _twin(section), robot_from(run.robot)
    result = estimate_parameters(run, twin.measurement(number), design())
    if result.selection is None:
        raise RuntimeError("the run selects")
    chosen = {"bic": frozenset(result.selection.chosen)}
    if case.others:
        experiment = prepare_experiment(run, own, twin.measurement(number), design())
        for by in case.others:
            other = Selection.of(configuration(section, by), own, [experiment])
            chosen[by] = frozenset(() if other is None else other.chosen)
    truth = twin.truth.values_of([row.parameter for row in result.rows])
    held = np.array(
        [row.ci_low <= value <= row.ci_high for row, value in zip(result.rows, truth, strict=True)]
    )
    planted = np.array([row.parameter not in own.parameter_names for row in result.rows])
    return _Found(
        chosen,
        held,
        held[planted],
        _passes(section, number, result) if number <= VALIDATED else None,
        result.selection.dispersion,
    )


def _passes(section: str, number: int, result: Estimation) -> Mask:
    """Return which actuators pass on a circle that nothing was fitted to."""
    circle, twin = _circle(section)
    best = result.best
    robot = result.robot.with_load_at(best.values)
    data = twin.measurement(number)
    experiment = prepare_experiment(result.configuration, robot, data, circle, held_out=True)
    if experiment.fit is None:
        raise RuntimeError("the motion is a series")
    free = result.priors.free
    part = linearise(robot, experiment, best.values, free, experiment.fit.motion)
    white = part.apply_filters(experiment.noise)
    return ~lack_of_fit(white, held_out_residual_covariance(white, experiment, best)).failed


def _strength(section: str) -> Row:
    """Return χ² of each planted term beside the others, in one run."""
    result = estimate_parameters(configuration(section), _twin(section).measurement(1), design())
    steps = () if result.selection is None else result.selection.steps
    planted = SECTIONS[section].planted
    last = {row.term: row for row in steps if row.term in planted}
    texts = (f"{n}: {row.statistic:.0f} of {row.parameters}" for n, row in last.items())
    return claim_row("χ² of the planted terms when last tried, first run", "; ".join(texts))


@cache
def design() -> FourierTrajectory:
    """Return a stored design, one of the best."""
    return TrajectoryFile.read(Path(__file__).parent / "designs" / "palida_former.json").trajectory


@cache
def configuration(section: str, by: str = "bic") -> RunConfiguration:
    """Return the run of a user who knows nothing of the further terms."""
    case = SECTIONS[section]
    return load_run(
        {
            "name": f"select-{section}",
            "robot": "palida",
            "noise": dict(case.noise),
            "experiment": {
                "periods": case.periods,
                "sampling": SAMPLES / design().period,
                "truth": machine(case.planted),
            },
            "estimate": {
                "estimators": list(case.estimators),
                "harmonics": 5,
                "select": {"candidates": _CANDIDATES, "by": by},
            },
        }
    )


def machine(planted: tuple[str, ...]) -> dict[str, Any]:
    """Return PaLiDA's file with terms planted."""
    file = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    known, share = file["parameters"], 2 * np.pi / 7
    values: dict[str, dict[str, float]] = {
        "stribeck": {f"s{j}": 0.4 * known[f"r{j}"] for j in range(1, 7)},
        "drive_inertia": {"m_drive": 1.0},
        "force_offset": {f"o{j}": 0.2 * known[f"r{j}"] for j in range(1, 7)},
        "asymmetric_friction": {f"a{j}": 0.2 * known[f"v{j}"] for j in range(1, 7)},
        "cogging": {
            f"{kind}{j}": 12 * float(part(share * j))
            for kind, part in (("cs", np.cos), ("cc", np.sin))
            for j in range(1, 7)
        },
    }
    written = {next(iter(t)) if isinstance(t, dict) else t: t for t in _CANDIDATES}
    return file | {
        "terms": [*file["terms"], *(written[name] for name in planted)],
        "parameters": known | {k: v for name in planted for k, v in values[name].items()},
    }


@cache
def _twin(section: str) -> Twin:
    return Twin.of(configuration(section), design())


@cache
def _circle(section: str) -> tuple[FourierTrajectory, Twin]:
    """Return a circle and the machine that makes it, 10 periods at about 270 Hz."""
    run = configuration(section)
    motion = ValidationMotion(motion="circle")
    circle = motion_of_run(run, motion, run.robot.home, "validate[1]")
    changed = run.with_section("experiment", periods=10, sampling=SAMPLES / circle.period)
    return circle, Twin.of(changed, circle, seed=7)
