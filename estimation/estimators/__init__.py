"""Least-squares, Gauss–Markov and maximum-likelihood estimators on the shared symbolic graph."""

from estimation.estimators.covariance import (
    SystematicUncertainty,
    add_prior_response,
    systematic_share,
)
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint_equations import PerturbedMachine, cramer_rao_covariance
from estimation.estimators.linear import linear_estimate
from estimation.estimators.maximum_likelihood import maximum_likelihood
from estimation.estimators.priors import ParameterPriors, UnidentifiableError
from estimation.estimators.result import ParameterEstimate, covariance_ml_less_gm

__all__ = [
    "Experiment",
    "ParameterEstimate",
    "ParameterPriors",
    "PerturbedMachine",
    "SystematicUncertainty",
    "UnidentifiableError",
    "add_prior_response",
    "covariance_ml_less_gm",
    "cramer_rao_covariance",
    "linear_estimate",
    "maximum_likelihood",
    "systematic_share",
]
