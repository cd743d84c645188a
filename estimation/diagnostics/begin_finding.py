"""Whether a recording begins before the motion does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from estimation.diagnostics.finding import Assumption, Finding
from estimation.estimators.experiment import Experiment

_MOVING = Assumption(
    "the recording begins with the motion",
    "the recording begins at rest",
    "leave the rows before the motion out",
)


def begin_findings(experiments: Sequence[Experiment]) -> tuple[Finding, ...]:
    """Return the experiments whose recording begins before the motion."""
    found = []
    for number, experiment in enumerate(experiments, 1):
        begin = experiment.record.moves_from
        if begin is not None:
            finding = replace(
                _MOVING.found(f"the struts do not move before {begin:.4g} s"),
                advice=f"leave the rows before the motion out: `data.start: {begin:.4g} s`",
            )
            found.append(finding.of_experiment(number) if len(experiments) > 1 else finding)
    return tuple(found)
