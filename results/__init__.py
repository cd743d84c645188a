"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from results.saving import design_figures, record_figures

__all__ = ["design_figures", "record_figures"]


def __getattr__(name: str) -> Any:
    """Load what draws when it is first used: a report whose figures are there needs none of it."""
    if name not in __all__:
        raise AttributeError(f"module 'results' has no attribute '{name}'")
    from results import saving

    return getattr(saving, name)
