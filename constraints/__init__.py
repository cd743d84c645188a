"""Limits on symbolic expressions. Knows no robot and no sampling."""

from constraints.catalogue import limit_definitions
from constraints.definition import Limit, LimitDefinition, Quantities, plain_limit

__all__ = ["Limit", "LimitDefinition", "Quantities", "limit_definitions", "plain_limit"]
