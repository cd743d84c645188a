"""Renderers of views: terminal, HTML, LaTeX, comparison."""
