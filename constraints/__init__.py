"""Limits on symbolic expressions. Knows no robot and no sampling."""

from constraints.definition import (
    Limit,
    LimitDefinition,
    Quantities,
    limit_definitions,
    plain_limit,
)

__all__ = ["Limit", "LimitDefinition", "Quantities", "limit_definitions", "plain_limit"]
