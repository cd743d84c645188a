"""Monte-Carlo study of the estimators on simulated experiments, against truth and bound."""

from estimation.montecarlo.result import MonteCarloResult
from estimation.montecarlo.study import run_study

__all__ = ["MonteCarloResult", "run_study"]
