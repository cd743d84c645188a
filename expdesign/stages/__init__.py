"""Stages of a run: what each needs, does and writes, and the run that does them in order."""

from expdesign.stages.outcome import Outcome, StageFailed
from expdesign.stages.progress import Progress, short
from expdesign.stages.run import RunResult, do_stage, refuse_study, refuse_unwritable, run_folder
from expdesign.stages.table import STAGES, Stage
from expdesign.stages.workspace import Sources, Workspace

__all__ = [
    "STAGES",
    "Outcome",
    "Progress",
    "RunResult",
    "Sources",
    "Stage",
    "StageFailed",
    "Workspace",
    "do_stage",
    "refuse_study",
    "refuse_unwritable",
    "run_folder",
    "short",
]
