"""The experiment as a whole: from a configuration to a design and its run folder."""

from expdesign.experiment.design import design
from expdesign.experiment.result import DesignResult, PredictedPrecision

__all__ = ["DesignResult", "PredictedPrecision", "design"]
