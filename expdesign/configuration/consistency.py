"""Consistency of a run: between its sections, with its robot and with its priors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np

from expdesign.configuration.design import TaskSection
from expdesign.configuration.document import Document, Located, absolute, find_file
from expdesign.configuration.errors import InputError, Key, Problem, nearest_name, quote
from expdesign.configuration.experiment import Motion
from expdesign.configuration.noise import aliasing_of
from expdesign.configuration.parameters import term_hint
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    RobotSource,
    read_robot,
    resolve_robot,
)
from expdesign.configuration.run import RunDescription
from expdesign.configuration.schema import MOST_ROWS, MOST_SAMPLES
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT, Identification, machine_name
from expdesign.library import robot_files
from expdesign.mechanism.terms import rigid_platform, term_definitions

_ALLOWED = "the run folder of an estimate of this machine, or its identified-robot.yaml"
_ALIKE = 1e-9
"""Difference of coordinates within rounding errors, m."""
_CORRELATION_ROUNDING = 1e-9
"""Size of a negative eigenvalue of a correlation matrix within rounding errors."""
_DYNAMIC = ("gravity", "base_joints", "platform_joints", "alpha_axes", "platform_cardan_axes")
"""Properties of a robot, in addition to terms and drive, that its parameters refer to."""


def identification_of(machine: RobotSource | None) -> Identification:
    """Return the identification of a prior machine from a loaded run."""
    if not isinstance(machine, RobotDescription) or machine.identification is None:
        raise ValueError("the run was not loaded: its prior is no identified machine")
    return machine.identification


def prior_machine(
    source: RobotSource,
    key: Key,
    robot: ResolvedRobot,
    document: Document,
    *,
    corrected: bool = False,
) -> RobotDescription:
    """Return the identified machine for a prior of the run, inline or by its name.

    It has no limits, noise or tolerances, since these are not part of a prior. With `corrected` it
    may differ from the robot by its estimated deviations.
    """
    placed = _locate(source, key, document)
    bare = placed.value.model_copy(update={"limits": {}, "noise": None, "tolerances": None})
    machine = resolve_robot(Located(bare, placed.document, placed.key))
    moved = bare.identification if corrected else None
    wrong = list(_differences(machine, robot, moved)) or list(
        _covariance_faults(bare.identification, robot)
    )
    if wrong:
        name = placed.document.file or machine.name
        raise InputError(
            [document.problem(key, f"{name}: {reason}", allowed) for reason, allowed in wrong]
        )
    return bare


def _locate(source: RobotSource, key: Key, document: Document) -> Located[RobotDescription]:
    if isinstance(source, RobotDescription):
        return Located(source, document, key)
    path = absolute(source, document.folder)
    if path.is_dir():
        path = path / IDENTIFIED_ROBOT
    else:
        try:
            path = find_file(source, "robot", robot_files(), document.folder)
        except InputError:
            path = path / IDENTIFIED_ROBOT
    if not path.is_file():
        raise InputError([document.problem(key, f"there is no {path}", _ALLOWED)])
    return read_robot(path)


def _differences(
    machine: ResolvedRobot, robot: ResolvedRobot, found: Identification | None
) -> Iterator[tuple[str, str]]:
    """Yield differences that make the parameters of two robots incomparable, with a remedy.

    Those by the deviations of an identification are none.
    """
    moved = {} if found is None else _largest_moves(found, robot)
    names = machine_name(machine.name), machine_name(robot.name)
    if names[0] != names[1]:
        yield f"it is the machine {names[0]}, and the run's robot is {names[1]}", _ALLOWED
        return
    if machine.platform != robot.platform:
        kinds = f"its platform is {machine.platform}, that of the run's robot {robot.platform}"
        yield kinds, f"an identification with platform: {robot.platform}"
    elif machine.terms != robot.terms or not np.allclose(
        machine.constants, robot.constants, rtol=0, atol=moved.get("constants", 0.0)
    ):
        terms = ", ".join(term.name for term in robot.terms)
        yield "its terms or their constants are not those of the run's robot", terms
    if machine.drive != robot.drive:
        yield "its drive is not that of the run's robot", "the same drive"
    for name in _DYNAMIC:
        one, other = getattr(machine, name), getattr(robot, name)
        missing = one is None or other is None
        atol = _ALIKE + moved.get(name, 0.0)
        if one is not other if missing else not np.allclose(one, other, rtol=0, atol=atol):
            yield (
                f"its {name} are not those of the run's robot: the parameters belong to another "
                "geometry",
                "the same geometry: `robot:` may be the identified-robot.yaml itself",
            )


def _largest_moves(found: Identification, robot: ResolvedRobot) -> dict[str, float]:
    """Return bounds of the changes by estimated deviations: of each property, and of constants."""
    own = tuple(f"{term.name}_{one.name}" for term in robot.terms for one in term.constants)
    starts = {key: (f"{key.removesuffix('s')}_",) for key in _DYNAMIC} | {"constants": own}
    moves = {
        key: sum(abs(one.value) for one in found.deviations if one.name.startswith(names))
        for key, names in starts.items()
    }
    return moves | {"gravity": moves["gravity"] * float(np.linalg.norm(robot.gravity))}


def _covariance_faults(
    found: Identification | None, robot: ResolvedRobot
) -> Iterator[tuple[str, str]]:
    """Yield faults of the values' covariance."""
    if found is None:
        yield "it was not identified: the file has no `identification` with a covariance", _ALLOWED
        return
    if found.parameters != robot.parameter_names:
        names = ", ".join(robot.parameter_names)
        yield "identification.parameters are not those of the run's robot", names
        return
    covariance = np.array(found.covariance_random)
    variance = np.diag(covariance)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = covariance / np.multiply.outer(scale, scale)
    if np.any(variance < 0) or not np.allclose(
        correlation, correlation.T, atol=_CORRELATION_ROUNDING
    ):
        yield (
            "identification.covariance_random is not symmetric, or has a negative variance",
            "a covariance",
        )
    elif np.linalg.eigvalsh(correlation)[0] < -_CORRELATION_ROUNDING:
        yield "identification.covariance_random has negative eigenvalues", "a covariance"


def payload_problems(
    machine: RobotDescription, robot: ResolvedRobot, key: Key, document: Document
) -> Iterator[Problem]:
    """Yield obstacles to separating a payload from the platform of an identified machine."""
    ten = tuple(parameter.name for parameter in rigid_platform.GENERAL.parameters)
    if not set(ten) <= set(robot.parameter_names):
        yield document.problem(
            key,
            "a payload has ten parameters, and a symmetric platform has five of them",
            "platform: general, for the robot and in the identification",
        )
        return
    found = identification_of(machine)
    variance = dict(zip(found.parameters, np.diag(found.covariance_random), strict=False))
    if fixed := [name for name in ten if not variance.get(name, 0.0) > 0]:
        yield document.problem(
            key,
            f"the identification did not estimate {', '.join(fixed)}: the platform's share of "
            "them is unknown",
            "an identification that estimates all ten parameters of the platform",
        )


_ROUNDING = 1e-12
_LEAST_HARMONICS_AT_REST = 2
_MOTIONS = tuple(name for name in get_args(Motion) if name != "file")
"""Tasks that a run file states by their names."""
_SAMPLES_PER_SWING = 20
"""Fewest samples of a controller per period of its bandwidth."""


def inconsistencies(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Yield the contradictions inside a run, and between it and its robot."""
    yield from _unknown_parameters(run, robot, document)
    for check in (
        _oversized,
        _impossible_designs,
        _impossible_motions,
        _narrow_spectra,
        _impossible_estimates,
        _impossible_selections,
        _impossible_payloads,
        _impossible_control,
        _impossible_units,
    ):
        for key, message, allowed in check(run, robot):
            yield document.problem(key, message, allowed)


def _unknown_parameters(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    own = robot.parameter_names
    candidates = () if run.estimate.select is None else run.estimate.select.candidates
    # Bounds apply to a candidate once it is chosen; a value or prior would prejudge the choice.
    tried = (p.name for one in candidates for p in one.definition.parameters)
    named = {
        ("design", "parameters"): (run.design.named_parameters or (), own),
        ("design", "known"): (run.design.known, own),
        ("design", "interest"): (run.design.interesting_parameters, own),
        ("estimate", "fixed"): (run.estimate.fixed, own),
        ("estimate", "prior"): (run.estimate.named_priors, own),
        ("estimate", "bounds"): (run.estimate.bounds, (*own, *tried)),
    }
    for key, (names, valid) in named.items():
        for name in names:
            if name not in valid:
                yield document.problem(
                    key,
                    f"no term of the robot {robot.name} has the parameter '{name}'"
                    f"{term_hint(name)}",
                    ", ".join(valid),
                    nearest_name(name, valid),
                )


_Fault = tuple[Key, str, str]
"""Key, message and allowed values."""


def _oversized(run: RunDescription, _: ResolvedRobot) -> Iterator[_Fault]:
    """Yield sizes of a period that no computer's memory holds, for the shortest of the family."""
    longest, shortest = (1 / frequency for frequency in run.trajectory.frequency)
    if (samples := shortest * run.experiment.sampling) > MOST_SAMPLES:
        message = f"{samples:.4g} samples of one period are too many"
        yield (("experiment", "sampling"), message, f"{MOST_SAMPLES} at most")
    if (steps := longest / run.controller_period) > MOST_ROWS:
        key = "sampling" if run.trajectory.controller_period is None else "controller_period"
        section = "experiment" if key == "sampling" else "trajectory"
        message = f"{steps:.4g} controller steps in one period are too many"
        yield ((section, key), message, f"{MOST_ROWS} at most")


def _impossible_designs(run: RunDescription, _: ResolvedRobot) -> Iterator[_Fault]:
    if run.design.start == "rest" and run.trajectory.harmonics < _LEAST_HARMONICS_AT_REST:
        yield (
            ("design", "start"),
            "a series of one harmonic that starts at rest never moves",
            f"periodic, or trajectory.harmonics of at least {_LEAST_HARMONICS_AT_REST}",
        )
    step, delay = run.controller_period, run.experiment.delay
    low, high = run.trajectory.frequency
    if abs(delay) > 1 / low:
        yield (
            ("experiment", "delay"),
            f"a delay of {delay:g} s is longer than any period, at most {1 / low:g} s",
            'a delay of the measurement, such as "1 ms"',
        )
    if step > 1 / (2 * high):
        yield (
            ("experiment", "sampling"),
            f"a sampling of {1 / step:g} Hz is too slow for motions of {1 / high:g} s",
            f"at least {2 * high:g} Hz, or a trajectory.controller_period",
        )
        return
    if not 1 / (low * step) <= MOST_ROWS:
        return  # reported with the sizes
    fewest = math.ceil(1 / (high * step) * (1 - _ROUNDING))
    most = math.floor(1 / (low * step) * (1 + _ROUNDING))
    if low < high and fewest > most:
        yield (
            ("trajectory", "frequency"),
            f"no period between {1 / high:g} and {1 / low:g} s is a whole number of "
            f"controller steps of {step:g} s",
            f"a range that includes {1 / (fewest * step):g} Hz, or equal bounds",
        )


def _impossible_motions(run: RunDescription, _: ResolvedRobot) -> Iterator[_Fault]:
    """Yield what several motions cannot share, or cannot be used for yet."""
    count, periods, key = run.trajectory.count, run.experiment.periods, ("trajectory", "count")
    if count == 1:
        return
    if periods % count:
        less, more = periods // count * count, -(-periods // count) * count
        yield (
            ("experiment", "periods"),
            f"{count} motions cannot share {periods:g} periods equally",
            f"{less or more:g} or {more:g}" if less else f"{more:g}",
        )
    single = {
        "a prior": run.design.prior is not None,
        "design.others": bool(run.design.others),
        "a Monte-Carlo study": "montecarlo" in run.stages,
        "a sweep": run.sweep is not None,
        "feedforward of the design": "feedforward" in run.stages
        and run.feedforward.motion == "design",
    }
    for name, given in single.items():
        if given:
            yield key, f"{name} is for a single motion, and there are {count}", "1"


def _narrow_spectra(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    """Yield spectra of the noise that end below half of the sampling."""
    for kind in ("force", "length"):
        spectrum = getattr(robot.noise, f"{kind}_spectrum", None)
        if spectrum is not None and not spectrum.covers(run.experiment.sampling):
            yield (
                ("experiment", "sampling"),
                f"a sampling of {run.experiment.sampling:g} Hz, but noise.{kind}_spectrum was "
                f"measured at {spectrum.highest:g} Hz",
                f"{spectrum.highest:g} Hz at most, or a spectrum that reaches half of the sampling",
            )


def _impossible_estimates(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    estimate = run.estimate
    if estimate.systematic == "estimated":
        key = ("estimate", "systematic")
        if robot.tolerances is None or not robot.tolerances.inexact:
            yield (
                key,
                "there is nothing to estimate: neither the robot nor the run states a tolerance",
                "budget or none; or `tolerances` in the robot file or the run",
            )
        if "ml" not in estimate.estimators:
            yield (
                key,
                "only maximum likelihood estimates deviations within tolerances, and "
                "estimate.estimators has no ml",
                "budget or none; or ml among estimate.estimators",
            )
    for filtered in run.data.filtered_keys:
        periodic = estimate.differentiation in ("auto", "fourier")
        if not periodic or (estimate.frequency, estimate.loss) != ("known", "squared"):
            yield (
                ("data", filtered),
                "filters, and delays of single channels, are taken back from the plain means over "
                "whole periods of a known frequency",
                "estimate.differentiation: auto or fourier, frequency: known and loss: squared",
            )
    named = ", ".join(robot.estimated_constants)
    if named and estimate.pointwise:
        yield (
            ("estimate", "differentiation"),
            f"the robot {robot.name} has {named} estimated, which requires a motion with Fourier "
            f"coefficients; '{estimate.differentiation}' differentiation has none",
            "fourier, or estimate: false with the constants",
        )


def _impossible_selections(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    """Yield candidates that the robot has already, and priors without the candidates."""
    if run.estimate.select is None:
        return
    key = ("estimate", "select", "candidates")
    present = [term.name for term in robot.terms]
    others = ", ".join(name for name in term_definitions() if name not in present)
    candidates = run.estimate.select.candidates
    for place, candidate in enumerate(candidates):
        partner = candidate.definition.constants_of
        if candidate.name in present:
            yield (
                (*key, place),
                f"the robot {robot.name} has the term '{candidate.name}' already",
                f"terms that it lacks: {others}",
            )
        if partner and partner not in (*present, *(one.name for one in candidates[:place])):
            yield (
                (*key, place),
                f"the term '{candidate.name}' takes the constants of '{partner}'",
                f"{partner} among the robot's terms, or listed before {candidate.name}",
            )
        estimated = any(constant.estimate for constant in candidate.constants.values())
        if estimated and run.estimate.pointwise:
            yield (
                (*key, place),
                f"a constant of '{candidate.name}' is estimated, which requires a motion with "
                f"Fourier coefficients; '{run.estimate.differentiation}' differentiation has none",
                "estimate.differentiation: fourier, or estimate: false with the constant",
            )
    earlier = {
        "prior_from": run.estimate.prior_from != "none",
        "prior": not isinstance(run.estimate.prior, dict),
    }
    for name in (name for name, given in earlier.items() if given):
        yield (
            ("estimate", name),
            "the prior is an earlier estimate without the candidates of estimate.select",
            "none, or no estimate.select",
        )


def _impossible_payloads(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    if not run.experiment.payload:
        return
    if robot.platform == "symmetric":
        yield (
            ("experiment", "payload"),
            f"the robot {robot.name} has a symmetric platform, and a payload has ten parameters",
            "platform: general in the robot file",
        )
    if run.estimate.prior_from != "none":
        yield (
            ("estimate", "prior_from"),
            "the robot's identification is not a prior of a machine with a payload",
            "none, and for the payload `estimate.prior` with the run folder of the identification",
        )


def _impossible_control(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    """Yield obstacles to a simulation of the closed loop."""
    if "feedforward" not in run.stages:
        return
    sampling, bandwidth = 1 / run.controller_period, run.feedforward.bandwidth
    if sampling < _SAMPLES_PER_SWING * bandwidth * (1 - _ROUNDING):
        yield (
            ("feedforward", "bandwidth"),
            f"a controller that samples at {sampling:g} Hz cannot have a bandwidth of "
            f"{bandwidth:g} Hz",
            f"at most {sampling / _SAMPLES_PER_SWING:g} Hz, or a shorter "
            "trajectory.controller_period",
        )
    spectrum = None if robot.noise is None else robot.noise.length_spectrum
    if spectrum is not None and not spectrum.covers(sampling):
        yield (
            ("trajectory", "controller_period"),
            f"a controller that samples at {sampling:g} Hz, but noise.length_spectrum was measured "
            f"at {spectrum.highest:g} Hz",
            f"{1 / spectrum.highest:g} s or more, or a run without `feedforward:`",
        )
    if any(run.experiment.compliance) and run.data.recording is None:
        yield (
            ("experiment", "compliance"),
            "the forward dynamics of feedforward has rigid struts",
            "no compliance in a run with `feedforward:`",
        )


def refuse_missing_task(run: RunDescription, file: Path | None) -> None:
    """Refuse a task that is neither a motion nor a file.

    Raises
    ------
    InputError
        The file does not exist; the message names the motion with the most similar name.
    """
    interest = run.design.interest
    if not isinstance(interest, TaskSection) or interest.task.file is None:
        return
    path = Path(interest.task.file)
    if not path.exists():
        near = nearest_name(path.name, _MOTIONS)
        hint = f"; did you mean {quote(near)}?" if near else ""
        raise InputError(
            f"the task {quote(path.name)} is no motion, and there is no {path}{hint}",
            file=file,
            key="design.interest.task",
            allowed=f"{', '.join(_MOTIONS)}, or the folder or design.json of a design",
        )


# --- warnings -------------------------------------------------------------------------------------


def aliased_hum_warnings(run: RunDescription) -> list[str]:
    """Return warnings about a hum of the twin above half of the sampling.

    It is not an error: a machine without anti-aliasing filters has such a hum, too.
    """
    hum, sampling = run.experiment.hum, run.experiment.sampling
    if hum is None:
        return []
    present = [hum.frequency * k for k, size in enumerate(hum.harmonics, start=1) if size > 0]
    reasons = [aliasing_of(frequency, sampling) for frequency in present]
    return [f"experiment.hum: {reason}" for reason in reasons if reason]


def selection_warnings(run: RunDescription) -> list[str]:
    """Return warnings about stages that ignore the run's selection of terms."""
    if run.estimate.select is None or "montecarlo" not in run.stages:
        return []
    return ["montecarlo estimates the robot's own terms: it ignores estimate.select"]


def _impossible_units(run: RunDescription, robot: ResolvedRobot) -> Iterator[_Fault]:
    units = run.data.actuator_units(robot)
    for channel, unit in run.data.units.items():
        if missing := units.missing(unit):
            fault, remedy = missing
            yield ("data", "units", channel), f"'{unit}' cannot be converted: {fault}", remedy
    for number, table in enumerate(run.export):
        length = table.length_unit
        if length and (missing := table.actuator_units(robot).missing(length)):
            fault, remedy = missing
            yield ("export", number), f"lengths in {length} cannot be computed: {fault}", remedy
