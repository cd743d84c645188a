"""Views, figures and reports of results; they compute nothing that a run decides."""

from typing import TYPE_CHECKING

from expdesign.loading import names_loaded_when_used

if TYPE_CHECKING:
    from results.render.figures import design_figures, draw_figures

__all__ = ["design_figures", "draw_figures"]

# A report whose figures are there needs nothing of what draws.
__getattr__ = names_loaded_when_used(__name__, dict.fromkeys(__all__, "results.render.figures"))
