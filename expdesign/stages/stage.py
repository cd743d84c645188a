"""Stage: the base class of the steps that a run consists of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.stages.workspace import Outcome, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView

Keys = bool | set[str]

FIGURES = "figures/*"
TABLES = ("columns.json", "tables/*.csv", FIGURES)
"""Files of most stages: their tables, the description of these, and figures."""


def run_sections(*names: str, **keys: set[str]) -> Mapping[str, Keys]:
    """Return sections of a run file, or some of their keys, with those that every stage has.

    Examples
    --------
    >>> run_sections("design", experiment={"periods"})["experiment"]
    {'periods'}
    """
    return {**dict.fromkeys(("name", "robot", *names), True), **keys}


class Stage(ABC):
    """A stage of a run: its inputs, its computation, its files and its view.

    A new stage needs a subclass in a module, and nothing more; another package registers its module
    in the entry-point group ``expdesign.plugins``. Modules that take long to load are
    imported in the methods.
    """

    name: str
    """Key in the run file."""
    does: str
    """Description, as the rest of a sentence."""
    file: str
    """File without which a run folder does not hold the stage."""
    output: str = ""
    """File without which the stage is done again; `file` by default."""
    writes: tuple[str, ...] = ()
    """Further files that are always written, and patterns of those that depend on the run."""
    sections: Mapping[str, Keys] | None = None
    """Sections of the run file, or keys of them, that the result depends on; None: all."""
    needs: tuple[str, ...] = ()
    """Inputs beside the run file: ``"design"``, ``"recording"`` (with the executed design, if there
    is one), ``"estimate"``, or ``"folder"`` for all other stages. They come from the options of the
    command, from memory when the same run has made them, or from the run folder."""
    compared: str = ""
    """Table that identifies the result in comparisons; empty: the stage is not compared."""
    after: str = ""
    """Stage before this one in a run; by default a plug-in's is the last before the report."""
    shown_after: str = ""
    """Stage before this one in a report; by default as in a run."""

    @abstractmethod
    def run(self, work: Workspace) -> Outcome:
        """Do the stage.

        Raises
        ------
        InputError
            An input is missing or cannot be used.
        ComputationError
            There is no result.
        """

    @abstractmethod
    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""

    @abstractmethod
    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of a folder that holds the stage; a brief one needs no computation."""

    def compare(
        self, folders: Mapping[str, RunFolder], *, precision: float, quick: bool
    ) -> StageView | None:
        """Return the comparison of folders that hold the stage; by default of the views' facts."""
        from results.comparison.comparison import compare_facts

        del precision, quick
        return compare_facts(self.name, folders)

    def read(self, folder: Path) -> Any:
        """Return the stored result of a run folder."""
        return self.result_type().read(folder)

    def inputs(self, configuration: RunConfiguration) -> tuple[str, ...]:
        """Return the inputs that the stage needs in this run, of `needs`."""
        del configuration
        return self.needs

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason why a run that names the stage leaves it out; empty: it is done."""
        return sweep_reason(configuration)


def sweep_reason(configuration: RunConfiguration) -> str:
    """Return the reason against a stage of a single design where the run is a sweep."""
    if configuration.run.sweep is None:
        return ""
    return "the sweep makes several designs; `expdesign run` of the run.yaml of one does it"
