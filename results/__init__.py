"""Views, figures and reports of results; they compute nothing that a run decides."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from results.render.figures import design_figures, draw_figures

__all__ = ["design_figures", "draw_figures"]


def __getattr__(name: str) -> Any:
    # On first use: a report whose figures exist needs no plotting library.
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module("results.render.figures"), name)
