"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""

from results.saving import design_figures, record_figures

__all__ = ["design_figures", "record_figures"]
