"""Figures: drawn from a result and saved as PNG, SVG and PDF."""
