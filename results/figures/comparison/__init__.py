"""Figures of a comparison of several run folders."""
