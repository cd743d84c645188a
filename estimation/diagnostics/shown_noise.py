"""The noise that a recording shows, where it was weighted with another one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from estimation.estimators.experiment import Experiment
from estimation.processing import NoiseEstimate, NoiseModel
from estimation.processing.noise import ENOUGH_FREEDOM
from estimation.processing.record import Channels


def with_memory(experiment: Experiment) -> Experiment:
    """Return an experiment with the memory that its noise shows, though it was weighted as white.

    Who takes noise with a memory for white does not make a fault of the model of it.
    """

    def seen(weighted: NoiseEstimate, channels: Channels) -> NoiseEstimate:
        shown = channels.shown_noise
        known = weighted.source == "estimated" and weighted.lines is not None
        if not known or weighted.filter is not None or shown is None or shown.filter is None:
            return weighted
        return shown

    noise = _chosen(experiment, seen)
    return experiment if noise is experiment.noise else replace(experiment, noise=noise)


def shown_noise(experiment: Experiment) -> NoiseModel:
    """Return the noise that a recording shows, where it shows enough; else what was given."""

    def shown(given: NoiseEstimate, channels: Channels) -> NoiseEstimate:
        repeated = channels.scatter
        if given.source != "given" or repeated is None or repeated.freedom < ENOUGH_FREEDOM:
            return given
        found = repeated if experiment.pointwise is not None else channels.shown_noise
        return given if found is None else found

    return _chosen(experiment, shown)


def _chosen(
    experiment: Experiment, choose: Callable[[NoiseEstimate, Channels], NoiseEstimate]
) -> NoiseModel:
    """Return the noise chosen for forces and lengths: the experiment's own where both stay."""
    noise, record = experiment.noise, experiment.record
    forces, lengths = choose(noise.forces, record.forces), choose(noise.lengths, record.lengths)
    if forces is noise.forces and lengths is noise.lengths:
        return noise
    return NoiseModel(forces, lengths)
