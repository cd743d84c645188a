"""The symbolic graph of one instant, evaluated for many of them."""

from expdesign.evaluation.batch import BatchFunction

__all__ = ["BatchFunction"]
