"""What a comparison of two criteria of design shows: its tables and claims."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.studies.claim import Claim
from estimation.studies.design_study import ESTIMATORS, DesignStudy, Trial, trial_name
from estimation.studies.tables import TABLES
from estimation.uncertainty.differences import FAMILY_LEVEL
from expdesign.experiment.scaling import parameter_scaling
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.robot import Robot

_CLEAR = 4.0
"""Standard errors by which determinants must differ, and within which predictions must agree."""

_PAPER_SETS = 5
_GRID = 2000


def design_tables(study: DesignStudy) -> dict[str, pd.DataFrame]:
    """Return the tables by name."""
    rows = {
        "study_designs": _designs(study),
        "study_precision": _precision(study),
        "study_determinants": _determinants(study),
        "study_agreement": _agreement(study),
        "study_means": _means(study),
    }
    return {
        name: pd.DataFrame(list(found), columns=[column.name for column in TABLES[name]])
        for name, found in rows.items()
    }


def rigid_body(robot: Robot) -> NDArray[np.bool_]:
    """Return which parameters are the rigid bodies', the others being friction, (m,)."""
    return np.array([name[0] not in "rv" for name in robot.parameter_names])


def design_claims(study: DesignStudy) -> list[Claim]:
    """Return what the study was to show, LS as in the paper."""
    first, second = study.section.criteria
    found = [*_determinant_claims(study), *_precision_claims(study)]
    if "exact" in study.section.kinematics:
        found += _agreement_claims(study)
    for kinematics in study.section.kinematics:
        found.append(_means_claim(study, kinematics))
    worst = [t for t in study.trials if not t.design.passed]
    failed = sum(sum(trial.failed.values()) for trial in study.trials)
    total = len(study.trials) * len(study.section.kinematics) * study.section.repetitions
    found.append(
        Claim("every experiment can be estimated", f"{total - failed} of {total}", holds=not failed)
    )
    found.append(
        Claim(
            f"every design ({first} and {second}) keeps every limit",
            f"{len(study.trials) - len(worst)} of {len(study.trials)}",
            holds=not worst,
        )
    )
    return found


def _determinant_claims(study: DesignStudy) -> Iterator[Claim]:
    first, second = study.section.criteria
    for kinematics in study.section.kinematics:
        found = [study.determinant(pair, kinematics, "ls") for pair in study.sets]
        smaller = sum(one.difference > 0 for one in found)
        least = min(found, key=lambda one: one.ratio)
        yield Claim(
            f"{_with(kinematics)}: the covariance of LS has the smaller determinant with '{first}' "
            f"than with '{second}' in every set, by more than {_CLEAR:g} standard errors",
            f"{smaller} of {len(found)} sets; log det smaller by {least.difference:.1f} ± "
            f"{least.std_error:.1f} or more ({least.ratio:.0f} standard errors)",
            "the statistical design's is smaller",
            None if kinematics == "central" else bool(least.ratio > _CLEAR),
        )


def _precision_claims(study: DesignStudy) -> Iterator[Claim]:
    first, second = study.section.criteria
    rigid = rigid_body(study.robot)
    kinematics = "fourier" if "fourier" in study.section.kinematics else study.section.kinematics[0]
    better = [study.more_precise(pair, kinematics, "ls") for pair in study.sets]
    for title, which, paper in (
        ("rigid-body", rigid, "8 of 10"),
        ("friction", ~rigid, "7 of 14"),
    ):
        counts = [int(np.count_nonzero(one & which)) for one in better]
        foreseen = [
            int(np.count_nonzero(which & (_predicted_std(one) < _predicted_std(two))))
            for one, two in study.sets
        ]
        yield Claim(
            f"{title} parameters that LS knows better with '{first}' than with '{second}', by set; "
            f"{_with(kinematics)}",
            f"{', '.join(map(str, counts))} of {np.count_nonzero(which)}; predicted: "
            f"{', '.join(map(str, foreseen))}",
            paper,
        )
    speeds = [[_rms_motion(study, trial) for trial in pair] for pair in study.sets]
    mean = np.mean(speeds, axis=0)
    told = "; ".join(
        f"'{name}': {speed:.2f} m/s, {acceleration:.1f} m/s²"
        for name, (speed, acceleration) in zip((first, second), mean, strict=True)
    )
    if second == "condition" and np.all(np.array(speeds)[:, 1] < np.array(speeds)[:, 0]):
        told += (
            f". In every set '{second}' moves the struts less: it asks for equally much "
            "information about all parameters, not for much of it"
        )
    yield Claim("why: how the struts move, rms, mean over the sets", told)


def _agreement_claims(study: DesignStudy) -> Iterator[Claim]:
    formulas = {"ls": "(ΨᵀΨ)⁻¹ΨᵀΣΨ(ΨᵀΨ)⁻¹", "gm": "F⁻¹"}
    for estimator in ESTIMATORS:
        found = [trial.agreement("exact", estimator) for trial in study.trials]
        worst = max(found, key=lambda one: abs(one.z))
        mean = float(np.mean([one.ratio for one in found]))
        yield Claim(
            f"achieved variances of {estimator.upper()} agree with {formulas[estimator]} within "
            f"{_CLEAR:g} standard errors for every design",
            f"achieved / predicted {mean:.3f} on average, {worst.ratio:.3f} ± "
            f"{worst.std_error:.3f} at worst",
            holds=bool(abs(worst.z) < _CLEAR),
        )
    gaps = []
    for trial in study.trials:
        std = {name: np.sqrt(np.diag(trial.predicted[name])) for name in ESTIMATORS}
        gaps.append(float(np.sqrt(np.mean((std["ls"] / std["gm"]) ** 2))))
    yield Claim(
        "what weighting with Σ is worth: predicted standard deviations of LS over those of GM, rms",
        f"{min(gaps):.2f} … {max(gaps):.2f}",
    )


def _means_claim(study: DesignStudy, kinematics: str) -> Claim:
    tests = [study.means(pair, kinematics, "ls") for pair in study.sets]
    level = FAMILY_LEVEL / len(tests)
    joint = sum(test.p_joint < level for test in tests)
    names = study.robot.parameter_names
    apart = {names[k] for test in tests for k in np.flatnonzero(test.p_values < level)}
    listed = ", ".join(name for name in names if name in apart) or "none"
    if len(apart) == len(names):
        listed = "all"
    expected = {"exact": joint == 0, "fourier": None, "central": joint == len(tests)}[kinematics]
    return Claim(
        f"{_with(kinematics)}: the mean LS estimates of both designs "
        + {"exact": "are the same", "fourier": "compared", "central": "differ"}[kinematics],
        f"they differ in {joint} of {len(tests)} sets; parameters that differ: {listed}",
        "" if kinematics == "exact" else "they agree but for r_α and r_β",
        expected,
    )


def _predicted_std(trial: Trial) -> Array:
    return np.sqrt(np.diag(trial.predicted["ls"]))


def _with(kinematics: str) -> str:
    return {
        "exact": "without noise of the lengths",
        "fourier": "with noise of the lengths, Fourier differentiation",
        "central": "with noise of the lengths, central differences",
    }[kinematics]


def _rms_motion(study: DesignStudy, trial: Trial) -> tuple[float, float]:
    trajectory = trial.design.trajectory
    states = trajectory.sample(np.arange(_GRID) * trajectory.period / _GRID)
    motion = study.robot.strut_motion(states.pose, states.rate, states.acceleration)
    return (
        float(np.sqrt(np.mean(motion.length_rate**2))),
        float(np.sqrt(np.mean(motion.length_acceleration**2))),
    )


def _designs(study: DesignStudy) -> Iterator[dict[str, Any]]:
    nominal = parameter_scaling(study.robot, "nominal")
    for trial in study.trials:
        information = trial.design.information
        speed, acceleration = _rms_motion(study, trial)
        by_nominal = information * np.multiply.outer(nominal, nominal)
        yield {
            "set": trial.number,
            "criterion": trial.criterion,
            "folder": f"designs/{trial_name(trial.number, trial.criterion)}",
            "status": trial.design.status,
            "keeps_limits": trial.design.passed,
            "log_det_information": trial.design.log_det_information,
            "condition_si": float(np.linalg.cond(information)),
            "condition_nominal": float(np.linalg.cond(by_nominal)),
            "period": trial.design.trajectory.period,
            "strut_speed": speed,
            "strut_acceleration": acceleration,
            "failed": sum(trial.failed.values()),
        }


def _precision(study: DesignStudy) -> Iterator[dict[str, Any]]:
    names = study.robot.parameter_names
    for trial in study.trials:
        for kinematics, by_estimator in trial.values.items():
            for estimator, values in by_estimator.items():
                predicted = np.sqrt(np.diag(trial.predicted[estimator]))
                for k, name in enumerate(names):
                    yield {
                        "set": trial.number,
                        "criterion": trial.criterion,
                        "kinematics": kinematics,
                        "estimator": estimator,
                        "parameter": name,
                        "unit": parameter_unit(name),
                        "truth": study.robot.parameters[k],
                        "mean": values[:, k].mean(),
                        "std": values[:, k].std(ddof=1),
                        "predicted_std": predicted[k],
                    }


def _determinants(study: DesignStudy) -> Iterator[dict[str, Any]]:
    rigid = rigid_body(study.robot)
    for pair in study.sets:
        for kinematics in study.section.kinematics:
            for estimator in ESTIMATORS:
                found = study.determinant(pair, kinematics, estimator)
                better = study.more_precise(pair, kinematics, estimator)
                yield {
                    "set": pair[0].number,
                    "kinematics": kinematics,
                    "estimator": estimator,
                    "log_det_first": found.first,
                    "log_det_second": found.second,
                    "difference": found.difference,
                    "std_error": found.std_error,
                    "rigid_body_smaller": int(np.count_nonzero(better & rigid)),
                    "friction_smaller": int(np.count_nonzero(better & ~rigid)),
                }


def _agreement(study: DesignStudy) -> Iterator[dict[str, Any]]:
    if "exact" not in study.section.kinematics:
        return
    for trial in study.trials:
        for estimator in ESTIMATORS:
            found = trial.agreement("exact", estimator)
            yield {
                "set": trial.number,
                "criterion": trial.criterion,
                "estimator": estimator,
                "variance_ratio": found.ratio,
                "std_error": found.std_error,
                "z": found.z,
            }


def _means(study: DesignStudy) -> Iterator[dict[str, Any]]:
    for pair in study.sets:
        for kinematics in study.section.kinematics:
            test = study.means(pair, kinematics, "ls")
            for k, name in enumerate(study.robot.parameter_names):
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
