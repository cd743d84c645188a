"""Figures of a Monte-Carlo study."""
