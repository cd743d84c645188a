"""What is known of the noise by itself: common to a diagnosis and an analysis of noise alone."""

from __future__ import annotations

from typing import Protocol

from estimation.diagnostics.drift import Drift
from estimation.diagnostics.noise_samples import ChannelNoise
from estimation.diagnostics.normality import Normality
from estimation.diagnostics.whiteness import Whiteness
from estimation.processing import NoiseModel


class NoiseTests(Protocol):
    """Samples of the noise and the tests of it; None where one could not be done."""

    @property
    def noise(self) -> NoiseModel:
        """Σ and Δ."""

    @property
    def samples(self) -> ChannelNoise:
        """The noise itself."""

    @property
    def force_normality(self) -> Normality:
        """Of the forces' noise."""

    @property
    def length_normality(self) -> Normality | None:
        """Of the lengths' noise."""

    @property
    def force_noise_whiteness(self) -> Whiteness | None:
        """Of the forces' noise."""

    @property
    def length_noise_whiteness(self) -> Whiteness | None:
        """Of the lengths' noise."""

    @property
    def force_drift(self) -> Drift:
        """Between the periods' means of the forces."""

    @property
    def length_drift(self) -> Drift | None:
        """Between the periods' means of the lengths."""
