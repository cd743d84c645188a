"""Monte-Carlo study: the estimators on many simulated experiments, against truth and bound."""

from estimation.montecarlo.study import Study, run_study

__all__ = ["Study", "run_study"]
