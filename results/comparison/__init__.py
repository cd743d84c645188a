"""Comparison of several run folders."""
