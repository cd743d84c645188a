"""What is right by itself but does not fit together: between sections, and with the robot."""

from __future__ import annotations

import math
from collections.abc import Iterator

from expdesign.configuration.document import Document
from expdesign.configuration.errors import Problem, nearest
from expdesign.configuration.noise import unsampled
from expdesign.configuration.parameters import whose
from expdesign.configuration.robot import ResolvedRobot
from expdesign.configuration.run import RunDescription
from expdesign.configuration.sizes import PERIOD_ROWS, oversized
from expdesign.mechanism.catalogue import term_definitions

_ROUNDING = 1e-12
_LEAST_HARMONICS_AT_REST = 2
_SAMPLES_OF_A_SWING = 20
"""Of a controller, at least."""


def inconsistencies(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Yield everything in a run that does not fit the rest of it, or its robot."""
    yield from oversized(run, document)
    yield from _unknown_parameters(run, robot, document)
    yield from _undesignable(run, document)
    yield from _unknown_spectrum(run, robot, document)
    yield from _long_delay(run, document)
    yield from _nothing_to_estimate(run, robot, document)
    yield from _unfitted_constants(run, robot, document)
    yield from _nothing_to_select(run, robot, document)
    yield from _unfit_payload(run, robot, document)
    yield from _uncontrollable(run, robot, document)


def _unknown_parameters(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> list[Problem]:
    own = robot.parameter_names
    candidates = () if run.estimate.select is None else run.estimate.select.candidates
    # Bounds of a candidate hold if it is chosen. A value or a prior of it would judge it already.
    tried = (p.name for one in candidates for p in term_definitions()[one.name].parameters)
    named = {
        ("design", "parameters"): (run.design.named_parameters or (), own),
        ("estimate", "fixed"): (run.estimate.fixed, own),
        ("estimate", "prior"): (run.estimate.named_priors, own),
        ("estimate", "bounds"): (run.estimate.bounds, (*own, *tried)),
    }
    return [
        document.problem(
            key,
            f"no term of the robot {robot.name} has the parameter '{name}'{whose(name)}",
            ", ".join(valid),
            nearest(name, valid),
        )
        for key, (names, valid) in named.items()
        for name in names
        if name not in valid
    ]


def _undesignable(run: RunDescription, document: Document) -> Iterator[Problem]:
    """Name what is well-formed but cannot be designed."""
    if run.design.start == "rest" and run.trajectory.harmonics < _LEAST_HARMONICS_AT_REST:
        yield document.problem(
            ("design", "start"),
            "a series of one harmonic that starts at rest never moves",
            f"periodic, or trajectory.harmonics of at least {_LEAST_HARMONICS_AT_REST}",
        )
    step = run.controller_period
    low, high = run.trajectory.frequency
    if step > 1 / (2 * high):
        yield document.problem(
            ("experiment", "sampling"),
            f"a sampling of {1 / step:g} Hz is too slow for motions of {1 / high:g} s",
            f"at least {2 * high:g} Hz, or a trajectory.controller_period",
        )
        return
    if not 1 / (low * step) <= PERIOD_ROWS.most:
        return  # too many steps, which is told by their number
    fewest = math.ceil(1 / (high * step) * (1 - _ROUNDING))
    most = math.floor(1 / (low * step) * (1 + _ROUNDING))
    if low < high and fewest > most:
        yield document.problem(
            ("trajectory", "frequency"),
            f"no period between {1 / high:g} and {1 / low:g} s is a whole number of "
            f"controller steps of {step:g} s",
            f"a range that includes {1 / (fewest * step):g} Hz, or equal bounds",
        )


def _unknown_spectrum(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name spectra of noise that say nothing up to half of the sampling."""
    if robot.noise is None:
        return
    for kind in ("force", "length"):
        spectrum = getattr(robot.noise, f"{kind}_spectrum")
        if spectrum is not None and not spectrum.covers(run.experiment.sampling):
            yield document.problem(
                ("experiment", "sampling"),
                f"a sampling of {run.experiment.sampling:g} Hz, but noise.{kind}_spectrum was "
                f"measured at {spectrum.highest:g} Hz",
                f"{spectrum.highest:g} Hz at most, or a spectrum that reaches half of the sampling",
            )


def folded_hum(run: RunDescription) -> list[str]:
    """Return what is to be known of a hum of the twin that is sampled as another one.

    A machine without a filter before its converters does that, too: it is no error.
    """
    hum, sampling = run.experiment.hum, run.experiment.sampling
    if hum is None:
        return []
    there = [hum.frequency * k for k, size in enumerate(hum.harmonics, start=1) if size > 0]
    reasons = [unsampled(frequency, sampling) for frequency in there]
    return [f"experiment.hum: {reason}" for reason in reasons if reason]


def unselected(run: RunDescription) -> list[str]:
    """Return which stages of a run estimate without a selection that it names."""
    if run.estimate.select is None or "montecarlo" not in run.stages:
        return []
    return ["montecarlo estimates the robot's own terms: estimate.select has no effect on it"]


def _long_delay(run: RunDescription, document: Document) -> Iterator[Problem]:
    """Name a delay of the twin that no period holds."""
    delay, longest = run.experiment.delay, 1 / run.trajectory.frequency[0]
    if abs(delay) > longest:
        yield document.problem(
            ("experiment", "delay"),
            f"a delay of {delay:g} s is longer than a period, which has {longest:g} s at most",
            'a delay of the measurement, such as "1 ms"',
        )


def _nothing_to_estimate(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name what stands in the way of estimating what is not known exactly."""
    if run.estimate.systematic != "estimated":
        return
    key = ("estimate", "systematic")
    if robot.tolerances is None or not robot.tolerances.inexact:
        yield document.problem(
            key,
            "there is nothing to estimate: neither the robot nor the run states a tolerance",
            "budget or none; or `tolerances` in the robot file or the run",
        )
    if "ml" not in run.estimate.estimators:
        yield document.problem(
            key,
            "only maximum likelihood estimates what has a tolerance, and estimate.estimators "
            "does not name ml",
            "budget or none; or ml among estimate.estimators",
        )


def _unfitted_constants(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name a differentiation along which no constant of a term is estimated."""
    named = ", ".join(robot.estimated_constants)
    if named and run.estimate.differentiation != "fourier":
        yield document.problem(
            ("estimate", "differentiation"),
            f"the robot {robot.name} has {named} estimated, which takes a motion that is a Fourier "
            f"series; '{run.estimate.differentiation}' differentiation has none",
            "fourier, or estimate: false with the constants",
        )


def _nothing_to_select(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name candidates that the robot has already, and a prior that knows nothing of them."""
    if run.estimate.select is None:
        return
    key = ("estimate", "select", "candidates")
    present = [term.name for term in robot.terms]
    others = ", ".join(name for name in term_definitions() if name not in present)
    for place, candidate in enumerate(run.estimate.select.candidates):
        beside = term_definitions()[candidate.name].beside
        if candidate.name in present:
            yield document.problem(
                (*key, place),
                f"the robot {robot.name} has the term '{candidate.name}' already: it is estimated",
                f"terms that it lacks: {others}",
            )
        before = (one.name for one in run.estimate.select.candidates[:place])
        if beside and beside not in (*present, *before):
            yield document.problem(
                (*key, place),
                f"the term '{candidate.name}' takes the constants of '{beside}'",
                f"{beside} among the robot's terms, or listed before {candidate.name}",
            )
        estimated = any(constant.estimate for constant in candidate.constants.values())
        if estimated and run.estimate.differentiation != "fourier":
            yield document.problem(
                (*key, place),
                f"a constant of '{candidate.name}' is estimated, which takes a motion that is a "
                f"Fourier series; '{run.estimate.differentiation}' differentiation has none",
                "estimate.differentiation: fourier, or estimate: false with the constant",
            )
    earlier = {
        "prior_from": run.estimate.prior_from != "none",
        "prior": not isinstance(run.estimate.prior, dict),
    }
    for name in (name for name, given in earlier.items() if given):
        yield document.problem(
            ("estimate", name),
            "an earlier estimate is a prior of its own terms, and estimate.select tries others",
            "none, or no estimate.select",
        )


def _unfit_payload(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name what a payload is not understood with."""
    if not run.experiment.payload:
        return
    if robot.platform == "symmetric":
        yield document.problem(
            ("experiment", "payload"),
            f"the robot {robot.name} has a symmetric platform, and a payload has ten parameters",
            "platform: general in the robot file",
        )
    if run.estimate.prior_from != "none":
        yield document.problem(
            ("estimate", "prior_from"),
            "the robot's identification is no prior of a machine that carries a payload",
            "none, and for the payload `estimate.prior` with the run folder of the identification",
        )


def _uncontrollable(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name what the closed loop cannot be simulated with."""
    if "feedforward" not in run.stages:
        return
    sampling, bandwidth = 1 / run.controller_period, run.feedforward.bandwidth
    if sampling < _SAMPLES_OF_A_SWING * bandwidth * (1 - _ROUNDING):
        yield document.problem(
            ("feedforward", "bandwidth"),
            f"a controller that samples at {sampling:g} Hz cannot have a bandwidth of "
            f"{bandwidth:g} Hz",
            f"at most {sampling / _SAMPLES_OF_A_SWING:g} Hz, or a shorter "
            "trajectory.controller_period",
        )
    spectrum = None if robot.noise is None else robot.noise.length_spectrum
    if spectrum is not None and not spectrum.covers(sampling):
        yield document.problem(
            ("trajectory", "controller_period"),
            f"a controller that samples at {sampling:g} Hz, but noise.length_spectrum was measured "
            f"at {spectrum.highest:g} Hz",
            f"{1 / spectrum.highest:g} s or more, or a run without `feedforward:`",
        )
    if any(run.experiment.compliance) and run.data.file is None:
        yield document.problem(
            ("experiment", "compliance"),
            "the forward dynamics of feedforward has rigid struts",
            "no compliance in a run with `feedforward:`",
        )
