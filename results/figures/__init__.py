"""Figures: one per file, drawn from a record and saved as PNG and SVG."""
