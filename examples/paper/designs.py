"""Statistical against deterministic design of experiments: the paper's Section IV-C.

Designs with the criteria log det F and condition number start from the same initial parameters: one
random motion for each set. Each design is executed many times on the digital twin, with exact
lengths, and with noisy lengths and Fourier or central differentiation, and evaluated with LS and
GM. No two designs share their noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from constraints.arrays import Array, Mask
from estimation.montecarlo.study import Workbench
from estimation.twin import Twin
from estimation.uncertainty.intervals import FAMILY_LEVEL
from examples.paper.comparison import compare_determinants, mean_difference
from examples.paper.setting import Claim, Setting, StudyResult, completeness_claim, run_in_processes
from expdesign import DesignResult, Robot, design
from expdesign.configuration import RunConfiguration
from expdesign.information.fisher import PeriodicNoise
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms import parameter_unit, rigid_platform, struts
from expdesign.robot import robot_from
from expdesign.workers import Job, Monitor

CRITERIA = ("d", "condition")
ESTIMATORS = ("ls", "gm")
KINEMATICS = {
    "exact": "without noise of the lengths",
    "fourier": "with noise of the lengths, Fourier differentiation",
    "central": "with noise of the lengths, central differences",
}
_SHOWN = ("p10", "r1", "v1")
_SETS, _REPETITIONS = 5, 100
_SEEDS_APART = 1_000_003
_EXACT = 1e-6
"""Length noise of exact kinematics, as a share of the robot's: an estimate needs some."""

_CLEAR = 4.0
"""Standard errors by which determinants must differ, and within which predictions must agree."""

_GRID = 2000


@dataclass(frozen=True, eq=False)
class Trial:
    """One criterion from one set of initial parameters, SI.

    `predicted` holds the covariances (m, m) of LS and GM with exact kinematics, `values` the
    estimates (K, m) by kinematics and estimator.
    """

    number: int
    criterion: str
    design: DesignResult
    predicted: dict[str, Array]
    values: dict[str, dict[str, Array]]

    @property
    def name(self) -> str:
        """Name of the design's folder."""
        return f"{self.number}-{self.criterion}"

    @property
    def keys(self) -> dict[str, Any]:
        """Columns that identify the trial in a table."""
        return {"set": self.number, "criterion": self.criterion}

    def predicted_std(self, estimator: str) -> Array:
        """Return the standard deviations predicted with exact kinematics, (m,), SI."""
        return np.asarray(np.sqrt(np.diag(self.predicted[estimator])))

    def agreement(self, kinematics: str, estimator: str) -> dict[str, float]:
        """Compare the achieved variances with the predicted ones, as a mean over the parameters."""
        values = self.values[kinematics][estimator]
        count = len(values)
        off = (values - values.mean(axis=0)) ** 2 * count / (count - 1)
        squares = np.mean(off / np.diag(self.predicted[estimator]), axis=1)
        ratio, error = float(np.mean(squares)), float(np.std(squares, ddof=1) / np.sqrt(count))
        return {"variance_ratio": ratio, "std_error": error, "z": (ratio - 1) / error}


def study_designs(setting: Setting, out: Path) -> StudyResult:
    """Compare designs of both criteria by the estimates that they lead to.

    Every design becomes a run folder in ``designs/`` of `out`, ready for `expdesign compare`.
    """
    robot = robot_from(setting.configuration().robot)
    count = _repetitions(setting, robot)
    trials = run_trials(setting, robot, count)
    for trial in trials:
        trial.design.write(out / "designs" / trial.name)
    tables = {name: pd.DataFrame(rows) for name, rows in _tables(trials, robot).items()}
    kept = sum(len(trial.values[kind]["ls"]) for trial, kind in product(trials, KINEMATICS))
    good = sum(trial.design.passed for trial in trials)
    claims = (
        *_determinant_claims(tables["determinants"]),
        *(_precision_claims(tables["determinants"], trials) if setting.is_paper_robot else ()),
        _motion_claim(tables["designs"]),
        *_agreement_claims(tables["agreement"], trials),
        *(_mean_claim(setting, tables["means"], kinematics) for kinematics in KINEMATICS),
        completeness_claim("experiment", kept, len(trials) * len(KINEMATICS) * count),
        Claim(
            f"every design ({' and '.join(CRITERIA)}) keeps every limit",
            f"{good} of {len(trials)}",
            holds=good == len(trials),
        ),
    )
    return StudyResult("Two criteria of design", claims, tables)


# --- designs and their experiments ----------------------------------------------------------------


def run_trials(setting: Setting, robot: Robot, count: int) -> tuple[Trial, ...]:
    """Design with both criteria from every set, and repeat every experiment `count` times."""
    build = partial(replace, setting)
    pairs = list(product(range(1, 1 + (1 if setting.quick else _SETS)), CRITERIA))
    jobs = [Job(_make_design, pair) for pair in pairs]
    designs = list(run_in_processes(setting, "designs", build, jobs))
    cases = list(product(range(len(pairs)), KINEMATICS))
    jobs = [Job(_execute, (index, designs[index], kind, count)) for index, kind in cases]
    found = run_in_processes(setting, "experiments with a design", build, jobs)
    values = dict(zip(cases, found, strict=True))
    return tuple(
        Trial(
            *pair,
            made,
            linear_covariances(robot, _workbench(setting, index, made, "exact").twin),
            {kind: values[index, kind] for kind in KINEMATICS},
        )
        for index, (pair, made) in enumerate(zip(pairs, designs, strict=True))
    )


def _repetitions(setting: Setting, robot: Robot) -> int:
    """Return a number of repetitions: the covariance of m parameters takes more than m."""
    size = len(robot.parameter_names)
    return size + 1 if setting.quick else max(_REPETITIONS, 4 * size)


def _configuration(setting: Setting, **sections: Any) -> RunConfiguration:
    """Load the study's run: about 200 samples per period, as the information counts them."""
    if not setting.quick:
        sections = {
            "trajectory": {"controller_period": "10 ms"},
            "experiment": {"periods": 10, "sampling": "100 Hz"},
            **sections,
            "design": {"starts": 1, **sections.get("design", {})},
        }
    return setting.configuration(**sections)


def _make_design(setting: Setting, _monitor: Monitor, number: int, criterion: str) -> DesignResult:
    section = {"criterion": criterion, "seed": number - 1}
    return design(_configuration(setting, design=section, workers=1))


def _workbench(setting: Setting, index: int, result: DesignResult, kinematics: str) -> Workbench:
    """Return the bench that repeats one design's experiment; no two designs share their noise."""
    configuration = _configuration(
        setting,
        montecarlo={"estimators": list(ESTIMATORS), "seed": _SEEDS_APART * (index + 1)},
        estimate={"differentiation": "central" if kinematics == "central" else "fourier"},
    )
    if kinematics == "exact":
        configuration = with_exact_lengths(configuration)
    return Workbench.of(configuration, result.trajectory)


def _execute(
    setting: Setting,
    _monitor: Monitor,
    index: int,
    result: DesignResult,
    kinematics: str,
    count: int,
) -> dict[str, Array]:
    """Return the estimates by estimator, (K, m), of the repetitions that could be estimated."""
    workbench = _workbench(setting, index, result, kinematics)
    outcomes = [workbench.repeat(number).outcomes for number in range(1, count + 1)]
    found = [[one[name].values for name in ESTIMATORS] for one in outcomes]
    kept = [values for values in found if all(value is not None for value in values)]
    return dict(zip(ESTIMATORS, np.array(kept, dtype=np.float64).swapaxes(0, 1), strict=True))


def with_exact_lengths(configuration: RunConfiguration) -> RunConfiguration:
    """Return the run with lengths that are measured a million times better."""
    robot = configuration.robot
    noise = robot.noise
    if noise is None or noise.length_covariance is None:
        return configuration
    covariance = noise.length_covariance * _EXACT**2
    exact = replace(noise, length_covariance=covariance, length_spectrum=None)
    return replace(configuration, robot=replace(robot, noise=exact))


def linear_covariances(robot: Robot, twin: Twin) -> dict[str, Array]:
    """Return the covariances of LS and GM by name, (m, m) each, SI.

    They are (ΨᵀΨ)⁻¹ ΨᵀΣΨ (ΨᵀΨ)⁻¹ and F⁻¹ = (Ψᵀ Σ⁻¹ Ψ)⁻¹ over the samples and periods that the twin
    executes, at the true motion; for noise with a spectrum they are sums over the lines of the
    period, or of the recording if the period is not a whole number of samples.
    """
    states = twin.truth.executed.sample(twin.grid.distinct_times)
    regressors = robot.regressor(*states)
    repeats = twin.grid.count / len(twin.grid.distinct_times)
    covariance = twin.truth.force_covariance
    flat = regressors.reshape(-1, regressors.shape[2])

    def inner(weights: Array) -> Array:
        return flat.T @ np.matmul(weights, regressors).reshape(flat.shape) * repeats

    def inverse(matrix: Array) -> Array:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)

    plain = inverse(inner(np.eye(ACTUATORS)))
    spectrum = twin.force_noise.spectrum
    if spectrum is not None:
        coloured = PeriodicNoise(spectrum, twin.grid.sampling, repeats)
        omega = 2 * np.pi * twin.grid.sampling / len(regressors)
        return {
            "ls": plain @ (coloured.spread(regressors, omega) * repeats) @ plain,
            "gm": inverse(coloured.information(regressors, omega) * repeats),
        }
    return {"ls": plain @ inner(covariance) @ plain, "gm": inverse(inner(inverse(covariance)))}


# --- tables ---------------------------------------------------------------------------------------


def _tables(trials: tuple[Trial, ...], robot: Robot) -> dict[str, Iterator[dict[str, Any]]]:
    pairs = list(zip(trials[::2], trials[1::2], strict=True))
    return {
        "designs": (trial.keys | _design_row(trial, robot) for trial in trials),
        "precision": _precision_rows(trials, robot),
        "determinants": _determinant_rows(pairs, robot),
        "agreement": (
            trial.keys | {"estimator": name} | trial.agreement("exact", name)
            for trial, name in product(trials, ESTIMATORS)
        ),
        "means": _mean_rows(pairs, robot),
        "distributions": _distribution_rows(trials[:2], robot),
    }


def _design_row(trial: Trial, robot: Robot) -> dict[str, Any]:
    made, period = trial.design, trial.design.trajectory.period
    nominal = np.multiply.outer(robot.scales, robot.scales)
    motion = robot.strut_motion(*made.trajectory.sample(np.arange(_GRID) * period / _GRID))
    return {
        "folder": f"designs/{trial.name}",
        "status": made.status,
        "keeps_limits": made.passed,
        "log_det_information": made.log_det_information,
        "condition_si": np.linalg.cond(made.information),
        "condition_nominal": np.linalg.cond(made.information * nominal),
        "period": period,
        "strut_speed": np.sqrt(np.mean(motion.length_rate**2)),
        "strut_acceleration": np.sqrt(np.mean(motion.length_acceleration**2)),
    }


def _precision_rows(trials: tuple[Trial, ...], robot: Robot) -> Iterator[dict[str, Any]]:
    for trial, kinematics, estimator in product(trials, KINEMATICS, ESTIMATORS):
        values, predicted = trial.values[kinematics][estimator], trial.predicted_std(estimator)
        for k, name in enumerate(robot.parameter_names):
            yield trial.keys | {
                "kinematics": kinematics,
                "estimator": estimator,
                "parameter": name,
                "unit": parameter_unit(name),
                "truth": robot.parameters[k],
                "mean": values[:, k].mean(),
                "std": values[:, k].std(ddof=1),
                "predicted_std": predicted[k],
            }


def _determinant_rows(pairs: list[tuple[Trial, Trial]], robot: Robot) -> Iterator[dict[str, Any]]:
    rigid = rigid_body(robot.parameter_names)
    for pair, kinematics, estimator in product(pairs, KINEMATICS, ESTIMATORS):
        first, second = (trial.values[kinematics][estimator] for trial in pair)
        better = first.std(axis=0, ddof=1) < second.std(axis=0, ddof=1)
        yield {
            "set": pair[0].number,
            "kinematics": kinematics,
            "estimator": estimator,
            **compare_determinants(first, second, robot.scales)._asdict(),
            "rigid_body_smaller": np.count_nonzero(better & rigid),
            "friction_smaller": np.count_nonzero(better & ~rigid),
        }


def _mean_rows(pairs: list[tuple[Trial, Trial]], robot: Robot) -> Iterator[dict[str, Any]]:
    for pair, kinematics in product(pairs, KINEMATICS):
        test = mean_difference(*(trial.values[kinematics]["ls"] for trial in pair))
        for k, name in enumerate(robot.parameter_names):
            yield {
                "set": pair[0].number,
                "kinematics": kinematics,
                "parameter": name,
                "unit": parameter_unit(name),
                "difference": test.difference[k],
                "std_error": test.std[k],
                "t": test.z[k],
                "p_value": test.p_values[k],
                "p_joint": test.p_joint,
            }


def _distribution_rows(pair: Sequence[Trial], robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the LS estimates of some parameters with both designs of the first set."""
    names = robot.parameter_names
    shown = [name for name in _SHOWN if name in names] or list(names[:3])
    for trial, name in product(pair, shown):
        k = names.index(name)
        for value in trial.values["fourier"]["ls"][:, k]:
            yield {
                "parameter": name,
                "unit": parameter_unit(name),
                "criterion": trial.criterion,
                "truth": robot.parameters[k],
                "value": value,
            }


def ls_rows(table: pd.DataFrame, kinematics: str) -> pd.DataFrame:
    """Return the rows of LS with these kinematics."""
    return table[(table["kinematics"] == kinematics) & (table["estimator"] == "ls")]


def rigid_body(names: Sequence[str]) -> Mask:
    """Return a mask of the rigid bodies' parameters, (m,); the others are friction."""
    terms = (struts.TERM, rigid_platform.GENERAL)
    bodies = {parameter.name for term in terms for parameter in term.parameters}
    return np.array([name in bodies for name in names])


# --- claims ---------------------------------------------------------------------------------------


def _determinant_claims(determinants: pd.DataFrame) -> Iterator[Claim]:
    first, second = CRITERIA
    for kinematics, words in KINEMATICS.items():
        found = ls_rows(determinants, kinematics)
        ratios = found["difference"] / found["std_error"]
        least, ratio = found.loc[ratios.idxmin()], float(ratios.min())
        yield Claim(
            f"{words}: the covariance of LS has the smaller determinant with '{first}' than with "
            f"'{second}' in every set, by more than {_CLEAR:g} standard errors",
            f"{sum(found['difference'] > 0)} of {len(found)} sets; log det smaller by "
            f"{least['difference']:.1f} ± {least['std_error']:.1f} or more ({ratio:.0f} standard "
            "errors)",
            "the statistical design's is smaller",
            None if kinematics == "central" else ratio > _CLEAR,
        )


def _precision_claims(determinants: pd.DataFrame, trials: tuple[Trial, ...]) -> Iterator[Claim]:
    first, second = CRITERIA
    rigid = rigid_body(trials[0].design.parameter_names)
    pairs = zip(trials[::2], trials[1::2], strict=True)
    predicted = [one.predicted_std("ls") < two.predicted_std("ls") for one, two in pairs]
    for title, column, mask, paper in (
        ("rigid-body", "rigid_body_smaller", rigid, "8 of 10"),
        ("friction", "friction_smaller", ~rigid, "7 of 14"),
    ):
        counts = ", ".join(map(str, ls_rows(determinants, "fourier")[column]))
        expected = ", ".join(str(np.count_nonzero(one & mask)) for one in predicted)
        yield Claim(
            f"{title} parameters that LS estimates more precisely with '{first}' than with "
            f"'{second}', by set; {KINEMATICS['fourier']}",
            f"{counts} of {np.count_nonzero(mask)}; predicted: {expected}",
            paper,
        )


def _motion_claim(designs: pd.DataFrame) -> Claim:
    first, second = (designs[designs["criterion"] == name] for name in CRITERIA)
    value = "; ".join(
        f"'{name}': {found['strut_speed'].mean():.2f} m/s, "
        f"{found['strut_acceleration'].mean():.1f} m/s²"
        for name, found in zip(CRITERIA, (first, second), strict=True)
    )
    if np.all(second["strut_acceleration"].to_numpy() < first["strut_acceleration"].to_numpy()):
        value += (
            f". In every set '{CRITERIA[1]}' moves the struts less: it asks for equal information "
            "about all parameters, not for much of it"
        )
    return Claim("the reason: motion of the struts, rms, mean over the sets", value)


def _agreement_claims(agreement: pd.DataFrame, trials: tuple[Trial, ...]) -> Iterator[Claim]:
    formulas = {"ls": "(ΨᵀΨ)⁻¹ΨᵀΣΨ(ΨᵀΨ)⁻¹", "gm": "F⁻¹"}
    for estimator, formula in formulas.items():
        found = agreement[agreement["estimator"] == estimator]
        worst = found.loc[found["z"].abs().idxmax()]
        yield Claim(
            f"achieved variances of {estimator.upper()} agree with {formula} within {_CLEAR:g} "
            "standard errors for every design",
            f"achieved / predicted {found['variance_ratio'].mean():.3f} on average, "
            f"{worst['variance_ratio']:.3f} ± {worst['std_error']:.3f} at worst",
            holds=bool(abs(worst["z"]) < _CLEAR),
        )
    gaps = [
        float(np.sqrt(np.mean((trial.predicted_std("ls") / trial.predicted_std("gm")) ** 2)))
        for trial in trials
    ]
    yield Claim(
        "gain from weighting with Σ: predicted standard deviations of LS over those of GM, rms",
        f"{min(gaps):.2f} … {max(gaps):.2f}",
    )


def _mean_claim(setting: Setting, means: pd.DataFrame, kinematics: str) -> Claim:
    found = means[means["kinematics"] == kinematics]
    joint = found.groupby("set")["p_joint"].first()
    level = FAMILY_LEVEL / len(joint)
    differing = int((joint < level).sum())
    least = found.groupby("parameter", sort=False)["p_value"].min()
    apart = list(least.index[least < level])
    listed = "all" if len(apart) == len(least) else ", ".join(apart) or "none"
    verb = {"exact": "are the same", "fourier": "compared", "central": "differ"}[kinematics]
    return Claim(
        f"{KINEMATICS[kinematics]}: the mean LS estimates of both designs {verb}",
        f"they differ in {differing} of {len(joint)} sets; parameters that differ: {listed}",
        "" if kinematics == "exact" else setting.printed("they agree but for r_α and r_β"),
        {"exact": differing == 0, "fourier": None, "central": differing == len(joint)}[kinematics],
    )
