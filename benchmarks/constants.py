"""PaLiDA, the design of n = 5: constants of terms that are estimated, a pitch and a velocity.

Spread: the standard deviation that is stated against the errors of repeated experiments, with the
twin's cogging and its noise, ten periods of few samples that tell as much as those at 1 kHz.
Coloured: the same of maximum likelihood with weights for white noise, where the forces' noise
remembers, or changes its sign from sample to sample; beside it what would be stated of white noise.
Basin: from which starting values Gauss–Markov finds the constant, of one such experiment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import scipy
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from benchmarks.studies import Row, equivalent_run, palida_design, summary
from constraints.arrays import Array
from estimation.estimators import ParameterEstimate
from estimation.identification.estimation import parameter_priors, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.twin import Twin
from expdesign.configuration import RunConfiguration
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import robot_from

TITLE = "Estimated constants of terms"

_SAMPLES = 250
_FRICTION, _AMPLITUDE = 20.0, 10.0
_TRUE = {"cogging.pitch": 0.024, "stribeck.velocity": 0.05}
_OTHER_PITCH = 0.006
_MEMORIES = (0.95, -0.95)
SECTIONS = ("spread", "coloured", "basin")


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield a row per estimator and constant, or per constant."""
    if section == "spread":
        yield from _spread(repetitions or 100)
    elif section == "coloured":
        for memory in _MEMORIES:
            yield from _spread(repetitions or 100, memory)
    else:
        for name, true in (*_TRUE.items(), ("cogging.pitch", _OTHER_PITCH)):
            yield _basin(name, true)


__all__ = ["SECTIONS", "TITLE", "rows", "summary"]


def _run(
    constants: dict[str, float], truth: dict[str, float], seed: int, memory: float = 0.0
) -> RunConfiguration:
    """Return a run that estimates constants from these values on, of a machine with the true ones.

    The cogging is the twin's own, the friction that of a term. Noise with a memory is weighted as
    if it had none.
    """
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    if memory:
        palida["noise"] |= {"force_spectrum": {"ar": memory}}
    experiment: dict[str, Any] = {"seed": seed, "periods": 10}
    experiment["sampling"] = _SAMPLES / palida_design().period
    if (pitch := truth.get("cogging.pitch")) is not None:
        phases = np.linspace(0, 5, 6).tolist()
        experiment["cogging"] = {"amplitude": _AMPLITUDE, "pitch": pitch, "phase": phases}
    if (velocity := truth.get("stribeck.velocity")) is not None:
        humps = {f"s{j}": _FRICTION for j in range(1, 7)}
        experiment["truth"] = palida | {
            "parameters": palida["parameters"] | humps,
            "terms": [*DEFAULT, {"stribeck": {"velocity": velocity}}],
        }
    terms: list[Any] = [*DEFAULT]
    for name, value in constants.items():
        term, constant = name.split(".")
        terms.append({term: {constant: {"value": value, "estimate": True}}})
    robot = palida | {"terms": terms}
    section = {"spectrum": "white"} if memory else {}
    return equivalent_run(
        "constants", _SAMPLES, robot=robot, experiment=experiment, estimate=section
    )


def _found(run: RunConfiguration, seed: int, wanted: Sequence[str]) -> dict[str, ParameterEstimate]:
    with threadpool_limits(limits=1):
        robot = robot_from(run.robot)
        data = Twin.of(run, palida_design(), seed=seed).measurement(1)
        experiment = prepare_experiment(run, robot, data, palida_design())
        return run_estimators(robot, [experiment], parameter_priors(run, robot), wanted)


def _values(run: RunConfiguration, found: ParameterEstimate) -> tuple[Array, Array]:
    known = found.systematic
    assert known is not None
    return np.array(run.robot.constants) + known.values, known.std


def _std_if_white(found: ParameterEstimate) -> Array:
    """Return the standard deviations of the constants if the noise had no colour."""
    shares = [
        share
        for influence in found.influences
        for share in (influence.covariance_from_forces(), influence.covariance_from_lengths())
        if share is not None
    ]
    return np.sqrt(np.diag(sum(share.white for share in shares)))[-len(_TRUE) :]


def _repetition(number: int, memory: float) -> dict[str, tuple[Array, Array, Array]]:
    begun = {name: 1.05 * value for name, value in _TRUE.items()}
    run = _run(begun, _TRUE, number, memory)
    found = _found(run, number, ("ml",) if memory else ("ls", "gm", "ml"))
    return {name: (*_values(run, one), _std_if_white(one)) for name, one in found.items()}


def _spread(count: int, memory: float = 0.0) -> Iterator[Row]:
    found = Parallel(n_jobs=2)(delayed(_repetition)(number, memory) for number in range(count))
    remembered = f", memory {memory:g}" if memory else ""
    for estimator in found[0]:
        values, std, white = (np.array([each[estimator][k] for each in found]) for k in range(3))
        for place, (name, true) in enumerate(_TRUE.items()):
            errors = values[:, place] - true
            squares = float(np.sum((errors / std[:, place]) ** 2))
            low, high = scipy.stats.chi2.ppf([0.005, 0.995], count)
            ratio = np.sqrt(np.mean(std[:, place] ** 2)) / np.sqrt(np.mean(errors**2))
            yield {
                "claim": f"{estimator}: {name}{remembered}",
                "true": f"{true:g}",
                "repetitions": count,
                "stated std": f"{np.sqrt(np.mean(std[:, place] ** 2)):.3g}",
                "of white noise": f"{np.sqrt(np.mean(white[:, place] ** 2)):.3g}",
                "spread": f"{np.std(errors):.3g}",
                "bias / its std error": f"{np.mean(errors) / np.std(errors) * np.sqrt(count):.2f}",
                "stated / rms error": f"{ratio:.3f}",
                "95 % cover (%)": f"{100 * np.mean(np.abs(errors) < 1.96 * std[:, place]):.0f}",
                "holds": "yes" if low < squares < high else "no",
            }


def _basin(name: str, true: float) -> Row:
    """Go up and down from the true value until the search ends elsewhere."""
    ends = []
    wide = name == "stribeck.velocity"
    steps = np.geomspace(1.1, 9, 24) if wide else np.linspace(1.005, 1.6, 120)
    for factors in (1 / steps, steps):
        last = 1.0
        for factor in factors.tolist():
            run = _run({name: factor * true}, {name: true}, 0)
            values, std = _values(run, _found(run, 0, ("gm",))["gm"])
            if abs(values[0] - true) > 5 * std[0]:
                break
            last = factor
        ends.append(last)
    motion = Twin.of(_run({name: true}, {name: true}, 0), palida_design(), seed=0)
    strokes = np.ptp(motion.lengths, axis=0)
    return {
        "claim": f"{name} = {true:g}",
        "strokes (m)": f"{strokes.min():.3f} … {strokes.max():.3f}",
        "found from": f"{ends[0]:.3f} … {ends[1]:.3f} times the true value",
        "one pitch per shortest stroke": "" if wide else f"± {true / strokes.min():.3f}",
        "one pitch per longest stroke": "" if wide else f"± {true / strokes.max():.3f}",
        "holds": "",
    }
